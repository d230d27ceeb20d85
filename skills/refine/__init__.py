"""Refine: where a detected fruit truly is and how large it truly is, from depth."""

from skills.refine.gather import Look
from skills.refine.measured_fruit import MeasuredFruit
from skills.refine.refinement import Limits, RefineResult, refine
from skills.refine.render import ImageBox, render_depth
from skills.refine.scale_fit import ScaleFit, fit_scale
from skills.refine.shape_fit import Priors
from skills.refine.support_plane import Plane, horizontal_plane

__all__ = [
    "ImageBox",
    "Limits",
    "Look",
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
