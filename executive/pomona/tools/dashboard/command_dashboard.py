"""`pomona dashboard`: the page for recorded runs, from which new ones can be started."""

from __future__ import annotations

import argparse
import contextlib
import threading
from pathlib import Path
from typing import Any, Protocol

from pomona.executive.commands.command_line import add_records_folder
from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import default_name
from pomona.executive.judging import judge
from pomona.executive.language.check import read_document
from pomona.executive.recording.folder import in_order, records_in
from pomona.executive.registry import Registry
from pomona.executive.run_views import OperatorDesk, RunView, RunViews
from pomona.executive.running.events import Event
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import Starting
from pomona.executive.speed import SpeedRefusedError, speed_of
from pomona.executive.terminal.screen import Screen
from pomona.tools.dashboard.apart import PageProcess
from pomona.tools.dashboard.approvals import find_request
from pomona.tools.dashboard.choices import Choices, StartRun
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError
from pomona.tools.dashboard.options import add_address, make_access
from pomona.tools.dashboard.run_view import PageView


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "dashboard", help="serve the operator's page: recorded runs, and new ones"
    )
    add_records_folder(parser)
    parser.add_argument(
        "--tree",
        action="append",
        default=[],
        metavar="FILE",
        help="offer this tree in addition to the installed ones",
    )
    parser.add_argument(
        "--cell",
        action="append",
        default=[],
        metavar="FILE",
        help="offer this cell in addition to the installed ones",
    )
    add_address(parser)
    views = RunViews([view for view in RunViews.installed() if not isinstance(view, PageView)])
    views.add(parser)
    parser.set_defaults(main=lambda options: main(options, views))


CLOSING = 4.0  # seconds for which the next start waits until the last run's cell is closed


class PageOfRuns(Protocol):
    """The page, in this process or in another."""

    control: ControlLock

    def on_event(self, event: Event) -> None:
        """Take one event of a run."""


class Launcher:
    """Starts runs for the page, one at a time, each in a thread of its own."""

    def __init__(
        self,
        dashboard: PageOfRuns,
        record: Path,
        choices: Choices,
        views: RunViews | None = None,
    ) -> None:
        self._dashboard = dashboard
        self._record = record
        self._choices = choices
        self._views = views
        self._thread: threading.Thread | None = None
        self._starting: Starting | None = None
        self._one_start = threading.Lock()

    def start(self, form: dict[str, Any]) -> str:
        """Begin to prepare the run that the page's form describes; the lock reports the progress.

        Raises:
            RefusedError: one is running, or the safe state of the last one is latched.
            UsageError: the tree, cell or settings cannot be used.
        """
        with (
            self._one_start
        ):  # two pages, or a page and ROS 2, at once: the second sees the thread of the first
            return self._start_alone(form)

    def _start_alone(self, form: dict[str, Any]) -> str:
        if self._thread is not None and not self._dashboard.control.is_busy:
            self._thread.join(
                CLOSING
            )  # the last run has ended, its record and its cell are being closed
        if self._thread is not None and self._thread.is_alive():
            latched = (
                self._dashboard.control.runner is not None
                and self._dashboard.control.runner.latched
            )
            raise RefusedError(
                f"reset the safe state first: {latched}" if latched else "a run is going on"
            )
        order = self._order(form)
        lock = self._dashboard.control
        self._starting = starting = lock.prepare(order.tree.stem)

        views = self._views

        def run() -> None:
            problem = "the preparation failed: the terminal shows the error"
            try:
                execute(
                    order,
                    [self._dashboard.on_event] if views is None else views.listeners,
                    on_ready=lock.serve,
                    on_latched=Runner.hold_latched,
                    starting=starting,
                    readers=() if views is None else views.readers,
                )
                problem = ""
            except PomonaError as error:
                problem = str(error)
            finally:
                lock.clear(problem)

        self._thread = threading.Thread(target=run, name="pomona-run")
        self._thread.start()
        return order.tree.stem

    def judge(self, form: dict[str, Any]) -> dict[str, str]:
        """Return the settings of the page's form that cannot be used, with reasons; empty while a run is active.

        Raises UsageError: the tree or the cell is not offered, or the tree cannot be read.
        """
        if self._dashboard.control.is_busy:  # judging takes the interpreter for up to a second
            return {}
        settings = form.get("settings")
        if not isinstance(settings, dict) or not all(
            isinstance(value, str) for value in settings.values()
        ):
            raise UsageError("settings are texts by name")
        document = read_document(self._choices.tree(form.get("tree")))
        judged = judge(
            document, Registry.installed(), settings, self._choices.cell(form.get("cell"))
        )
        problems: dict[str, str] = {}
        for finding in judged.findings.sorted():
            name = finding.path.removeprefix("--set ").partition("=")[0]
            if (
                finding.severity == "error"
                and name in settings
                and finding.path.startswith("--set ")
            ):
                problems.setdefault(name, f"{finding.message}. {finding.hint}".removesuffix(". "))
        return problems

    def close(self) -> None:
        """End an active run in the safe state, and wait for its end."""
        if self._starting is not None and self._thread is not None and self._thread.is_alive():
            self._starting.abandon("the dashboard was ended")
        while self._thread is not None and self._thread.is_alive():
            with contextlib.suppress(
                KeyboardInterrupt
            ):  # it ends in the safe state, and that takes seconds at most
                self._thread.join()

    def _order(self, form: dict[str, Any]) -> RunOrder:
        seed = form.get("seed", 0)
        settings = form.get("settings", {})
        if not isinstance(seed, int) or isinstance(seed, bool):
            raise UsageError("the seed must be a whole number")
        if not isinstance(settings, dict) or not all(
            isinstance(value, str) for value in settings.values()
        ):
            raise UsageError("settings are texts by name")
        try:
            speed = speed_of(str(form.get("speed", "100 %")))
        except SpeedRefusedError as error:
            raise UsageError(str(error)) from None
        after = form.get("after")
        records = in_order(
            (path.parent for path in records_in(self._record)), lambda record: record.name
        )
        if after and [record.name for record in records[-1:]] != [after]:
            raise RefusedError(f"another run has begun since {after}: look at its state first")
        dry = form.get("dry") is True
        after_cut = form.get("after_cut", "")
        if (
            "request" in form
        ):  # what it asks for is what the page has shown, and nothing of the form
            asked = find_request(self._record.resolve(), form["request"], form.get("version"))
            tree = asked.tree
            cell = asked.cell
            seed = asked.seed
            settings = dict(asked.settings)
        else:
            tree = self._choices.tree(form.get("tree"))
            cell = self._choices.cell(form.get("cell", default_name("cell")))
        return RunOrder(
            tree=tree,
            cell=cell,
            seed=seed,
            settings=settings,
            real_time=form.get("pace", "real") == "real",
            record=self._record,
            dry=dry,
            attended=True,
            speed=speed,
            recover=after_cut == "recover",
            cleared=after_cut == "cleared",
        )


class _Page(RunView):
    """The page beside the other views: these find its desk."""

    def __init__(self, page: PageProcess, start: StartRun) -> None:
        self.on_event = page.on_event  # type: ignore[method-assign]
        self.desk = OperatorDesk(page.control, page.access.token, page.access.acts_with, start)


def main(options: argparse.Namespace, views: RunViews) -> int:
    """Serve until Ctrl-C."""
    console = Screen()
    dashboard = PageProcess(make_access(options), options.record)
    choices = Choices.installed(options.tree, options.cell)
    launcher = Launcher(dashboard, options.record, choices, views)
    views.opened.append(_Page(dashboard, launcher.start))
    with views.open(options, console, options.record):
        dashboard.allow_starts(launcher.start, choices, launcher.judge)
        dashboard.start()
        console.print(f"dashboard: {dashboard.access.link}   (Ctrl-C ends it)", soft_wrap=True)
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            launcher.close()
        finally:
            dashboard.close()
    return 0
