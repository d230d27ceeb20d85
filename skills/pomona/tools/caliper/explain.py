"""The sentence of `pomona explain` about the camera: of a run's picks, and of the runs before it in the same folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import in_order, records_in
from pomona.tools.caliper.estimate import CameraErrors, estimate
from pomona.tools.caliper.findings import find_error, next_picks
from pomona.tools.caliper.pick import Pick
from pomona.tools.caliper.records import OtherCalibration, OtherCell, Picks
from pomona.tools.caliper.sizes import fused_width

MOST_LISTED = 6  # widths that a sentence lists one by one
MOST_RUNS = 30  # runs that are looked at, this one included


def explain(record: Path) -> str:
    """Return a sentence about the camera, or why no pick can be used; empty where no run has a touch.

    Runs of its cell before it are read back to the first of another calibration.
    """
    beside = {path.parent for path in records_in(record.parent)}
    read = read_back(record, in_order(beside, lambda run: run.name))
    if not read.picks:
        return (
            f"No word about the camera: {read.refused[0].partition(': ')[2]}."
            if read.refused
            else ""
        )
    found = estimate(read.picks)
    own = [pick for pick in read.picks if pick.name.startswith(f"{record.name} ")]
    return " ".join(
        filter(None, (find_error(found).sentence, next_picks(found), describe_widths(own, found)))
    )


def describe_widths(picks: Sequence[Pick], found: CameraErrors) -> str:
    """Return a sentence with the widths of fruit that both pads felt, fused with the camera's; or an empty text."""
    felt = [pick for pick in picks if np.isfinite(pick.wider)]
    if not felt:
        return ""
    fused = np.array([fused_width(pick, found) for pick in felt])
    alone, mean, std = (
        1e3 * np.array([pick.across for pick in felt]),
        1e3 * fused[:, 0],
        1e3 * fused[:, 1].max(),
    )
    if len(felt) == 1:
        return f"Width of the fruit between the fingers: {mean[0]:.1f} ± {std:.1f} mm (camera alone: {alone[0]:.1f})."
    if len(felt) <= MOST_LISTED:
        widths, camera = (", ".join(f"{width:.1f}" for width in each) for each in (mean, alone))
    else:
        widths = f"{mean.min():.1f} to {mean.max():.1f}"
        camera = f"{np.median(np.abs(alone - mean)):.1f} mm beside, median"
    words = f"{widths} mm, each ± {std:.1f} mm (camera alone: {camera})"
    return f"Widths of {len(felt)} fruit between the fingers: {words}."


def read_back(record: Path, ordered: Sequence[Path]) -> Picks:
    """Return the picks of a record and of those before it, back to the first of another calibration.

    Args:
        record: the newest one.
        ordered: records in the order of time.

    Raises UsageError: the newest record cannot be trusted.
    """
    read = Picks()
    read.add(record)
    before = ordered[: ordered.index(record)] if record in ordered else []
    for _ in add_back(read, before):
        pass
    return read


def add_back(read: Picks, ordered: Sequence[Path], *, noted: bool = False) -> Iterator[Path]:
    """Add the picks of earlier records of the cell, the newest first, back to another calibration; yield each record.

    Args:
        read: has the newest picks, or none.
        ordered: records in the order of time.
        noted: leave out records whose touches are not noted beside them: to look for them takes a second for each.
    """
    for run in ordered[:-MOST_RUNS:-1]:
        try:
            read.add_noted(run, only=noted)
        except OtherCell:
            continue
        except OtherCalibration:
            break
        except UsageError:
            continue  # its own `explain` gives the reason
        yield run
