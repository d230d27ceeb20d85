"""Recorded runs as tables: the list, one beside another."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from rich.table import Table
from rich.text import Text

from pomona.executive.recording.digest import Digest
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.words import MARKS, row_of, seconds


def how(run: Digest) -> str:
    """Return a run's outcome, or its state when it has none; `empty` for a record of zero length."""
    if run.state == "cut off" and run.bytes == 0:
        return "empty"
    return run.outcome if run.state == "ended" and run.outcome in MARKS else run.state


def ending(run: Digest) -> str:
    """Why a run ended as it did, in a few words; empty for a success of which nothing was lost."""
    lost = f"repaired, lost {run.lost}   " if run.lost else ""
    if how(run) == "success":
        return lost.strip()
    if run.state == "running":
        return f"running for {seconds(time.time() - run.wall_time)}"
    if run.state == "cut off":
        return f"{lost}{how(run)}: {run.message}"
    if run.state == "damaged":
        return run.message or "damaged"
    why = f"{run.code}: {run.message}" if run.code else run.message or ""
    return f"{lost}{why}".strip()


def wide_console() -> Screen:
    """Return a console that cuts nothing off when its output goes into a file or a pipe."""
    console = Screen()
    return console if console.is_terminal else Screen(width=2000)


def print_list(console: Screen, runs: Sequence[Digest], of: int, total: int) -> None:
    """Print the list, newest first, with a summary line.

    Args:
        of: the number of all runs, shown or not.
        total: bytes of all.
    """
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for name in ("", "run", "cell", "took", "why"):
        table.add_column(name, no_wrap=True)
    room = console.width - 21 - max((len(run.run) + len(run.cell) for run in runs), default=0)
    for run in runs:
        sign, style = MARKS.get(how(run), ("?", "red"))
        settings = (f"{key}={value}" for key, value in run.settings.items())
        table.add_row(
            Text(sign, style),
            run.run,
            run.cell or "–",
            "–" if run.time is None else seconds(run.time),
            Text(
                _shortened("  ".join(filter(None, (ending(run), *settings))), max(room, 20)),
                style if how(run) != "success" else "",
            ),
        )
    console.print(table)
    words = ", ".join(f"{number} {word}" for word, number in Counter(map(how, runs)).most_common())
    shown = f"{len(runs)}{'' if len(runs) == of else f' of {of}'} run{'s' * (of != 1)}"
    console.print(f"{shown}, {size(total)} in all: {words or 'none'}", style="dim")


def _shortened(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: width - 1]}…"


def size(value: float) -> str:
    """1232338 -> '1.2 MB'."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if value >= factor:
            return f"{value / factor:.1f} {unit}"
    return f"{value:.0f} B"


def when(wall_time: float) -> str:
    """Return a moment on this machine's clock."""
    return f"{datetime.fromtimestamp(wall_time):%d %B %Y, %H:%M:%S}"


def print_comparison(
    console: Screen, runs: Sequence[Digest], skills: Sequence[Mapping[str, float]]
) -> None:
    """Print runs beside each other: one column each, one row for every value that at least one of them has.

    Args:
        skills: of each run, seconds by skill.
    """
    table = Table(box=None, padding=(0, 3, 0, 0), header_style="bold")
    table.add_column("")
    for run in runs:
        table.add_column(run.run, justify="right")
    for name, values in _comparison(runs, skills).items():
        same = len(set(values)) == 1
        table.add_row(Text(name, "dim"), *(Text(value, "dim" if same else "") for value in values))
    console.print(table)
    console.print("values equal in all runs are dimmed", style="dim")


def _comparison(
    runs: Sequence[Digest], skills: Sequence[Mapping[str, float]]
) -> dict[str, list[str]]:
    rows: dict[str, list[str]] = {}

    def add(name: str, values: Sequence[Any]) -> None:
        if any(value not in (None, "", "–") for value in values):
            rows[name] = ["–" if value is None else str(value) for value in values]

    add("outcome", [how(run) for run in runs])
    add("why not", [run.code for run in runs])
    add("began", [when(run.wall_time) if run.wall_time else None for run in runs])
    add("git", [run.git for run in runs])
    add("tree", [f"{run.tree} {run.tree_hash[:8]}" for run in runs])
    add("cell", [f"{run.cell} {run.cell_hash[:8]}" for run in runs])
    add("seed", [run.seed for run in runs])
    for key in sorted({key for run in runs for key in run.settings}):
        usual = [
            f"{run.parameters[key]} by default" if key in run.parameters else None for run in runs
        ]
        add(key, [run.settings.get(key, default) for run, default in zip(runs, usual, strict=True)])
    parameters = {key for run in runs for key in run.parameters} - {
        key for run in runs for key in run.settings
    }
    for key in sorted(parameters):
        values = [run.parameters.get(key) for run in runs]
        if len({str(value) for value in values}) > 1:
            add(key, values)
    add("time", [None if run.time is None else seconds(run.time) for run in runs])
    add("wall time", [None if run.wall is None else seconds(run.wall) for run in runs])
    add("attempts of all retries", [run.attempts for run in runs])
    for code in sorted({code for run in runs for code in run.codes}):
        add(f"× {code}", [run.codes.get(code, 0) for run in runs])
    for name in dict.fromkeys(name for run in skills for name in run):
        if max(run.get(name, 0.0) for run in skills) >= 0.01:
            add(f"{name} takes", [seconds(run[name]) if name in run else None for run in skills])
    for name in dict.fromkeys(name for run in runs for name in run.truth or {}):
        shown = [row_of(name, (run.truth or {}).get(name)) for run in runs]
        add(shown[0][0], [value for _, value in shown])
    return rows
