"""Measured points on and around a fruit, from one or several looks, in one frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import apply
from pomona.skills.perception.refinement.depth_image import ImageBox
from pomona.skills.perception.refinement.depth_look import DepthLook


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points that a depth camera measured."""

    points: Float64  # shape (n, 3) [m]
    rays: Float64  # unit vectors from the camera to them, shape (n, 3)
    # standard deviation along the camera's z axis, shape (n,) [m], enlarged for the common error of neighbours
    deviation: Float64
    beside: Float64  # standard deviation across the ray, of the pixel's ray, shape (n,) [m], enlarged as well
    alike: float  # number of neighbours with a common error, by which both are enlarged
    looks: int = 1  # number of looks that the points are from

    def chosen(self, mask: NDArray[np.bool_]) -> Cloud:
        """Return the part of the points that a mask picks."""
        return replace(
            self,
            points=self.points[mask],
            rays=self.rays[mask],
            deviation=self.deviation[mask],
            beside=self.beside[mask],
        )

    def moved(self, T_a_b: Float64) -> Cloud:
        """Return the same points in another frame."""
        return replace(self, points=apply(T_a_b, self.points), rays=self.rays @ T_a_b[:3, :3].T)

    def thinned(self, at_most: int) -> Cloud:
        """Return every k-th point; the common error of neighbours is then smaller."""
        step = -(-len(self.points) // at_most) if len(self.points) else 1
        gain = np.sqrt(max(1.0, self.alike / step) / self.alike)
        few = slice(None, None, step)
        deviation, beside = self.deviation[few] * gain, self.beside[few] * gain
        return replace(self, points=self.points[few], rays=self.rays[few], deviation=deviation, beside=beside)


def cloud(look: DepthLook, box: ImageBox, mask: NDArray[np.bool_] | None = None) -> Cloud:
    """Return the measured points of a box, or of those pixels of it in `mask`, in the frame of the look's camera."""
    intrinsics, model = look.intrinsics, look.depth_model
    z = look.depth[box.slices].astype(np.float64)
    taken = np.isfinite(z) & (z > 0.0)
    if mask is not None:
        taken &= mask
    rows, columns = np.nonzero(taken)
    z = z[taken]
    points = np.column_stack(
        [
            (columns + box.left - intrinsics.cx) / intrinsics.fx * z,
            (rows + box.top - intrinsics.cy) / intrinsics.fy * z,
            z,
        ]
    )
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    shared = np.sqrt(model.alike)
    deviation, beside = model.deviation(z, intrinsics.fx), model.beside(z, intrinsics.fx)
    return Cloud(points, rays, shared * deviation, shared * beside, model.alike)


def together(clouds: list[Cloud]) -> Cloud:
    """Return all points of several clouds that are in one frame."""
    return Cloud(
        np.concatenate([c.points for c in clouds]),
        np.concatenate([c.rays for c in clouds]),
        np.concatenate([c.deviation for c in clouds]),
        np.concatenate([c.beside for c in clouds]),
        max(c.alike for c in clouds),
        sum(c.looks for c in clouds),
    )
