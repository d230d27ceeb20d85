"""The tree with the state of each node, while it runs."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from typing import Any

from rich.live import Live
from rich.text import Text

from pomona.executive.running.events import (
    AttemptEnded,
    Event,
    LinkChanged,
    NodeChanged,
    RunEnded,
    RunStarted,
    SafeStopped,
    StateChanged,
    TickOverran,
    TreeChanged,
)
from pomona.executive.running.starting import Starting, StartingStage
from pomona.executive.terminal.output import visible
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.words import ICONS, STYLES, say, seconds

PATIENCE = 5.0  # preparation time after which a message is printed even where the display cannot be redrawn [s]

BLOCKED = 0.5  # wait within a tick from which it is reported [s]


def did_not_work(overrun: TickOverran) -> bool:
    """Return True if the tick was late though it had little to compute."""
    return overrun.worked is not None and overrun.worked < 0.5 * overrun.duration


class LiveTree:
    """Draws on a terminal; on anything else it prints a line for every leaf that ends."""

    def __init__(self, console: Screen) -> None:
        self._console = console
        self._nodes: tuple[Mapping[str, Any], ...] = ()
        self._names: dict[str, str] = {}
        self._now: dict[str, NodeChanged] = {}
        self._attempts: dict[str, AttemptEnded] = {}
        self._header = self._cell_kind = ""
        self._t = 0.0
        self._drawn = 0.0
        self._live = (
            Live(console=console, auto_refresh=False, transient=True)
            if console.is_terminal
            else None
        )
        self._leaves: set[str] = set()

    def on_event(self, event: Event) -> None:
        """Follow the run."""
        self._t = event.t
        if isinstance(event, (RunStarted, TreeChanged)):
            self._nodes = event.nodes
            self._names = {node["path"]: str(node["name"]) for node in event.nodes}
            self._leaves = self._names.keys() - {node["parent"] for node in event.nodes}
        if isinstance(event, RunStarted):
            self._cell_kind = event.cell_kind
            self._header = _in_one_line(
                f"{event.tree} on {event.cell} ({event.cell_kind}), seed {event.seed}"
            )
            if self._live is not None:
                self._live.start()
        elif isinstance(event, NodeChanged):
            self._now[event.path] = event
            if (
                self._live is None
                and event.path in self._leaves
                and event.status in ("SUCCESS", "FAILURE")
            ):
                detail = say(event.reason) if event.reason else event.feedback
                icon = (
                    "·"
                    if event.reason and event.reason.code == "CONDITION_FALSE"
                    else ICONS[event.status]
                )
                self._console.print(f"{event.t:7.2f} s  {icon} {self._name(event.path)}  {detail}")
        elif isinstance(event, AttemptEnded):
            self._attempts[event.path] = event
        elif isinstance(event, SafeStopped):
            self._console.print(Text.assemble(("■ safe stop:", "bold red"), f" {event.reason}"))
        elif isinstance(event, LinkChanged) and event.state != "ok":
            self._console.print(
                f"{event.t:7.2f} s  ! {event.device}: {event.state}", style="yellow"
            )
        elif (
            isinstance(event, TickOverran)
            and event.duration >= BLOCKED
            and self._is_left_alone(event)
        ):
            who = self._name(event.node) if event.node else "something"
            words = f"{who} kept the tick waiting for {seconds(event.duration)}: no limit could interrupt it"
            if did_not_work(event):
                computed = seconds(event.worked or 0.0)
                words += (
                    f" (it computed for {computed}; the rest it waited, or the computer was busy)"
                )
            self._console.print(f"{event.t:7.2f} s  ! {words}", style="yellow")
        elif (
            isinstance(event, StateChanged)
            and event.state in ("paused", "running")
            and self._live is None
        ):
            self._console.print(f"{event.t:7.2f} s  {event.state}: {event.because}")
        elif isinstance(event, RunEnded):
            self.close()
            return
        self._draw()

    def _is_left_alone(self, late: TickOverran) -> bool:
        """Return whether a late tick leaves something unattended: a simulated world stands still while it waits."""
        return self._cell_kind != "simulated" or not did_not_work(late)

    def starting(self) -> Starting:
        """Return a start whose stages are shown until the run begins: preparation takes up to a minute."""
        starting = Starting(lambda: self._prepare(starting.stage))
        self._drawn = time.monotonic()
        return starting

    def _prepare(self, stage: StartingStage | None) -> None:
        if stage is None:
            return
        of = f", {stage.done + 1} of {stage.of}" if stage.of else ""
        if self._live is None:
            if time.monotonic() - self._drawn > PATIENCE:
                self._drawn = time.monotonic()
                self._console.print(f"{stage.what}{of} …")
            return
        self._live.start()
        self._live.update(
            Text(f"◌ {stage.what}{of} …", no_wrap=True, overflow="ellipsis"), refresh=True
        )

    def close(self) -> None:
        """Leave the terminal as it was. Harmless when closed already."""
        if self._live is not None and self._live.is_started:
            with contextlib.suppress(OSError):  # the terminal is gone
                self._live.stop()

    def _name(self, path: str) -> str:
        return self._names.get(path, path)

    def _draw(self) -> None:
        # seconds between two drawings
        if self._live is None or not self._live.is_started or time.monotonic() - self._drawn < 0.08:
            return
        if (
            self._console.is_behind
        ):  # the terminal is stopped, or slow: it gets the newest state when it goes on
            return
        self._drawn = time.monotonic()
        self._live.update(self._text(), refresh=True)

    def _text(self) -> Text:
        """As many lines as the terminal has, the running node among them."""
        lines, here = self._lines()
        room = max(
            3, self._console.size.height - 2
        )  # without the header and the line of the cursor
        text = Text(
            f"{self._header}   {self._t:.1f} s", style="bold", no_wrap=True, overflow="ellipsis"
        )
        for line in _window(lines, here, room):
            line.truncate(self._console.size.width, overflow="ellipsis")
            text.append("\n").append(line)
        return text

    def _lines(self) -> tuple[list[Text], int]:
        """Return a line for each node, and the index of the one in focus: the last running leaf, or the last change."""
        lines: list[Text] = []
        depth: dict[str | None, int] = {}
        running = None
        changed = 0
        newest = -1
        for number, node in enumerate(self._nodes):
            path = node["path"]
            level = depth.get(node["parent"], -1) + 1
            depth[path] = level
            change = self._now.get(path)
            status = change.status if change else "INVALID"
            if change is not None and path in self._leaves:
                running = number if status == "RUNNING" else running
                if change.tick >= newest:
                    changed = number
                    newest = change.tick
            lines.append(self._line(node, level, change))
        return lines, changed if running is None else running

    def _line(self, node: Mapping[str, Any], level: int, change: NodeChanged | None) -> Text:
        path = node["path"]
        status = change.status if change else "INVALID"
        line = Text("  " * level)
        line.append(
            f"{ICONS.get(status, '?')} {_in_one_line(str(node['name']))}",
            style=STYLES.get(status, ""),
        )
        if path in self._attempts:
            attempt = self._attempts[path]
            number = attempt.number if attempt.succeeded else min(attempt.number + 1, attempt.of)
            line.append(f"  attempt {number} of {attempt.of}", style="yellow")
        if change and change.feedback and path in self._leaves:
            line.append(f"  {_in_one_line(change.feedback)}", style="dim")
        return line


def _in_one_line(text: str) -> str:
    """Join a text into one line, so that a long name or feedback does not push the running node out of sight."""
    return visible(" ".join(text.split()))


def _window(lines: Sequence[Text], here: int, room: int) -> list[Text]:
    """Return as many lines as fit, with `here` among them; markers show the number of omitted lines."""
    if len(lines) <= room:
        return list(lines)
    inside = room - 2
    first = min(max(0, here - 2 * inside // 3), len(lines) - inside)
    above = first
    below = len(lines) - first - inside
    return [
        Text(f"  ⋮ {above} above" if above else "", style="dim"),
        *lines[first : first + inside],
        Text(f"  ⋮ {below} below" if below else "", style="dim"),
    ]
