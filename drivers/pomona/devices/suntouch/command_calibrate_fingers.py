"""`pomona calibrate fingers`: a finger's network from recorded voltages and wrenches."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pomona.executive import Whole


def add(kinds: Any) -> None:
    """Register `fingers` among the kinds of `pomona calibrate`."""
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
    fingers.set_defaults(calibrate=_fingers)


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
