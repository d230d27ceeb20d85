"""The sentence of `pomona explain` about the camera: of a run's picks, and of the runs before it in the same folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pomona.executive.errors import UsageError
from pomona.tools.caliper.estimate import CameraErrors, estimate
from pomona.tools.caliper.findings import find_error, next_picks
from pomona.tools.caliper.pick import Pick
from pomona.tools.caliper.records import MOST_RUNS, Picks, read_back, records_before
from pomona.tools.caliper.sizes import fused_width

MOST_LISTED = 6  # widths that a sentence lists one by one


def explain(record: Path) -> str:
    """Return a sentence about the camera, or why no pick can be used; empty where no run has a touch.

    Runs of its cell before it are read back to the first of another calibration.
    """
    try:
        read = Picks.of_record(record)
    except UsageError:  # the explanation itself gives the reason
        return ""
    read_back(records_before(record.parent, record.name)[1 - MOST_RUNS :], read)
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
    alone = 1e3 * np.array([pick.across for pick in felt])
    mean = 1e3 * fused[:, 0]
    std = 1e3 * fused[:, 1].max()
    if len(felt) == 1:
        return f"Width of the fruit between the fingers: {mean[0]:.1f} ± {std:.1f} mm (camera alone: {alone[0]:.1f})."
    if len(felt) <= MOST_LISTED:
        widths, camera = (", ".join(f"{width:.1f}" for width in each) for each in (mean, alone))
    else:
        widths = f"{mean.min():.1f} to {mean.max():.1f}"
        camera = f"{np.median(np.abs(alone - mean)):.1f} mm beside, median"
    words = f"{widths} mm, each ± {std:.1f} mm (camera alone: {camera})"
    return f"Widths of {len(felt)} fruit between the fingers: {words}."
