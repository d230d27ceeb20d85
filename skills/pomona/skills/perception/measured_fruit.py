"""Result of Refine: a fruit's refined position and size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pomona.drivers.interfaces import Frame
from pomona.executive.values.arrays import Float64
from pomona.executive.values.units import LENGTH, RATIO, Array
from pomona.skills.perception.fruit.catalogue import FruitModel, mass_of

Pose = Annotated[Float64, Array(4, 4)]


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredFruit:
    """A fruit's refined pose and size."""

    fruit: FruitModel  # the CAD model; its vertices scaled by `dimensions / fruit.dimensions` are the refined shape
    T_base_fruit: Pose  # pose of the refined shape's cuboid in the base frame (object axes: x right, y down, z forward)
    T_base_camera: Pose  # pose of the camera at the look
    dimensions: Annotated[
        Float64, Array(3, of=LENGTH)
    ]  # (d_x, d_y, d_z) [m], shape (3,); d_y is the height
    mu: Annotated[
        float, RATIO
    ]  # mu, sigma: the paper's scale factor and displacement [m] of the uniform fit
    sigma: Annotated[float, LENGTH]
    covariance: Annotated[
        Float64, Array(6, 6)
    ]  # of (position in the base frame [m], dimensions [m]), shape (6, 6)
    # ratio of the model's measured pixels with agreeing depth; 0 for an unrefined detection
    inlier_ratio: Annotated[float, RATIO]
    residual: Annotated[float, LENGTH]  # root mean square of the inliers' depth residuals [m]
    contour: Float64  # outline of the refined shape in the image, shape (n, 2) [px]
    frame: Frame  # the look that was measured
    # which formulation gave the result: none, paper, uniform, shape, shape+plane, and `+views` where earlier looks were
    # fused in
    method: str
    earlier: tuple[
        tuple[Frame, Float64], ...
    ] = ()  # those looks: frames with the pose of the camera, T_base_camera
    # contradiction between the fruit's surroundings and the cell file, for the operator; empty without one
    doubt: str = ""
    beside: tuple[MeasuredFruit, ...] = ()  # other fruit of the same look

    @property
    def mass(self) -> tuple[float, float] | None:
        """Mass by the size, and its standard deviation [kg]; None for a kind without weighed fruit."""
        return mass_of(self.fruit, self.dimensions, self.covariance[3:, 3:])

    @property
    def sentence(self) -> str:
        """Description for the operator."""
        size = " × ".join(f"{d * 1e3:.1f}" for d in self.dimensions)
        spread = float(np.sqrt(np.clip(np.diag(self.covariance)[:3], 0.0, None).max()))
        return (
            f"{size} mm   (scale {self.mu:.3f}, {self.method})   position ± {spread * 1e3:.1f} mm"
        )

    @property
    def facts(self) -> Mapping[str, object]:
        """For reports: position in the base frame [m], dimensions [m], the uniform fit, and how well it fits."""
        return {
            "position_m": self.T_base_fruit[:3, 3],
            "dimensions_m": self.dimensions,
            "mu": self.mu,
            "sigma_m": self.sigma,
            "inlier_ratio": self.inlier_ratio,
            "residual_m": self.residual,
            "method": self.method,
        }
