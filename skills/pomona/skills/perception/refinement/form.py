"""How one fruit differs from its model: stretched along the model's axes, one shoulder higher than the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.refinement.checks import extents
from pomona.skills.perception.refinement.depth_image import Triangles

_NEARLY_ROUND = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """(x, y, z) of the model -> (s_x x, s_y y (1 + l_x x/r_x + l_z z/r_z), s_z z), r half the model's widths."""

    stretch: Float64  # factors s along the axes, shape (3,)
    lean: Float64  # l, by how much the height differs at the sides, towards x and towards z, shape (2,)
    radius: Float64  # r, shape (2,) [m]

    @classmethod
    def scaled(cls, mesh: Triangles, mu: float) -> Form:
        """Return the model's own form at another size."""
        return cls(np.full(3, mu), np.zeros(2), 0.5 * extents(mesh)[[0, 2]])

    @property
    def nearly_round(self) -> bool:
        """Whether the model is nearly a body of revolution, so that its turn about the axis is unobservable."""
        return bool(abs(np.log(self.radius[0] / self.radius[1])) < _NEARLY_ROUND)

    def height_factor(self, model: Float64) -> Float64:
        """1 + l_x x/r_x + l_z z/r_z at points of the model, shape (n, 3) -> (n,)."""
        factor: Float64 = 1.0 + (model[:, [0, 2]] / self.radius) @ self.lean
        return factor

    def points(self, model: Float64) -> Float64:
        """Where points of the model are on the fruit, shape (n, 3) [m]."""
        leaned = model.copy()
        leaned[:, 1] *= self.height_factor(model)
        return leaned * self.stretch

    def cuboid(self, mesh: Triangles) -> tuple[Float64, Float64]:
        """Centre and dimensions of the fruit's cuboid in the model's axes, shape (3,) each [m]."""
        x, y, z = np.ascontiguousarray(mesh.vertices.T)
        a, b = self.lean / self.radius
        leaned = (x, y * (1.0 + a * x + b * z), z)
        low = self.stretch * [float(axis.min()) for axis in leaned]
        high = self.stretch * [float(axis.max()) for axis in leaned]
        return 0.5 * (low + high), high - low
