"""`driver: caliper` in a cell file: the answers when picks show that the camera is not where the cell file has it.

    devices:
      …
      caliper: {driver: caliper, warn: 2 mm, slow: 6 mm, ask: 10 mm, refuse: 20 mm}

It commands nothing. Before a run, `admission.admit` compares the picks of earlier runs with these limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from pomona.drivers.interfaces import Camera, ForceSensor, Gripper
from pomona.drivers.services import ConnectContext
from pomona.executive.cell.cell_file import CellFile
from pomona.executive.cell.device import Device
from pomona.executive.cell.registration import Settings, Surroundings, driver
from pomona.executive.values.kinds import Measure, Number
from pomona.executive.values.sections import Problem, value
from pomona.executive.values.units import LENGTH

LIMITS = ("warn", "slow", "ask", "refuse")  # in the order of their values
_LENGTH = Measure(LENGTH, "0.5 mm", "100 mm")


class Caliper(Device):
    """The pads of the hand, as a measuring device for the camera's place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CaliperOptions:
    """Limits of the distance of fruit from the place that the camera gives."""

    warn: float = value(_LENGTH, "2 mm", "from here on, each run begins with a warning")
    slow: float = value(_LENGTH, "6 mm", "from here on, runs go at `slow_speed`")
    ask: float = value(
        _LENGTH,
        "10 mm",
        "from here on, a run needs `--cleared`: an operator has looked at the camera",
    )
    refuse: float = value(_LENGTH, "20 mm", "from here on, no run begins")
    first_speed: float = value(
        Number(0.1, 1.0),
        "0.1",
        "speed of the arm until picks have shown that fruit lie where the camera sees them",
    )
    slow_speed: float = value(
        Number(0.1, 1.0), "0.3", "speed of the arm relative to the commanded one, beyond `slow`"
    )

    def problems(self) -> Iterator[Problem]:
        for lower, upper in pairwise(LIMITS):
            if getattr(self, lower) > getattr(self, upper):
                words = f"it is {1e3 * getattr(self, upper):g} mm, below '{lower}' of {1e3 * getattr(self, lower):g} mm"
                yield Problem(upper, words, f"the order is {' ≤ '.join(LIMITS)}")

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        for interface, name in (
            (Camera, "camera"),
            (Gripper, "gripper"),
            (ForceSensor, "force finger"),
        ):
            if not any(interface in device.interfaces for device in around.above.values()):
                yield Problem(
                    "driver",
                    f"it needs a {name} above it: touches of each pad are compared with looks",
                )
        if around.has(Caliper):
            yield Problem("driver", "a cell has one caliper, and another one stands above it")


@driver(Caliper, CaliperOptions)
def connect(settings: Settings[CaliperOptions], _context: ConnectContext) -> Caliper:
    """`driver: caliper`"""
    return Caliper(settings.name)


def caliper_of(cell: CellFile) -> Settings[CaliperOptions] | None:
    """Return the section of a cell file, or None where it has none."""
    return next(
        (said for said in cell.section.devices.values() if isinstance(said.values, CaliperOptions)),
        None,
    )


def hand_eye_of(cell: CellFile) -> Path | None:
    """Return the file with the pose of the cell's camera; None where it has none, or more than one."""
    options: list[Any] = [said.values for said in cell.section.devices.values()]
    files: list[Path] = [
        file for file in (getattr(each, "hand_eye", None) for each in options) if file is not None
    ]
    return files[0] if len(files) == 1 else None
