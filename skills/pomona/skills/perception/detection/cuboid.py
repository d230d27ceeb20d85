"""The nine keypoints of a fruit: its cuboid's corners and centre, in either of the vertex orders in use."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray


class CuboidConvention(StrEnum):
    """Vertex orders met in DOPE checkpoints and annotations.

    CAMERA: axes x right, y down, z forward; the order of DOPE's current `cuboid.py`. Pomona's own.
    ROBOT: axes x forward, y left, z up of the mesh, the older exports; DOPE's axes are then (-y, -z, +x).
    """

    CAMERA = "camera"
    ROBOT = "robot"


_SIGNS = np.array(
    [
        (+1, -1, +1),
        (-1, -1, +1),
        (-1, +1, +1),
        (+1, +1, +1),
        (+1, -1, -1),
        (-1, -1, -1),
        (-1, +1, -1),
        (+1, +1, -1),
        (0, 0, 0),
    ],
    dtype=np.float64,
)

R_MESH_DOPE = {
    CuboidConvention.CAMERA: np.eye(3),
    CuboidConvention.ROBOT: np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
}
"""Rotation from DOPE's axes to the mesh's axes, per convention."""


def cuboid_keypoints(
    dimensions: ArrayLike, convention: CuboidConvention = CuboidConvention.CAMERA
) -> NDArray[np.float64]:
    """Return corners 0..7 and the centre 8 of a cuboid in the mesh's frame, (9, 3), in the unit of `dimensions`.

    Args:
        dimensions: extents along the mesh's own x, y, z.
        convention: which axes the vertex order refers to.
    """
    rotation = R_MESH_DOPE[convention]
    keypoints: NDArray[np.float64] = (_SIGNS @ rotation.T) * (0.5 * np.asarray(dimensions, np.float64))
    return keypoints
