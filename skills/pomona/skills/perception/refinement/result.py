"""Result of a refinement, and the limits of accepted ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.refinement.depth_image import DepthImage, ImageBox

Method = Literal["shape", "uniform", "paper"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of accepted measurements."""

    # half-width of the band in which depth agrees with the model [m], where the camera's noise is less
    inlier_band: float = 4e-3
    min_inliers: float = 0.3  # minimum ratio of agreeing measured pixels
    size: tuple[float, float] = (0.4, 1.6)  # least and largest size relative to the model


@dataclass(frozen=True, slots=True, eq=False)
class RefineResult:
    """A fruit's refined pose and size, in the camera frame."""

    T_camera_object: Float64  # pose of the refined shape's cuboid
    dimensions: Float64  # (d_x, d_y, d_z) [m], shape (3,)
    mu: float  # mu, sigma: scale factor and displacement [m] of the uniform fit (the paper's)
    sigma: float
    covariance: Float64  # of (position in the camera frame, dimensions), shape (6, 6) [m²]
    inlier_ratio: float  # ratio of the refined model's measured pixels with agreeing depth
    residual: float  # root mean square of the inliers' depth residuals [m]
    box: ImageBox  # part of the image that the next two cover
    inliers: NDArray[np.bool_]  # pixels that agree, bool, shape `box.shape`
    virtual_depth: DepthImage  # the refined model's z-depth, float32, shape `box.shape` [m]; 0 outside it
    method: str  # the formulation that gave the result: paper, uniform, shape, shape+plane; `+views` with other looks
