"""`pomona calibrate hand-eye | depth | …`: calibration files.

Others add theirs by entry point `pomona.calibrate`; `calibrate` of its options makes the file, and returns what is
printed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pomona.drivers.depth_model import SENSORS
from pomona.drivers.errors import DriverError
from pomona.executive.errors import UsageError
from pomona.executive.values.installation import entry_points
from pomona.executive.values.kinds import Measure
from pomona.executive.values.units import LENGTH

GROUP = "pomona.calibrate"


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("calibrate", help="make calibration files")
    parser.set_defaults(main=_main)
    kinds = parser.add_subparsers(metavar="KIND", required=True)
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
    hand_eye.set_defaults(calibrate=_hand_eye)
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
    depth.set_defaults(calibrate=_depth)
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        entry.load()(kinds)


def _main(options: argparse.Namespace) -> int:
    try:
        if options.out.exists():  # an earlier calibration may be in use, and is costly to repeat
            raise DriverError(f"{options.out} is there already: name another file with --out")
        print(options.calibrate(options))
    except (DriverError, UsageError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


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
