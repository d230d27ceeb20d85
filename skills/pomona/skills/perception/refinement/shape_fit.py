"""Height, widths, place and tilt of a fruit from measured points: beyond one scale for all directions.

The model is stretched along its own axes by three factors, made higher on one side than on the other, tilted about its
two horizontal axes, turned about the third one unless it is about round, and moved, until the measured points lie on
its surface (Gauss-Newton on point-to-plane distances, Tukey's weights, a band that narrows). Priors determine the rest:
the spread of proportions within a kind, the tilt against the detection, the roundness, and, with a known support, that
the fruit stands on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import transform
from pomona.skills.perception.refinement.checks import extents
from pomona.skills.perception.refinement.cloud import Cloud
from pomona.skills.perception.refinement.depth_image import Triangles
from pomona.skills.perception.refinement.form import Form
from pomona.skills.perception.refinement.points_to_surface import PARAMETERS, PlacedForm, Points
from pomona.skills.perception.refinement.shape_steps import ShapePriors, Support, contact, step_until_still
from pomona.skills.perception.refinement.support_plane import Plane
from pomona.skills.perception.refinement.surface import surface_of

_NARROWING = (3.0, 3.0, 2.0, 2.0, 1.5, 1.5)  # the band of the first steps, in final bands

_MAX_STEPS_OF_FEW = 25
_MAX_STEPS = 8
FEW_POINTS = 250
MAX_POINTS = 1000
"""A fit steps with few points first, then with all: most steps only find the way, and noise matters at the end."""


@dataclass(frozen=True, slots=True)
class Priors:
    """Standard deviations of the priors."""

    place: float = 0.01  # of the centre against that of the scaled model, in each direction [m]
    size: float = 0.15  # of the mean of ln stretch against ln mu of the scaled model
    aspect: float = 0.12  # of ln(height / mean width), about `proportion`
    proportion: float = 0.0  # expected ln(height / mean width), relative to the model's
    # of ln(d_x / d_z), relative to a round fruit when the model is nearly round, else to the model's
    roundness: float = 0.03
    lean: float = 0.04  # of the height difference between the sides, relative
    tilt: float = 0.17  # of the stem axis against the detection, about each horizontal axis [rad]
    turn: float = 0.35  # about the stem axis against the detection [rad]; unobservable for a model that is about round
    contact: float = 1e-3  # of the distance between the support and the fruit's lowest point [m]
    texture: float = 5e-4  # of the surface against the stretched model, from patch to patch [m]


RIGID = Priors(aspect=1e-4, roundness=1e-4, lean=1e-4, tilt=1e-4, turn=1e-4)
"""Only the place and one scale for all directions are free."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeFit:
    """A stretched, tilted and moved model."""

    T_camera_object: Float64  # pose of the fruit's cuboid
    stretch: Float64  # dimensions of the cuboid over the model's, shape (3,)
    covariance: Float64  # of (position, ln stretch), shape (6, 6)
    share: float  # share of the given points that support it
    on_support: bool  # whether the contact with the support was used


def fit_shape(
    cloud: Cloud,
    mesh: Triangles,
    T_camera_object: Float64,
    mu: float,
    *,
    support: Plane | None = None,
    band: float = 4e-3,
    priors: Priors | None = None,
    at_most: int = MAX_POINTS,
) -> ShapeFit:
    """Fit the stretched model to measured points, mostly the fruit's; outliers are left out during the fit.

    Args:
        T_camera_object: where to start, with the model scaled by `mu`; the tilt refers to its axis.
        support: the plane that the fruit stands on; used if the fruit turns out to reach it.
        band: half-width of the band about the surface in which points count, at the end [m].
        at_most: number of points that are used.
    """
    priors = priors or Priors()
    samples = surface_of(mesh)
    form = Form.scaled(mesh, mu)
    R, t = T_camera_object[:3, :3].copy(), T_camera_object[:3, 3].copy()
    start = PlacedForm(R, t, form.stretch, form.lean, form.radius)
    placed = PlacedForm(*(part.copy() for part in start))
    expected = _expected(start, form, priors)
    plane = Support(np.zeros(3), 0.0, np.inf)
    steps = np.full(_MAX_STEPS, band)
    bands = np.concatenate([band * np.array(_NARROWING), np.full(_MAX_STEPS_OF_FEW - len(_NARROWING), band)])
    points = _points(cloud.thinned(min(at_most, FEW_POINTS)))
    nearest = np.full(len(points.points), -1)
    H, share = step_until_still(points, samples, placed, nearest, expected, plane, bands)
    if at_most > FEW_POINTS:
        points = _points(cloud.thinned(at_most))
        nearest = np.full(len(points.points), -1)
        H, share = step_until_still(points, samples, placed, nearest, expected, plane, steps)
    on_support = False
    if support is not None:
        deviation = math.hypot(priors.contact, support.deviation)
        plane = Support(np.ascontiguousarray(support.normal), support.offset, deviation)
        gap, row = contact(samples.vertices, placed, plane)
        # Standard deviation of the gap to its support that a fruit which stands on it may seem to have, of its height
        doubt = row @ np.linalg.solve(H, row) + (0.05 * extents(mesh)[1] * mu) ** 2 + support.deviation**2
        on_support = bool(gap**2 <= 9.0 * doubt)
        if on_support:
            H, share = step_until_still(points, samples, placed, nearest, expected, plane, steps)
    picked = np.r_[0:3, 5:8]
    covariance = np.linalg.inv(H)[np.ix_(picked, picked)]
    form = Form(placed.stretch, placed.lean, placed.radius)
    centre, dimensions = form.cuboid(mesh)
    if form.nearly_round:
        # The offset of the cuboid's centre from the axis depends on the fruit's turn, which is unobservable.
        centre[[0, 2]] = form.stretch[[0, 2]] * samples.points[:, [0, 2]].mean(axis=0)
    T_cuboid = transform(placed.R, placed.t + placed.R @ centre)
    return ShapeFit(T_cuboid, dimensions / extents(mesh), covariance, share, on_support)


_LIKENESS = np.zeros((PARAMETERS, PARAMETERS))
"""Prior directions: place 3, tilt 2, size, aspect, roundness, lean 2, turn."""
_LIKENESS[[0, 1, 2, 8, 9, 10], [0, 1, 2, 8, 9, 10]] = 1.0
_LIKENESS[3, 4], _LIKENESS[4, 3] = -1.0, 1.0
_LIKENESS[5, 5:8] = 1.0 / 3.0
_LIKENESS[6, 5:8] = -0.5, 1.0, -0.5
_LIKENESS[7, 5:8] = 1.0, 0.0, -1.0


def _expected(start: PlacedForm, form: Form, priors: Priors) -> ShapePriors:
    turn = RIGID.turn if form.nearly_round else priors.turn
    round_ratio = -math.log(form.radius[0] / form.radius[1]) if form.nearly_round and priors is not RIGID else 0.0
    deviations = [*[priors.place] * 3, *[priors.tilt] * 2, priors.size, priors.aspect, priors.roundness]
    weighted = _LIKENESS / np.array([*deviations, priors.lean, priors.lean, turn])[:, None] ** 2
    likeness = _LIKENESS.T @ weighted
    return ShapePriors(start, weighted, likeness, priors.proportion, round_ratio, priors.texture)


def _points(cloud: Cloud) -> Points:
    return Points(*map(np.ascontiguousarray, (cloud.points, cloud.rays, cloud.deviation, cloud.beside)))
