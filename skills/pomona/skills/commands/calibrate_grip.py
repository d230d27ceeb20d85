"""`pomona calibrate grip`: friction and stiffness of a grip from pushes, recorded or made at a cell now."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pomona.drivers.errors import DriverError
from pomona.drivers.interfaces import ForceSensor, Gripper, Hands, HandTask
from pomona.executive.cell.connect import load_cell
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.kinds import Measure
from pomona.executive.values.units import FORCE, TIME
from pomona.skills.grip.calibration import (
    Push,
    calibrate_grip,
    read_recording,
    write_calibration,
    write_pushes,
)
from pomona.skills.grip.errors import GripError, GuidanceEnded
from pomona.skills.grip.guided import GuidedPushes
from pomona.skills.grip.limit_surface import SoftContact

GRASP_FORCE = Measure(FORCE, "0.6 N", "15 N")  # at which pushes may be made


def add(kinds: Any) -> None:
    """Register `grip` among the kinds of `pomona calibrate`."""
    grip = kinds.add_parser("grip", help="estimate friction and stiffness of a grip from recorded or guided pushes")
    grip.add_argument("recording", type=Path, nargs="?", help=".npz of pushes; without it they are recorded at --cell")
    grip.add_argument("--cell", help="cell file, or the name of an installed cell, for guided pushes")
    grip.add_argument("--out", type=Path, required=True, help="the parameter file to write")
    grip.add_argument("--fruit", default="", help="name of the fruit, for the report")
    about = "grasp forces (2N 4N 7N)"
    grip.add_argument(
        "--forces", type=GRASP_FORCE.option, nargs="+", default=[2.0, 4.0, 7.0], metavar="FORCE", help=about
    )
    long = Measure(TIME, "100 ms", "2 min")
    grip.add_argument("--time", type=long.option, default=6.0, help="time for one push (6s)")
    grip.add_argument("--keep", type=Path, help="also write the recorded pushes to this .npz file")
    grip.add_argument("--k", type=float, default=4.0, help="exponent k of the pressure distribution; not estimated (4)")
    grip.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Calibrate; returns 0, or 2 when the pushes cannot be used."""
    try:
        for file in filter(None, (options.out, options.keep)):
            if file.exists():
                raise ValueError(f"{file} is there already: name another file")
        start = SoftContact(k=options.k)
        pushes, squeeze = _made_now(options) if options.recording is None else read_recording(options.recording)
        found = calibrate_grip(pushes, squeeze, start)
        write_calibration(found, options.out, options.fruit)
    except (GripError, DriverError, OSError, ValueError) as error:
        sys.stderr.write(f"pomona calibrate grip: {error}\n")
        return 2
    sys.stdout.write(f"{found}\nwritten to {options.out}: put its ports into the tree's SlipAvoidGrasp node\n")
    return 0


def _made_now(options: argparse.Namespace) -> tuple[list[Push], Push | None]:
    forces = sorted(options.forces)
    if options.cell is None:
        raise GuidanceEnded("name a recording of pushes, or --cell to make them now")
    with contextlib.closing(_cell(options.cell)) as cell:
        clock = cell.clock
        wait = clock.advance if clock.simulated else time.sleep
        try:
            gripper, sensor = cell.device(Gripper), cell.device(ForceSensor)
        except KeyError as missing:
            raise GuidanceEnded(str(missing.args[0])) from missing
        guide = GuidedPushes(gripper, sensor, clock.now, wait, _tell, _who_is_asked(cell))
        pushes, squeeze = guide.record(forces, options.time)
    if options.keep is not None:
        write_pushes(pushes, options.keep, squeeze)
    return pushes, squeeze


def _cell(name: str) -> Any:
    """Connect a cell by its file or the name of an installed one."""
    path = Path(name)
    if not path.is_file():
        path = installed_trees() / "cells" / f"{name}.yaml"
    if not path.is_file():
        raise GuidanceEnded(f"no cell '{name}': neither a file nor an installed cell")
    return load_cell(path)


def _tell(sentence: str) -> None:
    sys.stdout.write(f"{sentence}\n")
    sys.stdout.flush()


def _who_is_asked(cell: Any) -> Callable[[str, HandTask], None]:
    """Return a function that asks the hands of a simulated cell if it has some, else the operator at the terminal."""
    if Hands not in cell.interfaces():
        return _ask
    hands = cell.device(Hands)

    def ask(sentence: str, task: HandTask) -> None:
        _tell(f"{sentence} [simulated hands]")
        hands.do(task)

    return ask


def _ask(sentence: str, task: HandTask) -> None:
    try:
        input(f"{sentence} [Enter] ")
    except EOFError:
        raise GuidanceEnded("an operator must read the instructions and press Enter") from None
