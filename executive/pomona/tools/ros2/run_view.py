"""ROS 2 as a view of `pomona run`: topics, diagnostics and an operator's requests."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pomona.executive.run_views import Export, ViewedRun
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import Starting
from pomona.tools.dashboard.options import make_access
from pomona.tools.dashboard.run_view import PageView
from pomona.tools.exchange.run_view import SinkView

if TYPE_CHECKING:
    from pomona.executive.terminal.screen import Screen
    from pomona.tools.dashboard.control_lock import ControlLock
    from pomona.tools.dashboard.security import Access
    from pomona.tools.exchange.live import Sink
    from pomona.tools.ros2.bridge import Ros2Bridge


def add_ros2(parser: argparse.ArgumentParser) -> None:
    """Add the option for the ROS 2 interface of a run."""
    about = "speak ROS 2 (rmw_zenoh; default: 127.0.0.1:7447)"
    parser.add_argument("--ros2", nargs="?", const="", metavar="HOST:PORT", help=about)
    which = "version of ROS 2 of the other nodes (default: jazzy, which suits all later ones)"
    parser.add_argument(
        "--ros2-distribution", choices=("humble", "jazzy", "kilted", "lyrical"), help=which
    )


def open_bridge(
    options: argparse.Namespace,
    console: Screen,
    access: Access,
    control: ControlLock,
    start: Callable[[dict[str, Any]], str] | None = None,
) -> Ros2Bridge:
    """Return the bridge that `--ros2` asks for.

    Raises UsageError: the extra is not installed, or the address cannot be used.
    """
    from pomona.tools.ros2.bridge import Ros2Bridge
    from pomona.tools.ros2.peer import ADDRESS, Ros2Peer

    peer = Ros2Peer(
        options.ros2 or ADDRESS, insist=True, distribution=options.ros2_distribution or "jazzy"
    )
    says = (
        f"; an operator's requests need the token {access.token}"
        if peer.local
        else "; no requests from other machines"
    )
    console.print(f"ROS 2 (rmw_zenoh) at {options.ros2 or ADDRESS}{says}", soft_wrap=True)
    return Ros2Bridge(peer, control, access.acts_with, start)


class Ros2RunView(SinkView):
    """The run on ROS 2. It shares the page's control if there is a page; else it has its own."""

    _own: ControlLock | None = None

    def exports(self) -> Mapping[str, Export]:
        return {"rosbag2": _export_bag}

    def add(self, parser: argparse.ArgumentParser) -> None:
        add_ros2(parser)

    def sink(self, options: argparse.Namespace, run: ViewedRun) -> Sink | None:
        if options.ros2 is None:
            return None
        page = next((view.page for view in run.opened if isinstance(view, PageView)), None)
        if page is not None:
            return open_bridge(options, run.console, page.access, page.control)
        from pomona.tools.dashboard.control_lock import ControlLock

        self._own = ControlLock()
        return open_bridge(options, run.console, make_access(options), self._own)

    def preparing(self, tree: str) -> Starting | None:
        return None if self._own is None else self._own.prepare(tree)

    def on_ready(self, runner: Runner) -> None:
        if self._own is not None:
            self._own.serve(runner)

    def ended(self, problem: str) -> None:
        if self._own is not None:
            self._own.clear()


def _export_bag(
    records: Sequence[Path], folder: Path, _options: argparse.Namespace
) -> Mapping[str, str]:
    from pomona.tools.ros2.rosbag2 import export_rosbag2

    return export_rosbag2(records[0], folder)
