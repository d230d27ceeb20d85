"""Other ways in which a fruit may stand than the one that the detector saw."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skills.geometry import rotation_about
from skills.refine.support_plane import Plane

Float64 = NDArray[np.float64]

_ASIDE = np.radians(45.0)


def other_starts(T_camera_object: Float64, support: Plane | None) -> list[Float64]:
    """Poses to start a fit from where the detected one leads nowhere: the place is kept, the stem's axis is not.

    A nearly round fruit's axis is what a detector is wrong about, by half a turn (calyx for stem) or by much: beyond
    what a fit of the shape recovers from. On a support fruit stands upright or upside down; elsewhere the stem may
    point anywhere, and 45 degrees to each side of both ends are tried.
    """
    x, y = T_camera_object[:3, 0], T_camera_object[:3, 1]
    stems = [y]
    if support is not None:
        stems = [support.normal, -support.normal, y]
    else:
        aside = (x, -x, T_camera_object[:3, 2], -T_camera_object[:3, 2])
        stems += [np.sin(_ASIDE) * a + turn * np.cos(_ASIDE) * y for turn in (-1.0, 1.0) for a in aside]
    return [_with_stem(T_camera_object, stem) for stem in stems]


def _with_stem(T_camera_object: Float64, stem: Float64) -> Float64:
    """The pose turned by the shortest way until the stem (the object's -y) points along a unit vector."""
    now = -T_camera_object[:3, 1]
    axis = np.cross(now, stem)
    sine = float(np.linalg.norm(axis))
    if sine > 1e-9:
        axis = axis / sine
    else:  # along it already, or half a turn away from it
        axis, sine = T_camera_object[:3, 0], 0.0
    result = T_camera_object.copy()
    result[:3, :3] = rotation_about(axis, float(np.arctan2(sine, now @ stem))) @ T_camera_object[:3, :3]
    return result
