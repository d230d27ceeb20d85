"""Views of a grasp: the fruit in space, and the chosen grasp over the camera's image."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from pomona.executive.views import ImageView, Line2, Mesh3
from pomona.skills.geometry import apply, inverse
from pomona.skills.motion.collision.convex import fruit_points
from pomona.skills.motion.grasp import Grasp, RuledOut
from pomona.skills.motion.robot.solids import hull
from pomona.skills.perception.measured_fruit import MeasuredFruit


def fruit_mesh(fruit: MeasuredFruit) -> Mesh3:
    """Return the measured fruit in the base frame."""
    points = fruit_points(fruit)
    # approximate number of vertices of the fruit's shape in a view
    vertices, faces = hull(points[:: max(1, len(points) // 160)])
    return Mesh3(np.round(vertices, 4), faces, "measured fruit", "object")


def grasp_picture(grasp: Grasp) -> ImageView:
    """Where the fingers will close and the way they come, over the look that the fruit was measured in."""
    fruit = grasp.fruit
    K, T_camera_base = fruit.frame.intrinsics.K, inverse(fruit.T_base_camera)
    pads = apply(grasp.T_base_grasp, np.array([[0.0, side * grasp.width / 2.0, 0.0] for side in (-1.0, 1.0)]))
    way = np.array([grasp.T_base_pre_grasp[:3, 3], grasp.T_base_grasp[:3, 3]])
    lines = []
    for points, label in ((pads, f"candidate {grasp.index}: the fingers close along this line"), (way, "the approach")):
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
