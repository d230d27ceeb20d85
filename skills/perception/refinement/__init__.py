"""Refine: where a detected fruit truly is and how large it truly is, from depth."""

from skills.perception.measured_fruit import MeasuredFruit
from skills.perception.refinement.depth_image import ImageBox
from skills.perception.refinement.gather import OtherLook
from skills.perception.refinement.refinement import refine
from skills.perception.refinement.render import render_depth
from skills.perception.refinement.result import Limits, RefineResult
from skills.perception.refinement.scale_fit import ScaleFit, fit_scale
from skills.perception.refinement.shape_fit import Priors
from skills.perception.refinement.support_plane import Plane, horizontal_plane

__all__ = [
    "ImageBox",
    "Limits",
    "MeasuredFruit",
    "OtherLook",
    "Plane",
    "Priors",
    "RefineResult",
    "ScaleFit",
    "fit_scale",
    "horizontal_plane",
    "refine",
    "render_depth",
]
