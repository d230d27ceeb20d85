"""Views of a grasp: the fruit in space, and the chosen grasp over the camera's image."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.views import ImageView, Line2, Mesh3, SceneView
from pomona.skills.geometry import apply, inverse
from pomona.skills.motion.grasp import Grasp, RuledOut
from pomona.skills.perception.measured_fruit import MeasuredFruit

TAKEN = SceneView(
    caption="the fruit was taken from its place"
)  # in the place of a view that draws it where it was


def fruit_mesh(fruit: MeasuredFruit) -> Mesh3:
    """Return the measured fruit in the base frame, with its stem."""
    stem = fruit.fruit.stem
    parts = [_coarse(fruit.fruit.vertices, fruit.fruit.faces)] + (
        [] if stem is None else [(stem.vertices, stem.faces)]
    )
    vertices = np.vstack([part for part, _faces in parts]) * (
        fruit.dimensions / fruit.fruit.dimensions
    )
    faces = np.vstack(
        [parts[0][1], *(part_faces + len(parts[0][0]) for _part, part_faces in parts[1:])]
    )
    return Mesh3(
        np.round(apply(fruit.T_base_fruit, vertices), 4),
        faces.astype(np.int32),
        "measured fruit",
        "object",
    )


def _coarse(vertices: Float64, faces: NDArray[np.integer]) -> tuple[Float64, NDArray[np.integer]]:
    """Return a surface with one vertex in each cell of a grid, and the faces that keep three of them."""
    cell = np.ptp(vertices, axis=0).max() / 10.0
    _cells, number = np.unique(np.round(vertices / cell).astype(int), axis=0, return_inverse=True)
    number = number.reshape(-1)
    sums = np.stack([np.bincount(number, column) for column in vertices.T], axis=1)
    corners = np.sort(number[faces], axis=1)
    kept = (np.diff(corners, axis=1) > 0).all(axis=1)
    return sums / np.bincount(number)[:, None], number[faces[kept]]


def grasp_picture(grasp: Grasp) -> ImageView:
    """Where the fingers will close and the way they come, over the look that the fruit was measured in."""
    fruit = grasp.fruit
    K = fruit.frame.intrinsics.K
    T_camera_base = inverse(fruit.T_base_camera)
    pads = apply(
        grasp.T_base_grasp, np.array([[0.0, side * grasp.width / 2.0, 0.0] for side in (-1.0, 1.0)])
    )
    way = np.array([grasp.T_base_pre_grasp[:3, 3], grasp.T_base_grasp[:3, 3]])
    lines = []
    for points, label in (
        (pads, f"candidate {grasp.index}: the fingers close along this line"),
        (way, "the approach"),
    ):
        p_camera = apply(T_camera_base, points)
        if (p_camera[:, 2] > 0.0).all():
            uv = p_camera @ K.T
            lines.append(Line2(uv[:, :2] / uv[:, 2:], label, "chosen"))
    return ImageView(None, tuple(lines), caption=f"grasp {grasp.index}: {grasp.sentence}")


def summary(ruled_out: Sequence[RuledOut]) -> str:
    """How often which reason came, for a sentence: `30 unreachable, 18 table (left finger …)`."""
    parts = []
    for code, number in Counter(out.code for out in ruled_out).most_common():
        example = next(out.reason for out in ruled_out if out.code == code)
        parts.append(f"{number} {code.lower().replace('_', ' ')} ({example})")
    return ", ".join(parts)
