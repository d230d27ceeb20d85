"""A dry run, scenarios or a simulated run of a text, in a process of its own: python -m pomona.tools.tree_editor.child

The first line of the input is the order, one JSON object; each line of the output is one message. After the end the
page of a run stays until the input ends.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pomona.executive.errors import PomonaError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import read_text
from pomona.executive.registry import Registry
from pomona.executive.running.events import Event, NodeChanged, RunEnded, RunStarted
from pomona.executive.terminal.words import say as sentence
from pomona.executive.values.installation import installed_trees
from pomona.tools.dashboard.apart import PageProcess
from pomona.tools.dashboard.security import Access
from pomona.tools.scenarios.run_scenario import run_scenario
from pomona.tools.scenarios.scenario import read_scenario

Say = Callable[[dict[str, Any]], None]


def _say_node(say: Say, event: Event) -> None:
    if isinstance(event, RunStarted):
        say(
            {
                "nodes": [
                    {key: node.get(key, "") for key in ("path", "kind", "type", "file", "line")}
                    for node in event.nodes
                ]
            }
        )
    elif isinstance(event, NodeChanged):
        why = sentence(event.reason) if event.reason is not None else event.feedback
        say({"path": event.path, "status": event.status, "words": why, "t": event.t})
    elif isinstance(event, RunEnded):
        say({"outcome": event.outcome, "words": sentence(event.reason), "time": event.time})


def _run(asked: dict[str, Any], say: Say) -> None:
    """Run the text: on a simulated cell with a page of its own, or dry."""
    tree = Path(asked["tree"])
    dry = bool(asked["dry"])
    order = RunOrder(
        tree=tree, cell=Path(asked["cell"]), seed=int(asked["seed"]), settings=asked["settings"], dry=dry,
        real_time=bool(asked["real_time"]), record=None if dry else Path(asked["record"]), cleared=True,
        texts={str(tree): asked["text"]}, attended=not dry,
    )  # fmt: skip
    if dry:
        execute(order, [lambda event: _say_node(say, event)])
        return
    page = PageProcess(Access("127.0.0.1", int(asked["port"])), Path(asked["record"]))
    page.start()
    say({"page": page.access.link})
    problem = "the preparation failed"
    try:
        done = execute(
            order,
            [page.on_event, lambda event: _say_node(say, event)],
            on_ready=page.control.serve,
            starting=page.control.prepare(tree.stem),
        )
        problem = ""
        say({"record": "" if done.record is None else done.record.name})
    except PomonaError as error:
        problem = str(error)
        raise
    finally:
        page.control.clear(problem)
        say({"ended": problem or True})
        sys.stdin.read()
        page.close()


def _test(asked: dict[str, Any], say: Say) -> None:
    """Run the scenario files that test the text."""
    tree = Path(asked["tree"])
    registry = Registry.installed()
    for name in asked["scenarios"]:
        path = Path(name)
        texts = {tree: asked["text"]}
        scenario = read_scenario(
            read_text(path), path, registry, tree_folders=[installed_trees()], texts=texts
        )
        result = run_scenario(scenario, registry)
        infos = result.coverage.nodes.values()
        say(
            {
                "nodes": [
                    {key: getattr(info, key) for key in ("path", "kind", "type", "file", "line")}
                    for info in infos
                ]
            }
        )
        for info in infos:
            ends = sorted(status.name.lower() for status in result.coverage.seen.get(info.path, ()))
            say(
                {
                    "path": info.path,
                    "status": "reached" if ends else "unreached",
                    "words": ", ".join(ends),
                    "t": 0.0,
                }
            )
        for case in result.cases:
            say(
                {
                    "case": case.case.name,
                    "file": path.name,
                    "passed": case.passed,
                    "problems": case.problems,
                }
            )


def main() -> int:
    """Carry the order out.

    Returns:
        0 after it, 2 when it cannot be carried out.
    """
    lines = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)  # libraries that write to the standard output disturb no message

    def say(message: dict[str, Any]) -> None:
        lines.write(json.dumps(message, default=str) + "\n")

    with lines:
        try:
            asked = json.loads(sys.stdin.readline())
            (_test if asked["kind"] == "scenarios" else _run)(asked, say)
        except PomonaError as error:
            say({"problem": str(error)})
            return 2
        except KeyboardInterrupt:  # before the run began
            say({"problem": "stopped before it began"})
            return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
