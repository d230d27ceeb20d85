"""`pomona calibrate fingers | hand-eye | …`: calibration files. Others add theirs by entry point `pomona.calibrate`."""

from __future__ import annotations

import argparse
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from drivers.errors import DriverError
from executive.values.kinds import Measure
from executive.values.units import LENGTH

GROUP = "pomona.calibrate"


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("calibrate", help="make calibration files")
    kinds = parser.add_subparsers(metavar="WHAT", required=True)
    fingers = kinds.add_parser("fingers", help="fit a finger's network to recorded voltages and wrenches")
    fingers.add_argument("recording", type=Path, help=".npz with volts and wrenches, or .csv with 31 columns")
    fingers.add_argument("--out", type=Path, required=True, help="the calibration file to write")
    fingers.add_argument("--finger", default="", help="which finger it is: what says left is refused for the right one")
    fingers.add_argument("--hidden", type=int, nargs="+", default=[32], help="sizes of the hidden layers")
    fingers.add_argument("--epochs", type=int, default=300)
    fingers.add_argument("--seed", type=int, default=0)
    fingers.set_defaults(main=lambda options: _guarded(_fingers, options))
    side = Measure(LENGTH, "1 mm", "1 m")
    hand_eye = kinds.add_parser("hand-eye", help="find the camera's place on the flange from looks at a chessboard")
    hand_eye.add_argument("folder", type=Path, help="images, poses.json and intrinsics.yaml")
    hand_eye.add_argument("--board", default="9x6", help="inner corners of the chessboard (default: 9x6)")
    hand_eye.add_argument("--square", type=side.option, required=True, help="side of a square, such as 24.5mm")
    hand_eye.add_argument("--out", type=Path, required=True, help="the file to write")
    hand_eye.set_defaults(main=lambda options: _guarded(_hand_eye, options))
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        entry.load()(kinds)


def _guarded(calibrate: Any, options: argparse.Namespace) -> int:
    try:
        print(calibrate(options))
    except (DriverError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _fingers(options: argparse.Namespace) -> str:
    from drivers.suntouch.fit import fit_calibration, read_recording  # torch: not for every command

    volts, wrenches = read_recording(options.recording)
    calibration, report = fit_calibration(
        volts,
        wrenches,
        options.finger or options.recording.stem,
        hidden=tuple(options.hidden),
        epochs=options.epochs,
        seed=options.seed,
    )
    calibration.save(options.out)
    return f"{report}\nwritten to {options.out}"


def _hand_eye(options: argparse.Namespace) -> str:
    from drivers.hand_eye import Chessboard, UnusableLooks, calibrate_folder

    columns, _, rows = options.board.partition("x")
    if not (columns.isdigit() and rows.isdigit()):
        raise UnusableLooks(f"'{options.board}' is not a board: write the inner corners as 9x6")
    result = calibrate_folder(options.folder, Chessboard(int(columns), int(rows), options.square))
    result.save(options.out)
    return f"{result}\nwritten to {options.out}"
