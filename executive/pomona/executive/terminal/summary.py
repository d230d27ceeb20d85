"""Summary at the end of a run, equal for a live run and a recorded one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from pomona.executive.encode import plain
from pomona.executive.reasons import Reason
from pomona.executive.running.events import (
    AttemptEnded,
    Computed,
    Event,
    NodeChanged,
    PortWritten,
    Published,
    RunEnded,
    RunStarted,
    TreeChanged,
)
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.words import (
    MARKS,
    end_words,
    felt_words,
    figure,
    headline,
    say,
    seconds,
)
from pomona.executive.views import TableView

# of a table that are printed; an export has all
MOST_ROWS = 200
MOST_COLUMNS = 30


class Summary:
    """Gathers the figures of the summary from the events."""

    def __init__(self) -> None:
        self.started: RunStarted | None = None
        self.ended: RunEnded | None = None
        self.attempts: list[AttemptEnded] = []
        self.tables: dict[str, TableView] = {}
        self.notes: dict[str, str] = {}
        self.facts: dict[str, Mapping[str, Any]] = {}
        self.robot_time: dict[str, float] = defaultdict(float)
        self.compute_time: dict[str, float] = defaultdict(float)
        self._running_since: dict[str, float] = {}
        self._names: dict[str, str] = {}
        self._parents: dict[str, str | None] = {}

    def on_event(self, event: Event) -> None:
        """Follow the run."""
        if isinstance(event, RunStarted):
            self.started = event
        if isinstance(event, (RunStarted, TreeChanged)):
            self._parents.update((node["path"], node["parent"]) for node in event.nodes)
            parents = {node["parent"] for node in event.nodes}
            self._names.update(
                (node["path"], str(node["name"]))
                for node in event.nodes
                if node["path"] not in parents
            )
        elif isinstance(event, NodeChanged) and event.path in self._names:
            self._account(event)
        elif isinstance(event, AttemptEnded):
            self.attempts.append(event)
        elif isinstance(event, Computed):
            self.compute_time[self._names.get(event.node, event.node)] += event.wall
        elif isinstance(event, Published) and isinstance(event.value, TableView):
            self.tables[event.topic] = event.value
        elif isinstance(event, PortWritten):
            if event.sentence:
                self.notes[event.key.rsplit("/", 1)[-1]] = event.sentence
            if event.facts:
                self.facts[event.key.rsplit("/", 1)[-1]] = event.facts
        elif isinstance(event, RunEnded):
            self.ended = event

    def within(self) -> list[str]:
        """Return each attempt's outer attempt, `outer 2 of 3`; empty for the outermost and for unfinished ones."""
        trying = {attempt.path for attempt in self.attempts}
        ended = dict[str, AttemptEnded]()
        found = []
        outer: dict[str | None, str | None] = {}
        for path, parent in self._parents.items():  # a parent comes before its children
            outer[path] = parent if parent in trying else outer.get(parent)
        for attempt in self.attempts:
            around = outer.get(attempt.path)
            found.append("" if around is None else _next_attempt(around, ended.get(around)))
            ended[attempt.path] = attempt
        return found

    def _account(self, event: NodeChanged) -> None:
        if event.status == "RUNNING":
            self._running_since.setdefault(event.path, event.t)
        elif event.path in self._running_since:
            self.robot_time[self._names[event.path]] += event.t - self._running_since.pop(
                event.path
            )

    # ------------------------------------------------------------------------------------------- as JSON

    def as_json(self, record: Path | None) -> dict[str, Any]:
        """Return the last line of `pomona run --json`."""
        assert self.started is not None
        assert self.ended is not None
        return {
            "outcome": self.ended.outcome,
            "reason": _reason_json(self.ended.reason),
            "run": self.started.run,
            "record": str(record) if record else None,
            "tree": self.started.tree,
            "cell": self.started.cell,
            "seed": self.started.seed,
            "ticks": self.ended.ticks,
            "time_s": round(self.ended.time, 6),
            "wall_s": round(self.ended.wall, 3),
            "attempts": [
                {
                    "node": attempt.path,
                    "number": attempt.number,
                    "of": attempt.of,
                    "within": within,
                    "succeeded": attempt.succeeded,
                    "reason": _reason_json(attempt.reason),
                }
                for attempt, within in zip(self.attempts, self.within(), strict=True)
            ],
            "robot_time_s": {name: round(value, 3) for name, value in self.robot_time.items()},
            "compute_s": {name: round(value, 3) for name, value in self.compute_time.items()},
            "values": plain(self.facts),
            "account": plain(self.ended.account),
            "truth": plain(self.ended.truth),
        }

    # ------------------------------------------------------------------------------------------ for people

    def print(self, console: Screen, record: Path | None, *, whole: bool = False) -> None:
        """The summary in the terminal; of the world's score all when `whole`, else the first five figures."""
        assert self.started is not None
        assert self.ended is not None
        sign, style = MARKS[self.ended.outcome]
        took = f"{self.times()}, seed {self.started.seed}"
        console.print(
            Text.assemble(
                (f"{sign} {self.started.tree}", f"bold {style}"),
                f"  {self._headline()}   ",
                (took, "dim"),
            ),
        )
        for name, sentence in self.notes.items():
            _row(console, name, sentence)
        if felt := felt_words(self.ended.account or {}):
            _row(console, "felt", felt)
        for attempt, within in zip(self.attempts, self.within(), strict=True):
            if attempt.succeeded and attempt.number == 1:
                continue  # success at the first try: nothing to report
            mark = ("✓ ", "green") if attempt.succeeded else ("✗ ", "red")
            which = f"{attempt.number} of {attempt.of}" + (f" in {within}" if within else "")
            _row(
                console,
                retry_name(attempt.path),
                mark,
                f"{which}, at {attempt.t:.2f} s  {say(attempt.reason)}".strip(),
            )
        for table in self.tables.values():
            console.print(_table(table))
        truth = self.ended.truth or {}
        figures = (
            [figure(name, value) for name, value in _of_interest(truth)]
            if whole
            else headline(truth)
        )
        if figures:
            _row(console, "truth", "  ".join(figures))
        shares = sorted(self.robot_time.items(), key=lambda item: -item[1])
        if longest := [f"{name} {seconds(value)}" for name, value in shares if value >= 0.01]:
            _row(console, "time", "  ".join(longest))
        if self.compute_time:
            total = sum(self.compute_time.values())
            parts = "  ".join(
                f"{n} {seconds(v)}"
                for n, v in sorted(self.compute_time.items(), key=lambda i: -i[1])
            )
            _row(console, "computing", f"{seconds(total)} in all: {parts}")
        if record is not None:
            picture = record / "picture.png"
            _row(
                console,
                "record",
                str(record),
                (f"   (picture: {picture})", "dim") if picture.is_file() else "",
            )

    def times(self) -> str:
        """How long it took on the cell's clock, how long here, and how long the preparation took before."""
        assert self.started is not None
        assert self.ended is not None
        clock = "simulated" if self.started.cell_kind == "simulated" else "on the cell's clock"
        run = self.ended.wall
        before = self.started.preparation
        here = (
            f"{seconds(run)} to run, {seconds(before)} to prepare, {seconds(run + before)} in all"
        )
        return f"{seconds(self.ended.time)} {clock}; {here if before else f'{seconds(run)} to run'}"

    def sentence(self) -> str:
        """How it ended and why, in one line."""
        assert self.started is not None
        return f"{self.started.tree} {self._headline()}"

    def _headline(self) -> str:
        assert self.ended is not None
        if self.ended.outcome == "success":
            last = self.last_attempt()
            return (
                f"succeeded on attempt {last.number} of {last.of}"
                if last and last.of > 1
                else "succeeded"
            )
        return f"{end_words(self.ended).removeprefix('was ')}: {say(self.ended.reason)}"

    def last_attempt(self) -> AttemptEnded | None:
        """Return the newest attempt that succeeded of a retry that no other retry surrounds."""
        outermost = (
            a
            for a, within in zip(self.attempts, self.within(), strict=True)
            if a.succeeded and not within
        )
        return next(reversed(list(outermost)), None)


def retry_name(path: str) -> str:
    """`fetch/Attempt:retry` -> attempt."""
    return path.rsplit("/", 1)[-1].partition(":")[0].lower()


def _next_attempt(path: str, before: AttemptEnded | None) -> str:
    if before is None:
        return f"{retry_name(path)} 1"
    over = before.succeeded or before.number >= before.of
    return f"{retry_name(path)} {1 if over else before.number + 1} of {before.of}"


def _reason_json(reason: Reason | None) -> dict[str, Any] | None:
    if reason is None:
        return None
    last = list(reason.leaves())[-1]
    return {
        "node": last.node_path,
        "code": last.code,
        "message": last.message,
        "data": plain(last.data),
        "chain": plain(reason),
    }


def _of_interest(truth: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return the entries of a world's score without poses and empty ones."""
    return [
        (n, v) for n, v in truth.items() if v is not None and v != [] and not n.startswith("T_")
    ]


def _row(console: Screen, label: str, *text: str | tuple[str, str]) -> None:
    console.print(Text.assemble("  ", (f"{label:<11}", "bold"), " ", *text), soft_wrap=True)


def _table(view: TableView) -> Table:
    rows = view.rows[:MOST_ROWS]
    columns = view.columns[:MOST_COLUMNS]
    left_out = [
        f"{len(all_of) - len(shown)} more {what}"
        for all_of, shown, what in ((view.rows, rows, "rows"), (view.columns, columns, "columns"))
        if len(all_of) > len(shown)
    ]
    rest = (
        f"{' and '.join(left_out)}; `pomona runs export RUN --to frames` writes all"
        if left_out
        else None
    )
    table = Table(
        title=view.caption or None, title_justify="left", caption=rest, caption_justify="left", box=None,
        padding=(0, 2, 0, 0),
    )  # fmt: skip
    for column in columns:
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(*row[:MOST_COLUMNS])
    return table
