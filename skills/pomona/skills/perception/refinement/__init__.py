"""Refine: where a detected fruit truly is and how large it truly is, from depth."""

from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.perception.refinement.cloud import Plane, horizontal_plane
from pomona.skills.perception.refinement.measure import refine
from pomona.skills.perception.refinement.render import (
    DepthLook,
    ImageBox,
    Limits,
    RefineResult,
    render_depth,
)
from pomona.skills.perception.refinement.scale_fit import FruitContext, ScaleFit, fit_scale
from pomona.skills.perception.refinement.shape_fit import Priors

__all__ = [
    "DepthLook",
    "FruitContext",
    "ImageBox",
    "Limits",
    "MeasuredFruit",
    "Plane",
    "Priors",
    "RefineResult",
    "ScaleFit",
    "fit_scale",
    "horizontal_plane",
    "refine",
    "render_depth",
]
