"""Calibration of pose covariances: ratio of known poses inside the ellipsoids of detected ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.close_look import OUTLINE_RADIUS, STEM_AXIS
from pomona.skills.perception.detection.instances import Instance
from pomona.tools.training.annotations import AnnotatedObject


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """Errors of one detection's pose in units of its covariance, as squared Mahalanobis distances."""

    across: float  # of the place across the line of sight, two degrees of freedom
    along: float  # of the place along it, one
    place: float  # of the whole place, three
    axis: float  # of the stem axis, two


FREEDOM = {"across": 2, "along": 1, "place": 3, "axis": 2}  # degrees of freedom of each error


def pose_errors(found: Instance, truth: AnnotatedObject) -> PoseErrors | None:
    """Return the errors of a pose; None without a pose.

    The pose is that of a CAD-sized fruit, so the truth is where one would have to be that looks as large.
    """
    T, covariance = found.T_camera_object, found.covariance
    if T is None or covariance is None:
        return None
    off = seen_as_cad_sized(truth) - T[:3, 3]
    place = covariance[3:, 3:]
    # The first column of Q is the line of sight, the others lie across it.
    Q, _ = np.linalg.qr(np.column_stack([T[:3, 3], np.eye(3)]))
    stem, true_stem = T[:3, :3] @ STEM_AXIS, truth.T_camera_object[:3, :3] @ STEM_AXIS
    turn = np.cross(stem, true_stem)
    sine = float(np.linalg.norm(turn))
    turn *= np.arctan2(sine, float(stem @ true_stem)) / max(sine, 1e-12)
    return PoseErrors(
        across=_squared(Q[:, 1:], off, place),
        along=_squared(Q[:, :1], off, place),
        place=_squared(np.eye(3), off, place),
        axis=_squared(np.linalg.svd(stem[None])[2][1:].T, turn, covariance[:3, :3]),
    )


def seen_as_cad_sized(truth: AnnotatedObject) -> Float64:
    """Where a CAD-sized fruit has the outline of this one, (3,) [m]: on the same line of sight."""
    p: Float64 = truth.T_camera_object[:3, 3]
    distance = float(np.linalg.norm(p))
    touching = np.sqrt(max(distance**2 - (truth.scale * OUTLINE_RADIUS) ** 2, 1e-6)) / truth.scale
    return p * (float(np.hypot(touching, OUTLINE_RADIUS)) / distance)


def coverage(errors: Sequence[PoseErrors], key: str, level: float) -> float:
    """Return the share of the truths inside the ellipsoid that should hold `level` of them; NaN without any."""
    if not errors:
        return float("nan")
    bound = chi2.ppf(level, FREEDOM[key])
    return float(np.mean([getattr(error, key) <= bound for error in errors]))


def pose_calibration_table(groups: Mapping[str, Sequence[PoseErrors]]) -> str:
    """Shares of truths inside the ellipsoids of 50 % and 90 % by group of fruit, as Markdown."""
    lines = [
        "| fruit | poses | " + " | ".join(f"{key} 50 % / 90 %" for key in FREEDOM) + " |",
        "|---" * 6 + "|",
    ]
    for name, errors in groups.items():
        cells = (
            f"{coverage(errors, key, 0.5):.2f} / {coverage(errors, key, 0.9):.2f}"
            for key in FREEDOM
        )
        lines.append(f"| {name} | {len(errors)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _squared(basis: Float64, error: Float64, covariance: Float64) -> float:
    """Squared Mahalanobis distance of an error in the subspace of `basis` (3, k)."""
    part = basis.T @ error
    return float(part @ np.linalg.solve(basis.T @ covariance @ basis, part))
