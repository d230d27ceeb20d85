"""ROS 2 as a view of `pomona run`: topics, diagnostics and an operator's requests."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pomona.executive.run_views import Export, RunView, ViewedRun
from pomona.executive.running.events import Event

if TYPE_CHECKING:
    from pomona.tools.exchange.live import Live, Sink


class Ros2RunView(RunView):
    """The run on ROS 2. Requests of nodes go to the control of the page; without a page none is taken."""

    _live: Live

    def exports(self) -> Mapping[str, Export]:
        return {"rosbag2": _export_bag}

    def add(self, parser: argparse.ArgumentParser) -> None:
        about = "speak ROS 2 (rmw_zenoh; default: 127.0.0.1:7447); requests of nodes need the page"
        parser.add_argument("--ros2", nargs="?", const="", metavar="HOST:PORT", help=about)
        which = "version of ROS 2 of the other nodes (default: jazzy, which suits all later ones)"
        parser.add_argument(
            "--ros2-distribution", choices=("humble", "jazzy", "kilted", "lyrical"), help=which
        )

    def open(self, options: argparse.Namespace, run: ViewedRun) -> bool:
        sink = self.sink(options, run)
        if sink is None:
            return False
        from pomona.tools.exchange.live import Live

        self._live = Live(sink)
        return True

    def sink(self, options: argparse.Namespace, run: ViewedRun) -> Sink | None:
        """Return the node that the options ask for, or None. Raises UsageError: it cannot be opened."""
        if options.ros2 is None:
            return None
        from pomona.tools.ros2.bridge import Ros2Bridge
        from pomona.tools.ros2.peer import ADDRESS, Ros2Peer

        peer = Ros2Peer(
            options.ros2 or ADDRESS, insist=True, distribution=options.ros2_distribution or "jazzy"
        )
        desk = next((desk for view in run.opened if (desk := view.desk) is not None), None)
        said = "; requests of nodes need the page (--dashboard)"
        if desk is not None and peer.local:
            said = f"; an operator's requests need the token {desk.token}"
        elif desk is not None:
            said = "; no requests from other machines"
        where = options.ros2 or ADDRESS
        run.console.print(f"ROS 2 (rmw_zenoh) at {where}{said}", soft_wrap=True)
        if desk is None:
            return Ros2Bridge(peer, None, lambda _token: False)
        return Ros2Bridge(peer, desk.control, desk.acts_with, desk.start)

    def on_event(self, event: Event) -> None:
        self._live.on_event(event)

    def read(self, t: float, tick: int, readings: Mapping[str, Mapping[str, Any]]) -> None:
        self._live.read(t, tick, readings)

    def close(self) -> None:
        self._live.close()


def _export_bag(
    records: Sequence[Path], folder: Path, _options: argparse.Namespace
) -> Mapping[str, str]:
    from pomona.tools.ros2.rosbag2 import export_rosbag2

    return export_rosbag2(records[0], folder)
