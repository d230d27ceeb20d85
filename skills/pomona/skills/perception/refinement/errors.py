"""Errors of the measurement of a fruit in a depth image.

RefineError           carries the skill's failure code; the attributes are its data
├── BadDepth            NO_DEPTH: not a depth image of this camera
│   └── DepthNotInMetres  every value is about a thousand times too large
├── BadMesh             RENDER_FAILED: empty, flat or not finite
├── BadPose             RENDER_FAILED: not a rigid transform
├── NoDepth             NO_DEPTH
├── TooFewInliers       TOO_FEW_INLIERS
├── SizeOutOfRange      SIZE_OUT_OF_RANGE
├── AtBound             AT_BOUND
├── NotItsShape         NOT_ITS_SHAPE
└── RenderFailed        RENDER_FAILED
"""

from __future__ import annotations

from typing import ClassVar


class RefineError(Exception):
    """Root of this package's errors: no measurement, and never a wrong one instead."""

    code: ClassVar[str]


class BadDepth(RefineError):
    """The array is not a depth image of this camera."""

    code = "NO_DEPTH"


class DepthNotInMetres(BadDepth):
    """The depth image is in another unit, most likely millimetres."""

    def __init__(self, median_depth: float, expected_depth: float) -> None:
        self.median_depth = median_depth
        self.expected_depth = expected_depth
        super().__init__(
            f"the depth is {median_depth:.0f} where the detection gives {expected_depth:.2f} m: "
            "the image is in millimetres; divide it by 1000"
        )


class BadMesh(RefineError):
    """The mesh is none of a body."""

    code = "RENDER_FAILED"


class BadPose(RefineError):
    """The pose is not a rigid transform with finite values."""

    code = "RENDER_FAILED"


class NoDepth(RefineError):
    """Too few of the model's pixels hold a measurement."""

    code = "NO_DEPTH"

    def __init__(self, valid_pixels: int, model_pixels: int) -> None:
        self.valid_pixels = valid_pixels
        self.model_pixels = model_pixels
        super().__init__(
            f"only {valid_pixels} of the fruit's {model_pixels} pixels hold depth: "
            "look from farther away, or check the depth camera"
        )


class TooFewInliers(RefineError):
    """Too few of the measurements agree with the fruit's shape at any size."""

    code = "TOO_FEW_INLIERS"

    def __init__(self, inlier_ratio: float, needed_ratio: float) -> None:
        self.inlier_ratio = inlier_ratio
        self.needed_ratio = needed_ratio
        super().__init__(
            f"only {inlier_ratio:.0%} of the depth agrees with the fruit's shape, {needed_ratio:.0%} are needed: "
            "it is hidden, or the detection is wrong"
        )


class SizeOutOfRange(RefineError):
    """The measured size cannot be that of the fruit."""

    code = "SIZE_OUT_OF_RANGE"

    def __init__(self, ratio: float, lower: float, upper: float) -> None:
        self.ratio = ratio
        self.lower = lower
        self.upper = upper
        super().__init__(
            f"the fruit would have {ratio:.2f} of the model's size, outside {lower:.2f} to {upper:.2f}: "
            "the detection is probably of something else"
        )


class NotItsShape(RefineError):
    """The surface that agrees with the model is flat in a direction in which the fruit is round: a wall, a post, a
    leaf.
    """

    code = "NOT_ITS_SHAPE"

    def __init__(self, curvature: float, needed: float) -> None:
        self.curvature = curvature
        self.needed = needed
        super().__init__(
            f"the surface there has {max(curvature, 0.0):.2f} of the fruit's curvature in one direction, "
            f"{needed:.2f} is needed: it is a wall, a post or a leaf, or it hides the fruit"
        )


class AtBound(RefineError):
    """The best displacement lies on or beyond the bounds of the search: no optimum was found inside."""

    code = "AT_BOUND"

    def __init__(self, sigma: float, bound: float) -> None:
        self.sigma = sigma
        self.bound = bound
        super().__init__(
            f"the depth moves the fruit by {-sigma:+.3f} m, the search ends at {bound:.3f} m: "
            "the detection does not belong to this depth"
        )


class RenderFailed(RefineError):
    """The model gives no virtual depth in this camera, or the renderer does not work."""

    code = "RENDER_FAILED"
