"""Sentences about an estimate: how far the camera is off, and the directions that no pick has shown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.estimate import SEEN, CameraErrors

FALSE_ALARM = 1e-3  # probability of a report about a camera that is where the cell file has it
LEAST_SHIFT = 1.5e-3  # smallest shift that is reported as an error [m]: the fingers' clearance absorbs less

WAYS = (("right", "left"), ("bottom", "top"), ("far side", "near side"))
"""Directions in the picture: along the camera's axes, and against them."""

HIDDEN = (
    ("place across the picture", "picks whose fingers close across the picture"),
    ("place along the picture's height", "picks whose fingers close along the picture's height"),
    ("place along the view", "picks with tilted grasps, whose fingers do not close square to the view"),
    ("rotation about the picture's horizontal", "looks at fruit from distances that differ by 0.2 m and more"),
    ("rotation about the picture's vertical", "looks at fruit from distances that differ by 0.2 m and more"),
    ("rotation about the view", "fruit at the borders of the picture, with fingers that close along these borders"),
    ("scale of the depth", "fruit of sizes that differ by 20 mm and more"),
    ("zero of the gripper's width", "fruit of sizes that differ by 20 mm and more"),
)
"""Quantities of `CameraErrors.seen`, and the picks that would show each."""


@dataclass(frozen=True, slots=True)
class CameraFinding:
    """How far the camera is off."""

    is_off: bool  # True: farther than chance explains, and far enough to matter
    sentence: str


def find_error(found: CameraErrors) -> CameraFinding:
    """Compare the shift of the fruit with chance, along the directions that picks have shown."""
    shift, covariance = found.shift
    number = f"{len(found.used)} pick{'s' if len(found.used) > 1 else ''}"
    shown = [i for i in range(3) if found.seen[i] < SEEN]
    if not shown:
        return CameraFinding(False, f"The camera's place is not known from {number}: {HIDDEN[0][1]} would show it.")
    part = shift[shown]
    distance = float(part @ np.linalg.solve(covariance[np.ix_(shown, shown)], part))
    std = np.sqrt(np.diag(covariance))
    is_sure = distance > float(chi2.isf(FALSE_ALARM, len(shown)))
    if not (is_sure and np.linalg.norm(part) > LEAST_SHIFT):
        most = 1e3 * float(np.max(np.abs(part) + 2.0 * std[shown]))
        return CameraFinding(False, f"The camera sits where the cell file has it, within {most:.1f} mm ({number}).")
    largest = max(shown, key=lambda i: abs(shift[i]) / std[i])
    terms = [
        f"{1e3 * abs(shift[i]):.1f} ± {1e3 * std[i]:.1f} mm to the {WAYS[i][int(shift[i] < 0.0)]}"
        for i in shown
        if i == largest or abs(shift[i]) > max(2.0 * std[i], 0.5e-3)
    ]
    words = (
        f"The camera sits {' and '.join(terms)} of where the cell file has it, or looks as far beside it ({number})."
    )
    return CameraFinding(True, f"{words} Directions are those of its picture.")


def hidden(found: CameraErrors) -> Iterator[str]:
    """Yield a sentence for each quantity that the picks have not shown, with the picks that would."""
    for (quantity, picks), share in zip(HIDDEN, found.seen, strict=True):
        if share >= SEEN:
            yield f"not observed: {quantity}; {picks} would show it"


def corrected(found: CameraErrors, T_mount_camera: Float64) -> Float64:
    """Return the camera's pose in its mount with the error taken out, shape (4, 4); it holds with the depth corrected.

    Args:
        T_mount_camera: the pose of the picks, shape (4, 4).
    """
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(found.error[3:6]).as_matrix()
    T[:3, 3] = found.error[:3]
    pose: Float64 = T_mount_camera @ T
    return pose
