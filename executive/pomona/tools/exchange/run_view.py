"""A view of `pomona run` with a sink for the messages of a record, and the export of records for LeRobot."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pomona.executive.run_views import Export, RunView, ViewedRun
from pomona.executive.running.events import Event

if TYPE_CHECKING:
    from pomona.tools.exchange.live import Live, Sink


class SinkView(RunView):
    """A view whose sink gets the messages of a record from a thread of its own; a subclass returns the sink."""

    _live: Live

    def sink(self, options: argparse.Namespace, run: ViewedRun) -> Sink | None:
        """Return the sink that the options ask for, or None. Raises UsageError: it cannot be opened."""
        raise NotImplementedError

    def open(self, options: argparse.Namespace, run: ViewedRun) -> bool:
        sink = self.sink(options, run)
        if sink is None:
            return False
        from pomona.tools.exchange.live import Live

        self._live = Live(sink)
        return True

    def on_event(self, event: Event) -> None:
        self._live.on_event(event)

    def read(self, t: float, tick: int, readings: Mapping[str, Mapping[str, Any]]) -> None:
        self._live.read(t, tick, readings)

    def close(self) -> None:
        self._live.close()


class LerobotView(RunView):
    """Records for LeRobot."""

    def exports(self) -> Mapping[str, Export]:
        return {"lerobot": _export_lerobot}


def _export_lerobot(
    records: Sequence[Path], folder: Path, options: argparse.Namespace
) -> Mapping[str, str]:
    from pomona.tools.exchange.lerobot import RATE, export_lerobot

    return export_lerobot(records, folder, options.rate or RATE, options.task)
