"""`pomona calibrate from-picks`: corrected values of a cell's calibration, proposed from recorded picks."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.commands.command_line import add_records_folder
from pomona.executive.errors import UsageError
from pomona.executive.files import write_text
from pomona.executive.recording.folder import in_order
from pomona.executive.recording.plain_file import refuse_taken
from pomona.tools.caliper.estimate import CameraErrors, estimate, table_left, touch_left
from pomona.tools.caliper.findings import corrected, find_error, has_moved, hidden, is_shown, known
from pomona.tools.caliper.pick import Pick
from pomona.tools.caliper.records import Picks, find_runs, read_back

LEAST_PICKS = 6  # fewest picks of a proposal: a third is kept apart
APART = 3  # every third pick is kept apart


class NoProposal(UsageError):
    """Picks from which nothing is proposed."""


def add(kinds: Any) -> None:
    """Register `from-picks` among the kinds of `pomona calibrate`."""
    about = "propose the camera's pose and the depth's scale from recorded picks"
    picks = kinds.add_parser("from-picks", help=about)
    picks.add_argument(
        "runs", nargs="+", metavar="RUN", help="names or paths of records, or folders of records"
    )
    picks.add_argument(
        "--out",
        type=Path,
        required=True,
        help="the file to write; a camera's `hand_eye` may name it",
    )
    add_records_folder(picks)
    picks.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Propose. Raises UsageError: the runs cannot be used, nothing is proposed, or the file is there already."""
    refuse_taken(options.out)
    read = read_back(in_order(find_runs(options.runs, options.record), lambda run: run.name))
    content, lines = propose(read)
    write_text(json.dumps(content, indent=1), options.out)
    sys.stdout.write(
        "\n".join([*lines, f"written to {options.out}; nothing of the cell has changed"]) + "\n"
    )
    return 0


def propose(read: Picks) -> tuple[dict[str, Any], list[str]]:
    """Return the content of a calibration file, and a report line by line.

    Raises NoProposal: too few picks, or those kept apart do not get better.
    """
    refused = [f"not used: {reason}" for reason in (*read.refused, *read.left_out)]
    if len(read.picks) < LEAST_PICKS:
        words = f"usable picks: {len(read.picks)}, in runs: {len(read.runs)}; needed are {LEAST_PICKS} picks"
        raise NoProposal("\n  ".join([words, *refused]))
    apart = read.picks[APART - 1 :: APART]
    rest = [pick for i, pick in enumerate(read.picks) if i % APART != APART - 1]
    learnt = estimate(rest)
    before = _left(apart, np.zeros(8))
    after = _left(apart, learnt.error)
    found = estimate(read.picks)
    finding = find_error(found)
    if finding.moved or has_moved(read.picks):
        raise NoProposal(f"{finding.sentence} It has moved since: name the runs after that")
    if not is_shown(found):
        raise NoProposal(
            f"{finding.sentence} No interval leaves zero out: the cell's calibration is left as it is"
        )
    gain = f"off by {1e3 * before:.2f} mm before, {1e3 * after:.2f} after"
    compared = f"{len(apart)} picks kept apart: {_compared(apart)} {gain}"
    if not after < before:
        raise NoProposal(f"{finding.sentence} {compared}: the cell's calibration is left as it is")
    lines = [
        finding.sentence,
        f"{compared} (median)",
        *_values(found),
        f"known: {', '.join(known(found)) or 'nothing'}",
        *hidden(found),
        *(
            f"left out: {name}: a fruit that was pushed, slipped or leant"
            for name in found.left_out
        ),
        *refused,
    ]
    return _content(read, found, len(apart), before, after), lines


def _left(picks: Sequence[Pick], error: Any) -> float:
    """Return the median remainder of the first touches, else of the table, after an error [m]."""
    left = np.array([(touch_left(pick, error), table_left(pick, error)) for pick in picks])
    column = next((c for c in left.T if np.isfinite(c).any()), np.zeros(1))
    return float(np.median(np.abs(column[np.isfinite(column)])))


def _compared(picks: Sequence[Pick]) -> str:
    """Return the name of the values that `_left` compares."""
    return "first touch" if any(pick.side for pick in picks) else "table"


def _values(found: CameraErrors) -> list[str]:
    e = found.error
    s = found.std
    metres = ", ".join(f"{1e3 * e[i]:+.1f} ± {1e3 * s[i]:.1f}" for i in range(3))
    angles = ", ".join(f"{np.degrees(e[i]):+.2f} ± {np.degrees(s[i]):.2f}" for i in range(3, 6))
    return [
        f"camera   x, y, z in its own frame {metres} mm; about them {angles}°",
        f"depth    too short by {1e2 * e[6]:+.2f} ± {1e2 * s[6]:.2f} %",
        f"fingers  widths less the camera's {1e3 * e[7]:+.2f} ± {1e3 * s[7]:.2f} mm",
        f"scatter  {found.scatter:.2f} of the assumed one",
    ]


def _content(
    read: Picks, found: CameraErrors, apart: int, before: float, after: float
) -> dict[str, Any]:
    T_mount_camera = found.used[0].T_mount_camera
    return {
        "T_mount_camera": corrected(found, T_mount_camera).tolist(),
        "T_mount_camera_with_depth_corrected": corrected(
            found, T_mount_camera, with_depth=True
        ).tolist(),
        "T_mount_camera_before": T_mount_camera.tolist(),
        "depth_scale": round(
            -float(found.error[6]), 6
        ),  # as a depth model has it: positive where depth is too long
        "wider_than_camera_mm": round(1e3 * float(found.error[7]), 4),
        "error": found.error.tolist(),
        "covariance": found.covariance.tolist(),
        "known": list(known(found)),
        "not_known": list(hidden(found)),
        "cell": read.cell,
        "runs": list(read.runs),
        "picks": len(found.used),
        "kept_apart": {
            "picks": apart,
            "before_mm": round(1e3 * before, 3),
            "after_mm": round(1e3 * after, 3),
        },
    }
