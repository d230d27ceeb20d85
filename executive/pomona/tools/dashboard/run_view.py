"""The operator's page as a view of `pomona run`."""

from __future__ import annotations

import argparse
import contextlib
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pomona.executive.errors import UsageError
from pomona.executive.language.built import BuiltTree
from pomona.executive.language.changes import Around, Takeover
from pomona.executive.run_views import Export, OperatorDesk, RunView, ViewedRun
from pomona.executive.running.events import Event
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import Starting
from pomona.executive.terminal.screen import in_browser
from pomona.tools.dashboard.options import add_address, make_access

if TYPE_CHECKING:
    from pomona.executive.terminal.screen import Screen
    from pomona.tools.dashboard.apart import PageProcess

WAITING = 0.05  # time between two looks for a page [s]


class PageView(RunView):
    """The operator's page of this run."""

    page: PageProcess
    _console: Screen
    _held_open: contextlib.ExitStack

    def add(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "--dashboard",
            action="store_true",
            help="show the run in the browser, too; from a terminal the browser opens, and the page stays until Ctrl-C",
        )
        parser.add_argument(
            "--wait-for-page",
            action="store_true",
            help="with --dashboard: begin when the page is open in a browser",
        )
        add_address(parser)

    def attends(self, options: argparse.Namespace) -> bool:
        if options.wait_for_page and not options.dashboard:
            raise UsageError("--wait-for-page needs --dashboard")
        return bool(options.dashboard)

    def open(self, options: argparse.Namespace, run: ViewedRun) -> bool:
        if not options.dashboard:
            return False
        from pomona.tools.dashboard.apart import PageProcess

        self._console = console = run.console
        with contextlib.ExitStack() as stack:
            self.page = PageProcess(make_access(options), run.records)
            self.page.start()
            stack.callback(self.page.close)
            console.print(f"dashboard: {self.page.access.link}", soft_wrap=True)
            stack.enter_context(in_browser(console, self.page.access.link))
            if options.wait_for_page:
                console.print("The run begins when the page is open.")
                while not self.page.viewers:
                    time.sleep(WAITING)
            self._held_open = stack.pop_all()
        access = self.page.access
        self.desk = OperatorDesk(self.page.control, access.token, access.acts_with)
        return True

    def takeover(
        self, running: BuiltTree, held: str, rebuild: Callable[[Around], BuiltTree]
    ) -> Takeover:
        from pomona.tools.dashboard.takeover import FileTakeover

        return FileTakeover(running, held, rebuild)

    def exports(self) -> Mapping[str, Export]:
        return {".html": _write_page}

    def preparing(self, tree: str) -> Starting:
        return self.page.control.prepare(tree)

    def on_ready(self, runner: Runner) -> None:
        self.page.control.serve(runner)

    def on_event(self, event: Event) -> None:
        self.page.on_event(event)

    def on_latched(self, runner: Runner) -> None:
        """Keep the cell in its safe state while an operator can reset it; Ctrl-C ends that, too."""
        if not self.page.viewers and not sys.stdin.isatty():
            return
        self._console.print(
            f"safe state: {runner.latched}. Reset it on the page, or leave with Ctrl-C.",
            style="red",
        )
        with contextlib.suppress(KeyboardInterrupt):
            runner.hold_latched()

    def ended(self, problem: str) -> None:
        self.page.control.clear(problem)

    def stay(self) -> None:
        self._console.print("the page stays open; Ctrl-C ends it")
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()

    def close(self) -> None:
        self._held_open.close()


def _write_page(
    records: Sequence[Path], file: Path, _options: argparse.Namespace
) -> Mapping[str, str]:
    from pomona.tools.dashboard.pages import write_run

    write_run(records[0], file)
    return {}
