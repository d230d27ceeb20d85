"""Read a record: how long each skill ran, and why nodes failed. Run: python examples/read_record.py [FOLDER]

Without a folder the newest one in runs/ is read.
Needs the distribution pomona or pomona-executive.
"""

import sys
from pathlib import Path

from pomona.executive.recording.read import read_events
from pomona.executive.running.events import NodeChanged, RunEnded, RunStarted

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else max(Path("runs").glob("*/run.mcap")).parent
skills: set[str] = set()
began: dict[str, float] = {}
spent: dict[str, float] = {}

for event in read_events(folder):
    if isinstance(event, RunStarted):
        skills = {node["path"] for node in event.nodes if node["kind"] == "skill"}
        print(
            f"{event.run}: {event.tree} on {event.cell}, seed {event.seed}, {len(event.nodes)} nodes"
        )
    elif isinstance(event, NodeChanged) and event.path in skills:
        if event.status == "RUNNING":
            began.setdefault(event.path, event.t)
        else:
            spent[event.path] = (
                spent.get(event.path, 0.0) + event.t - began.pop(event.path, event.t)
            )
        if event.status == "FAILURE" and event.reason is not None:
            print(f"{event.t:6.2f} s  {event.path}: {event.reason.code}, {event.reason.message}")
    elif isinstance(event, RunEnded):
        print(f"{event.outcome} after {event.time:.2f} s")

for path, seconds in sorted(spent.items(), key=lambda item: -item[1])[:5]:
    print(f"{seconds:6.2f} s  {path}")
