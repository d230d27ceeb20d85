"""`pomona dashboard`: the page for recorded runs, from which new ones can be started."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path
from typing import Any

from rich.console import Console

from executive.dashboard.desk import RefusedError
from executive.dashboard.security import Access
from executive.dashboard.server import Dashboard
from executive.errors import PomonaError, UsageError
from executive.execute import RunOrder, execute
from executive.files import find_cell, find_tree


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("dashboard", help="serve the operator's page: recorded runs, and new ones")
    parser.add_argument(
        "--record", type=Path, default=Path("runs"), metavar="DIR", help="folder of records (default: runs)"
    )
    add_address(parser)
    parser.set_defaults(main=main)


def add_address(parser: argparse.ArgumentParser) -> None:
    """The options of everything that serves the page."""
    parser.add_argument("--port", type=int, default=8420, help="port of the page (default: 8420)")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument(
        "--insecure-act", action="store_true", help="with another --host: let the page act although it is not encrypted"
    )


def make_access(options: argparse.Namespace) -> Access:
    """The rules for an address: another one than this machine's may only watch, unless that is asked for."""
    local = options.host in ("127.0.0.1", "localhost", "::1")
    return Access(options.host, options.port, may_act=local or options.insecure_act)


class Launcher:
    """Starts runs for the page, one at a time, each in a thread of its own."""

    def __init__(self, dashboard: Dashboard, record: Path) -> None:
        self._dashboard, self._record = dashboard, record
        self._thread: threading.Thread | None = None

    def start(self, form: dict[str, Any]) -> str:
        """Start the run that the page's form describes.

        Raises:
            RefusedError: one is running.
            UsageError: the tree, cell or settings cannot be used.
        """
        if self._thread is not None and self._thread.is_alive():
            raise RefusedError("a run is going on; stop it first")
        settings = {str(k): str(v) for k, v in dict(form.get("settings") or {}).items()}
        seed = form.get("seed", 0)
        if not isinstance(seed, int):
            raise UsageError("the seed is a whole number")
        order = RunOrder(
            tree=find_tree(str(form.get("tree", ""))),
            cell=find_cell(str(form.get("cell", "sim"))),
            seed=seed,
            settings=settings,
            real_time=form.get("pace", "real") == "real",
            record=self._record,
        )
        ready = threading.Event()
        problem: list[PomonaError] = []

        def run() -> None:
            def on_ready(runner: Any) -> None:
                self._dashboard.desk.serve(runner)
                ready.set()

            try:
                execute(order, [self._dashboard.hub.hear], on_ready=on_ready)
            except PomonaError as error:
                problem.append(error)
            finally:
                self._dashboard.desk.serve(None)
                ready.set()

        self._thread = threading.Thread(target=run, name="pomona-run")
        self._thread.start()
        ready.wait(120.0)
        if problem:
            raise problem[0]
        return str(order.tree)


def main(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C.

    Returns:
        the exit status.
    """
    console = Console()
    dashboard = Dashboard(make_access(options), options.record)
    launcher = Launcher(dashboard, options.record)
    dashboard.allow_starts(launcher.start)
    dashboard.start()
    console.print(f"dashboard: {dashboard.link}   (Ctrl-C ends it)", highlight=False)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        runner = dashboard.desk.runner
        if runner is not None:
            runner.safe_stop("the dashboard was ended")
    finally:
        dashboard.close()
    return 0
