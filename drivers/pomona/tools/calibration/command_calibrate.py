"""`pomona calibrate fingers | hand-eye | …`: calibration files. Others add theirs by entry point `pomona.calibrate`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pomona.drivers.depth_model import SENSORS
from pomona.drivers.errors import DriverError
from pomona.executive.errors import UsageError
from pomona.executive.values.installation import entry_points
from pomona.executive.values.kinds import Measure, Whole
from pomona.executive.values.units import LENGTH

GROUP = "pomona.calibrate"


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("calibrate", help="make calibration files")
    kinds = parser.add_subparsers(metavar="KIND", required=True)
    fingers = kinds.add_parser(
        "fingers", help="fit a finger's network to recorded voltages and wrenches"
    )
    fingers.add_argument(
        "recording", type=Path, help=".npz with volts and wrenches, or .csv with 31 columns"
    )
    fingers.add_argument("--out", type=Path, required=True, help="the calibration file to write")
    fingers.add_argument(
        "--finger",
        default="",
        help="name of the finger; the calibration of a left finger is refused for the right one",
    )
    fingers.add_argument(
        "--hidden", type=Whole(1).option, nargs="+", default=[32], help="sizes of the hidden layers"
    )
    fingers.add_argument("--epochs", type=Whole(1).option, default=300)
    fingers.add_argument("--seed", type=Whole(0).option, default=0)
    fingers.set_defaults(main=lambda options: _guarded(_fingers, options))
    side = Measure(LENGTH, "1 mm", "1 m")
    hand_eye = kinds.add_parser(
        "hand-eye", help="estimate the camera's pose on the flange from images of a chessboard"
    )
    hand_eye.add_argument("folder", type=Path, help="images, poses.json and intrinsics.yaml")
    hand_eye.add_argument(
        "--board", default="9x6", help="inner corners of the chessboard (default: 9x6)"
    )
    hand_eye.add_argument(
        "--square", type=side.option, required=True, help="side of a square, such as 24.5mm"
    )
    hand_eye.add_argument("--out", type=Path, required=True, help="the file to write")
    hand_eye.set_defaults(main=lambda options: _guarded(_hand_eye, options))
    depth = kinds.add_parser(
        "depth", help="estimate the depth errors of a camera from balls in recorded frames"
    )
    depth.add_argument(
        "folder", type=Path, help="NAME_color.jpg or .png, NAME_depth_mm.png and intrinsics.yaml"
    )
    depth.add_argument(
        "--balls",
        type=Path,
        required=True,
        help="table (CSV): frame, name, x, y, w, h [px], diameter_mm",
    )
    depth.add_argument(
        "--diameter", default="diameter_mm", metavar="COLUMN", help="column with the diameter in mm"
    )
    depth.add_argument(
        "--only", default="", metavar="BEGIN", help="only the rows whose name begins with BEGIN"
    )
    depth.add_argument(
        "--intrinsics", type=Path, help="intrinsics of the camera, if the folder has no file"
    )
    depth.add_argument(
        "--sensor", default="d4xx", choices=sorted(SENSORS), help="prior model of the sensor (d4xx)"
    )
    depth.add_argument("--out", type=Path, required=True, help="the depth model file to write")
    depth.set_defaults(main=lambda options: _guarded(_depth, options))
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        entry.load()(kinds)


def _guarded(calibrate: Any, options: argparse.Namespace) -> int:
    try:
        if options.out.exists():  # an earlier calibration may be in use, and is costly to repeat
            raise DriverError(f"{options.out} is there already: name another file with --out")
        print(calibrate(options))
    except (DriverError, UsageError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _fingers(options: argparse.Namespace) -> str:
    from pomona.devices.suntouch.fit import fit_calibration, read_recording

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
    from pomona.tools.calibration.hand_eye import Chessboard, UnusableLooks, calibrate_folder

    columns, _, rows = options.board.partition("x")
    if not (columns.isdigit() and rows.isdigit()):
        raise UnusableLooks(f"'{options.board}' is not a board: write the inner corners as 9x6")
    result = calibrate_folder(options.folder, Chessboard(int(columns), int(rows), options.square))
    result.save(options.out)
    return f"{result}\nwritten to {options.out}"


def _depth(options: argparse.Namespace) -> str:
    from pomona.devices.frames.folder import (
        INTRINSICS_FILE,
        folder_intrinsics,
        list_frames,
        read_images,
        read_intrinsics,
    )
    from pomona.tools.calibration.depth_calibration import (
        UnusableDepth,
        calibrate_balls,
        read_balls,
    )

    frames = list_frames(options.folder)
    intrinsics = (
        read_intrinsics(options.intrinsics)
        if options.intrinsics
        else folder_intrinsics(options.folder)
    )
    if intrinsics is None:
        raise UnusableDepth(
            f"the camera's intrinsics are missing: put {INTRINSICS_FILE} into the folder"
        )
    depths = {frame.label: read_images(frame, intrinsics)[1] for frame in frames}
    balls = read_balls(options.balls, options.diameter, options.only)
    found = calibrate_balls(balls, depths, intrinsics, options.sensor)
    found.save(options.out)
    return f"{found}\nwritten to {options.out}; as depth_model.yaml in a folder of frames it holds for these"
