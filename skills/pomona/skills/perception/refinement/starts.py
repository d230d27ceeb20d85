"""Which way the stem points: where the detected axis does not fit the depth well, others are tried."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import rotation_about
from pomona.skills.perception.refinement.depth_image import DepthImage
from pomona.skills.perception.refinement.result import RefineResult
from pomona.skills.perception.refinement.support_plane import Plane

_CLEARLY = 0.02  # minimum additional ratio of the depth that another axis of the stem must explain

_ASPECT_WEIGHT = 0.05
"""Additional ratio of the depth that the axis with less likely proportions must explain, per squared deviation:
upside down a fruit fits its depth nearly as well, but wider and flatter than it is."""

_ASIDE = np.radians(45.0)


def other_starts(T_camera_object: Float64, support: Plane | None) -> list[Float64]:
    """Return other poses (4, 4) to start a fit from if the detected one fails: same place, other axes of the stem. On a
    support fruit stands upright or upside down; elsewhere the stem may point anywhere, and 45 degrees to each side of
    both ends are tried.
    """
    x, y = T_camera_object[:3, 0], T_camera_object[:3, 1]
    stems = [y]
    if support is not None:
        stems = [support.normal, -support.normal, y]
    else:
        aside = (x, -x, T_camera_object[:3, 2], -T_camera_object[:3, 2])
        stems += [np.sin(_ASIDE) * a + turn * np.cos(_ASIDE) * y for turn in (-1.0, 1.0) for a in aside]
    return [_with_stem(T_camera_object, stem) for stem in stems]


def _with_stem(T_camera_object: Float64, stem: Float64) -> Float64:
    """Return the pose turned by the shortest way until the stem (the object's -y) points along a unit vector."""
    now = -T_camera_object[:3, 1]
    axis = np.cross(now, stem)
    sine = float(np.linalg.norm(axis))
    if sine > 1e-9:
        axis = axis / sine
    else:  # along it already, or half a turn away from it
        axis, sine = T_camera_object[:3, 0], 0.0
    result = T_camera_object.copy()
    result[:3, :3] = rotation_about(axis, float(np.arctan2(sine, now @ stem))) @ T_camera_object[:3, :3]
    return result


@dataclass(frozen=True, slots=True, eq=False)
class Judge:
    """Scores how well a fitted model explains the depth."""

    depth: DepthImage  # measured, of the whole image [m]
    band: float  # half-width of the band in which depth agrees [m]
    model: Float64  # dimensions of the model, shape (3,) [m]
    aspect: float  # standard deviation of ln(height / width) among fruit, relative to the model's

    def explained(self, result: RefineResult) -> tuple[int, int]:
        """Return the numbers of explained and of contradicting pixels; pixels of hiding objects count as neither."""
        model, measured = result.virtual_depth, self.depth[result.box.slices]
        valid = (model > 0.0) & np.isfinite(measured) & (measured > 0.0)
        difference = measured[valid] - model[valid]
        agree = np.count_nonzero(np.abs(difference) <= self.band)
        # distance in front of the model from which an object hides it, in bands
        hidden = np.count_nonzero(difference < -5.0 * self.band)
        return int(agree), int(difference.size - agree - hidden)

    def aspect_penalty(self, dimensions: Float64) -> float:
        """How far height over width is from the model's, squared, in standard deviations."""
        wide, model_wide = dimensions[[0, 2]].mean(), self.model[[0, 2]].mean()
        return float((np.log(dimensions[1] * model_wide / (wide * self.model[1])) / self.aspect) ** 2)

    def score(self, result: RefineResult) -> tuple[float, float, bool]:
        """Return explained minus contradicting pixels and oddness; the margin for a better one; and whether it is
        settled.
        """
        agree, differ = self.explained(result)
        penalty = _ASPECT_WEIGHT * self.aspect_penalty(result.dimensions) * agree
        # ratio of agreeing depth from which the detected axis of the stem is accepted
        return agree - differ - penalty, _CLEARLY * agree, agree >= 0.95 * (agree + differ)
