"""Views of a run: pages, live viewers, alerts and remote controls that packages add to `pomona run` by entry point."""

from __future__ import annotations

import argparse
import contextlib
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.executive.cell.cell_file import CellFile
from pomona.executive.errors import PomonaError
from pomona.executive.language.built import BuiltTree
from pomona.executive.language.changes import Around, Takeover
from pomona.executive.recording.session import Reader
from pomona.executive.running.events import Event, Listener
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import Starting
from pomona.executive.terminal.screen import Screen
from pomona.executive.values.installation import entry_points

GROUP = "pomona.run_views"  # entry point group of views of a run: name → class

logger = logging.getLogger(__name__)

Export = Callable[[Sequence[Path], Path, argparse.Namespace], Mapping[str, str]]
"""Writes records to a file or folder, with the command's options; returns the content of each written thing."""


@dataclass(frozen=True, slots=True)
class ViewedRun:
    """The surroundings in which a view is opened.

    Attributes:
        console: for its messages to the operator.
        records: folder of records.
        opened: the views that were opened before it, in the order of their names.
    """

    console: Screen
    records: Path
    opened: Sequence[RunView]


@dataclass(frozen=True, slots=True)
class OperatorDesk:
    """The place at which one operator at a time acts, for views that pass on requests.

    Attributes:
        control: takes the requests.
        token: needed with each request.
        acts_with: returns True if a token may act.
        start: begins the run that a form describes; None where none can be begun.
    """

    control: Any
    token: str
    acts_with: Callable[[str], bool]
    start: Callable[[dict[str, Any]], str] | None = None


class RunView:
    """A view of a run. A subclass overrides the methods that it needs; the defaults do nothing.

    `add` and `attends` are called for each `pomona run`, so import costly modules in `open` only.
    """

    desk: OperatorDesk | None = None  # of an opened view at which operators act
    files: tuple[str, ...] = ()  # names of what it leaves in a run's folder

    def add(self, parser: argparse.ArgumentParser) -> None:
        """Add the view's options to `pomona run`."""

    def attends(self, options: argparse.Namespace) -> bool:
        """Return True if these options bring an operator who answers questions and resumes after breakpoints.

        Raises UsageError: the options contradict each other.
        """
        return False

    def open(self, options: argparse.Namespace, run: ViewedRun) -> bool:
        """Open the view; return False if these options do not ask for it.

        Raises UsageError: it cannot be opened. Nothing is run.
        """
        return False

    def admit(self, order: Any, cell: CellFile) -> Any:
        """Return the `RunOrder` of a run as this package admits it, perhaps slower; also of one that it does not show.

        Raises UsageError: it is refused; nothing has moved.
        """
        return order

    def takeover(
        self, running: BuiltTree, held: str, rebuild: Callable[[Around], BuiltTree]
    ) -> Takeover | None:
        """Return the takeover of the files that `rebuild` reads; None if this package takes none over.

        Args:
            held: path of the node at which a breakpoint holds the tick; empty without one.

        Raises ReloadRefusedError: with file, line and reason of a change that this run cannot take over.
        """
        return None

    def explain(self, record: Path) -> str:
        """Return a sentence about a record, for `pomona explain`; empty for none."""
        return ""

    def exports(self) -> Mapping[str, Export]:
        """Return the exports of records that this package adds to `pomona runs export`: by name, or by suffix."""
        return {}

    def preparing(self, tree: str) -> Starting | None:
        """Return the receiver of the progress of the run's preparation; None if this view shows none."""
        return None

    def on_ready(self, runner: Runner) -> None:
        """Take the runner before its first tick: to pause, stop or step it from another thread."""

    def on_event(self, event: Event) -> None:
        """Take one event, in the tick's thread; must return at once. An exception ends the run in the safe state."""

    def read(self, t: float, tick: int, readings: Mapping[str, Mapping[str, Any]]) -> None:
        """Take the devices' readings of one tick, as a record has them; ten times a second; must return at once."""

    def on_latched(self, runner: Runner) -> None:
        """Take the runner after a run that ended in the safe state, while the cell is connected."""

    def ended(self, problem: str) -> None:
        """Note the end of the run; `problem` is the reason why it did not begin, else empty."""

    def stay(self) -> None:
        """Stay open after a run that no signal to the process has ended, until Ctrl-C."""

    def close(self) -> None:
        """Release everything. Called once for each opened view, in the reverse order."""


class RunViews:
    """The views of one command, in the order of their names."""

    def __init__(self, views: Sequence[RunView]) -> None:
        self._views = views
        self.opened: list[RunView] = []

    @classmethod
    def installed(cls) -> RunViews:
        """Return those of all installed packages; one that cannot be imported is reported and left out."""
        views: list[RunView] = []
        for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
            try:
                views.append(point.load()())
            except Exception as error:  # a foreign module may raise anything when it is imported
                logger.warning(
                    "the view '%s' of %s cannot be used: %s", point.name, point.value, error
                )
        return cls(views)

    def __iter__(self) -> Iterator[RunView]:
        return iter(self._views)

    def add(self, parser: argparse.ArgumentParser) -> None:
        """Add the options of all."""
        for view in self._views:
            view.add(parser)

    def attend(self, options: argparse.Namespace) -> bool:
        """Return True if a view brings an operator. Raises UsageError: options contradict each other."""
        return bool(
            [view for view in self._views if view.attends(options)]
        )  # each judges its options

    @contextlib.contextmanager
    def open(self, options: argparse.Namespace, console: Screen, records: Path) -> Iterator[None]:
        """Open the views that the options ask for; close them at the end. Raises UsageError: one cannot be opened."""
        with contextlib.ExitStack() as stack:
            for view in self._views:
                if view.open(options, ViewedRun(console, records, tuple(self.opened))):
                    self.opened.append(view)
                    stack.callback(view.close)
            yield

    @property
    def listeners(self) -> list[Listener]:
        """Receivers of the run's events."""
        return [view.on_event for view in self.opened]

    @property
    def readers(self) -> list[Reader]:
        """Receivers of the devices' readings: views that take them. Without one nothing is read."""
        return [view.read for view in self.opened if type(view).read is not RunView.read]

    def on_ready(self, runner: Runner) -> None:
        """Hand the runner to each."""
        for view in self.opened:
            view.on_ready(runner)

    def on_latched(self, runner: Runner) -> None:
        """Hand the runner in its safe state to each."""
        for view in self.opened:
            view.on_latched(runner)

    def stay(self) -> None:
        """Let each stay open until Ctrl-C."""
        for view in self.opened:
            view.stay()

    @contextlib.contextmanager
    def run(self, tree: str) -> Iterator[Starting | None]:
        """Follow one run from its preparation to its end; yields the receiver of the preparation's progress."""
        prepared = [
            starting for view in self.opened if (starting := view.preparing(tree)) is not None
        ]
        problem = ""
        try:
            yield prepared[0] if prepared else None
        except PomonaError as error:
            problem = str(error)
            raise
        finally:
            for view in self.opened:
                view.ended(problem)
