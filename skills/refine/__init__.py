"""Refine: where a detected fruit truly is and how large it truly is, from depth."""

from skills.refine.measured_fruit import MeasuredFruit
from skills.refine.refinement import Limits, RefineResult, refine
from skills.refine.render import ImageBox, render_depth
from skills.refine.scale_fit import ScaleFit, fit_scale

__all__ = [
    "ImageBox",
    "Limits",
    "MeasuredFruit",
    "RefineResult",
    "ScaleFit",
    "fit_scale",
    "refine",
    "render_depth",
]
