"""The export of records for LeRobot."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from pomona.executive.run_views import Export, RunView


class LerobotView(RunView):
    """Records for LeRobot."""

    def exports(self) -> Mapping[str, Export]:
        return {"lerobot": _export_lerobot}


def _export_lerobot(
    records: Sequence[Path], folder: Path, options: argparse.Namespace
) -> Mapping[str, str]:
    from pomona.tools.exchange.lerobot import RATE, export_lerobot

    return export_lerobot(records, folder, options.rate or RATE, options.task)
