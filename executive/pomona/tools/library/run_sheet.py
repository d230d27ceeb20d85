"""One recorded run on one page."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

from rich.table import Table
from rich.text import Text

from pomona.executive.recording.digest import Digest
from pomona.executive.recording.folder import EVENTS, events_file, is_being_written
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.recording.scan import scan
from pomona.executive.speed import words_of
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.summary import Summary
from pomona.executive.terminal.words import MARKS, UNCHECKED
from pomona.tools.library.run_list import ending, how, size, when


def print_sheet(console: Screen, record: Path, run: Digest, summary: Summary) -> None:
    """Print the run's settings, its result, and the contents of its record."""
    if summary.started is not None and summary.ended is not None:
        summary.print(console, None, whole=True)
    else:
        going_on = is_being_written(events_file(record))
        sign, style = MARKS["running" if going_on else "cut off"]
        how_so = "running" if going_on else ending(run)
        console.print(Text.assemble((f"{sign} {run.tree or record.name}", style), f"  {how_so}"))
    started = summary.started
    console.print()
    rows = {
        "record": str(record),
        "began": when(run.wall_time) if run.wall_time else "unknown",
        "how": how(run),
    }
    if started is not None:
        rows |= {
            "tree": f"{run.tree}  {started.tree_path}  ({run.tree_hash})",
            "cell": f"{run.cell}, {run.cell_kind}  {started.cell_path}  ({run.cell_hash})",
            "seed": str(run.seed),
            "speed": words_of(started.speed) if started.speed < 1.0 else "",
            "settings": "  ".join(f"{key}={value}" for key, value in run.settings.items())
            or "none",
            "parameters": "  ".join(
                f"{k}={json.dumps(v, ensure_ascii=False)}" for k, v in run.parameters.items()
            ),
            "versions": "  ".join(
                f"{name} {version}" for name, version in started.versions.items()
            ),
        }
    rows["acts"] = "  ".join(_acts(record))
    if run.lost:
        rows["lost"] = f"{run.lost} (damaged and repaired)"
    if not run.checked:
        rows["checks"] = UNCHECKED
    if run.codes:
        rows["failures"] = "  ".join(f"{code} × {number}" for code, number in run.codes.items())
    for name, value in rows.items():
        if value:
            console.print(Text.assemble("  ", (f"{name:<11}", "bold"), f" {value}"), soft_wrap=True)
    console.print()
    console.print(_topics(record))


def _acts(record: Path) -> list[str]:
    contents = (found.content for found in scan(events_file(record), topics=EVENTS.__eq__))
    acts = [
        parse_object(content)
        for content in contents
        if content.startswith(b'{"event":"OperatorActed"')
    ]
    return [
        f"{act['t']:.2f} s {act['who']}: {act['action']}: {act['detail']}".removesuffix(": ")
        for act in acts
    ]


def _topics(record: Path) -> Table:
    counts: Counter[str] = Counter()
    sizes: Counter[str] = Counter()
    for topic, content, *_ in scan(events_file(record)):
        counts[topic] += 1
        sizes[topic] += len(content)
    table = Table(box=None, padding=(0, 3, 0, 2), header_style="dim")
    table.add_column("topic")
    table.add_column("messages", justify="right")
    table.add_column("size", justify="right")
    for topic, number in sorted(counts.items()):
        table.add_row(topic, str(number), size(sizes[topic]))
    return table
