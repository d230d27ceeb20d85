"""`pomona run`: a tree file on a cell, watched, recorded and summed up."""

from __future__ import annotations

import argparse
import contextlib
import logging
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pomona.executive.commands.command_line import add_records_folder
from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.execute import Executed, RunOrder, execute
from pomona.executive.files import default_name, find_cell, find_tree
from pomona.executive.language.overrides import parse_settings
from pomona.executive.recording.session import Reader
from pomona.executive.running.events import Listener
from pomona.executive.running.runner import Runner
from pomona.executive.running.signals import Terminated
from pomona.executive.speed import SpeedRefusedError, speed_of
from pomona.executive.terminal.filtered import write_json
from pomona.executive.terminal.keys import Keys
from pomona.executive.terminal.live import LiveTree
from pomona.executive.terminal.screen import Screen, in_browser, stay_open
from pomona.tools.dashboard.apart import PageProcess
from pomona.tools.dashboard.command_alerting import add_alerts, alerts_of, outcomes_in
from pomona.tools.dashboard.command_dashboard import add_address, add_ros2, make_access, open_bridge
from pomona.tools.dashboard.control_lock import ControlLock
from pomona.tools.editor.command_watch import run_on_save

if TYPE_CHECKING:
    from pomona.tools.exchange.live import Live

WAITING = 0.05  # time between two looks for a page [s]

EXIT = {"success": 0, "failure": 1, "stopped": 3, "error": 3}


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("run", help="run a tree file on a cell")
    parser.add_argument("tree", help="a tree file, or the name of an installed tree")
    parser.add_argument("--cell", help="a cell file, or the name of an installed cell (default: the simulated one)")
    parser.add_argument("--seed", type=int, default=0, help="seed of all random numbers (default: 0)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a parameter of the tree or an option of the cell",
    )
    parser.add_argument(
        "--pace", choices=("fast", "real"), default="fast", help="a simulated cell as fast as possible, or in real time"
    )
    parser.add_argument(
        "--speed",
        default="100 %",
        metavar="SHARE",
        help="speed of the arm relative to the commanded one, 10 %% to 100 %%; the page and ROS 2 change it",
    )
    add_records_folder(parser)
    parser.add_argument("--no-record", action="store_true", help="leave no record")
    parser.add_argument(
        "--dry",
        nargs="?",
        const="",
        metavar="MOCKS",
        help="run without a cell: the mocks of a file replace all skills",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    _add_beginnings(parser)
    _add_views(parser)
    parser.add_argument("--watch", action="store_true", help="run again each time the tree file is saved")
    add_alerts(parser)
    add_address(parser)
    parser.set_defaults(main=main)


def _add_beginnings(parser: argparse.ArgumentParser) -> None:
    """Add the options for waiting at the start, and for a start after a run that was cut off."""
    for side in ("before", "after"):
        parser.add_argument(
            f"--break-{side}",
            action="append",
            default=[],
            metavar="NODE",
            help=f"pause {side} this node (its name, type or path); go on from the page, so it needs --dashboard",
        )
    parser.add_argument(
        "--recover",
        action="store_true",
        help="bring the arm home slowly first: after a run that was cut, or that has left something in the gripper",
    )
    parser.add_argument(
        "--cleared",
        action="store_true",
        help="the cell was checked: start although the last run was cut off, or something is in the gripper",
    )


def _add_views(parser: argparse.ArgumentParser) -> None:
    """Where a run is shown while it goes on."""
    parser.add_argument(
        "--dashboard",
        action="store_true",
        help="show the run in the browser, too; from a terminal the browser opens, and the page stays until Ctrl-C",
    )
    parser.add_argument(
        "--wait-for-page", action="store_true", help="with --dashboard: begin when the page is open in a browser"
    )
    parser.add_argument(
        "--foxglove", nargs="?", const=0, type=int, metavar="PORT", help="show the run in Foxglove (default port: 8765)"
    )
    parser.add_argument(
        "--rerun", nargs="?", const="", metavar="FILE.rrd", help="show the run in Rerun, or write its file"
    )
    add_ros2(parser)


def main(options: argparse.Namespace) -> int:
    """Run the tree."""
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
    console = Screen(stderr=options.json, quiet=options.quiet)
    order = RunOrder(
        tree=find_tree(options.tree),
        cell=find_cell(options.cell or default_name("cell")),
        seed=options.seed,
        settings=parse_settings(options.set),
        real_time=options.pace == "real",
        record=None if options.no_record else options.record,
        past=options.record,
        dry=options.dry is not None,
        mocks=Path(options.dry) if options.dry else None,
        recover=options.recover,
        cleared=options.cleared,
        speed=_speed(options.speed),
        attended=options.dashboard or _answers_here(options, console),
        breaks=(
            *((name, "before") for name in options.break_before),
            *((name, "after") for name in options.break_after),
        ),
    )
    if options.wait_for_page and not options.dashboard:
        raise UsageError("--wait-for-page needs --dashboard")
    if order.breaks and not order.attended:
        raise UsageError("without an operator no run resumes after a breakpoint: add --dashboard")
    alerts = alerts_of(options, outcomes_in(options.record, options.alert_over) if options.alert_to else ())
    with contextlib.ExitStack() as stack:
        if alerts is not None:
            stack.callback(alerts.wait)
        dashboard = _serve(options, console, stack) if options.dashboard else None
        live_views, control = _live_views(options, console, dashboard, stack)

        def run() -> int:
            counting = [] if alerts is None else [alerts.on_event]
            executed = _run_once(options, order, dashboard, live_views, control, console, counting)
            if executed.signal not in (None, signal.SIGINT) and (options.watch or dashboard is not None):
                raise Terminated(executed.signal)  # it was meant for the whole process, not for this run
            return 130 if executed.result.interrupted else EXIT[executed.result.outcome]

        status = run_on_save(order.tree, order.settings, run, console) if options.watch else run()
        if dashboard is not None and sys.stdin.isatty() and not options.quiet:
            stay_open(console)
    return status


def _speed(text: str) -> float:
    try:
        return speed_of(text)
    except SpeedRefusedError as error:
        raise UsageError(f"--speed: {error}") from None


def _answers_here(options: argparse.Namespace, console: Screen) -> bool:
    """Return True if an operator at this terminal answers questions and resumes after breakpoints."""
    return not (options.dashboard or options.quiet or options.json) and console.is_terminal and sys.stdin.isatty()


def _run_once(
    options: argparse.Namespace,
    order: RunOrder,
    dashboard: PageProcess | None,
    views: Live | None,
    control: ControlLock | None,
    console: Screen,
    counting: Sequence[Listener] = (),
) -> Executed:
    with contextlib.closing(LiveTree(console)) as live:
        listeners = [live.on_event, *counting] if views is None else [live.on_event, *counting, views.on_event]
        readers = [] if views is None else [views.read]
        if _answers_here(options, console):
            with contextlib.closing(Keys(console, sys.stdin)) as keys:
                heard, ready = [*listeners, keys.on_event], keys.serve
                executed = execute(order, heard, on_ready=ready, starting=live.starting(), readers=readers)
        elif dashboard is None and control is None:
            executed = execute(order, listeners, starting=live.starting(), readers=readers)
        else:
            executed = _execute(order, listeners, readers, dashboard, control, console)
    with contextlib.suppress(OSError):  # the reader is gone: the exit status still has the result
        executed.summary.print(console, executed.record)
        if executed.problem:
            console.print(executed.problem, style="red")
        if options.quiet:
            failed = executed.result.outcome != "success"
            for line in filter(None, (executed.summary.sentence() if failed else "", executed.problem)):
                Screen(stderr=True).print(line, soft_wrap=True)
        if options.json:
            write_json(executed.summary.as_json(executed.record))
            sys.stdout.flush()
    return executed


def _serve(options: argparse.Namespace, console: Screen, stack: contextlib.ExitStack) -> PageProcess:
    dashboard = PageProcess(make_access(options), options.record)
    dashboard.start()
    stack.callback(dashboard.close)
    console.print(f"dashboard: {dashboard.access.link}", soft_wrap=True)
    stack.enter_context(in_browser(console, dashboard.access.link))
    if options.wait_for_page:
        console.print("The run begins when the page is open.")
        while not dashboard.viewers:
            time.sleep(WAITING)
    return dashboard


def _live_views(
    options: argparse.Namespace, console: Screen, dashboard: PageProcess | None, stack: contextlib.ExitStack
) -> tuple[Live | None, ControlLock | None]:
    """Return the requested viewers of the run, and their controls; other viewers are not imported."""
    if options.foxglove is None and options.rerun is None and options.ros2 is None:
        return None, None
    from pomona.tools.exchange.live import Live, Sink

    sinks: list[Sink] = []
    if options.foxglove is not None:
        from pomona.tools.exchange.foxglove_view import PORT, FoxgloveView

        view = FoxgloveView(options.foxglove or PORT)
        console.print(f"Foxglove: open a connection to {view.link}", soft_wrap=True)
        sinks.append(view)
    if options.rerun is not None:
        from pomona.tools.exchange.rerun_view import VIEWER, RerunView

        sinks.append(RerunView(options.rerun or VIEWER))
    control = None
    if options.ros2 is not None:
        control = ControlLock() if dashboard is None else dashboard.control
        access = make_access(options) if dashboard is None else dashboard.access
        sinks.append(open_bridge(options, console, access, control))
    views = Live(sinks)
    stack.callback(views.close)
    return views, control


def _execute(
    order: RunOrder,
    listeners: Sequence[Listener],
    readers: Sequence[Reader],
    dashboard: PageProcess | None,
    control: ControlLock | None,
    console: Screen,
) -> Executed:
    if dashboard is None:
        assert control is not None
        starting = control.prepare(order.tree.stem)
        try:
            return execute(order, listeners, on_ready=control.serve, starting=starting, readers=readers)
        finally:
            control.clear()
    lock, problem = dashboard.control, ""
    try:
        return execute(
            order,
            [*listeners, dashboard.on_event],
            readers=readers,
            on_ready=lock.serve,
            on_latched=lambda runner: _hold(runner, dashboard, console),
            starting=lock.prepare(order.tree.stem),
        )
    except PomonaError as error:
        problem = str(error)
        raise
    finally:
        lock.clear(problem)


def _hold(runner: Runner, dashboard: PageProcess, console: Screen) -> None:
    """Keep the cell in its safe state while an operator can reset it; Ctrl-C ends that, too."""
    if not dashboard.viewers and not sys.stdin.isatty():
        return
    console.print(f"safe state: {runner.latched}. Reset it on the page, or leave with Ctrl-C.", style="red")
    with contextlib.suppress(KeyboardInterrupt):
        runner.hold_latched()
