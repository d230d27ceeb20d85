"""`pomona doctor`: look over this machine and a cell before a run."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pomona.executive.values.sentences import ReportLine
from pomona.executive.values.units import LENGTH
from pomona.tools.calibration.machine import examine_machine


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "doctor", help="check this machine and a cell before a run; nothing moves"
    )
    parser.add_argument(
        "--cell", default="sim", help="a cell file, or the name of an installed cell (default: sim)"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="an option of the cell"
    )
    parser.add_argument(
        "--record",
        type=Path,
        default=Path("runs"),
        metavar="DIR",
        help="folder of records (default: runs)",
    )
    parser.add_argument(
        "--gauge",
        type=_width,
        metavar="WIDTH",
        help="of what the pads hold now, as calipers show it: the gripper must report the same opening",
    )
    parser.set_defaults(main=main)


def _width(text: str) -> float:
    from pomona.executive.values.kinds import Measure  # needs a package that the doctor may miss

    return Measure(LENGTH, "0 mm", "1 m").option(text)


def main(options: argparse.Namespace) -> int:
    """Print a line for everything that was looked at.

    Returns:
        0 when all is well, else 1.
    """
    checks = []
    for check in _examined(options):
        print(check, flush=True)  # as it comes: connecting a cell takes a while
        checks.append(check)
    bad = sum(not check.ok for check in checks)
    print(f"\n{bad} of {len(checks)} need attention" if bad else f"\nall {len(checks)} are well")
    return 1 if bad else 0


def _examined(options: argparse.Namespace) -> Iterator[ReportLine]:
    yield from examine_machine(options.record)
    try:
        from pomona.executive.files import find_cell
        from pomona.executive.language.interface import parse_settings
        from pomona.tools.calibration.doctor import examine
    except ImportError as error:
        yield ReportLine("cell", False, f"not examined, since a requirement is missing: {error}")
    else:
        overrides = parse_settings(options.set)
        yield from examine(find_cell(options.cell), overrides, options.record, options.gauge)
