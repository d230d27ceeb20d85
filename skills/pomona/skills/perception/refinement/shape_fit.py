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
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import rotation_about
from pomona.skills.perception.refinement.cloud import Cloud
from pomona.skills.perception.refinement.depth_image import Triangles
from pomona.skills.perception.refinement.form import Form
from pomona.skills.perception.refinement.points_to_surface import (
    PARAMETERS,
    PlacedForm,
    Points,
    Samples,
    points_to_surface,
)
from pomona.skills.perception.refinement.support_plane import Plane
from pomona.skills.perception.refinement.surface import Surface, surface_of

_NARROWING = (3.0, 3.0, 2.0, 2.0, 1.5, 1.5)  # the band of the first steps, in final bands

_MAX_STEPS = 25
_MAX_POINTS = 1000
_MAX_TURN = 0.3
_MAX_STRETCH = 0.2
_MAX_LEAN = 0.05


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


class _Normal:
    """Normal equations H x = b of weighted residuals, x as in `points_to_surface`."""

    def __init__(self, H: Float64, b: Float64) -> None:
        self.H, self.b = H, b

    def expect(self, rows: Float64, values: Float64, deviations: Float64) -> None:
        """Expect rows · x = values, shapes (k, 11) and (k,), each within its standard deviation."""
        weighted = rows / (deviations**2)[:, None]
        self.H = self.H + rows.T @ weighted
        self.b = self.b + values @ weighted

    def solve(self) -> Float64:
        return np.asarray(np.linalg.solve(self.H, self.b), dtype=np.float64)


def fit_shape(
    cloud: Cloud,
    mesh: Triangles,
    T_camera_object: Float64,
    mu: float,
    *,
    support: Plane | None = None,
    band: float = 4e-3,
    priors: Priors | None = None,
) -> ShapeFit:
    """Fit the stretched model to measured points, mostly the fruit's; outliers are left out during the fit.

    Args:
        T_camera_object: where to start, with the model scaled by `mu`; the tilt refers to its axis.
        support: the plane that the fruit stands on; used if the fruit turns out to reach it.
        band: half-width of the band about the surface in which points count, at the end [m].
    """
    priors = priors or Priors()
    measured = _Measured.of(cloud.thinned(_MAX_POINTS), surface_of(mesh), T_camera_object, mu)
    state = _State(T_camera_object.copy(), Form.scaled(mesh, mu))
    start = _State(T_camera_object, state.form)
    equations, share = _iterate(measured, mesh, state, start, band, priors, None, _NARROWING)
    on_support = False
    if support is not None:
        gap, row = _contact(mesh, state, support)
        # Standard deviation of the gap to its support that a fruit which stands on it may seem to have, of its height
        doubt = row @ np.linalg.solve(equations.H, row) + (0.05 * np.ptp(mesh.vertices[:, 1]) * mu) ** 2
        on_support = bool(gap**2 <= 9.0 * doubt)
        if on_support:
            equations, share = _iterate(measured, mesh, state, start, band, priors, support, ())
    picked = np.r_[0:3, 5:8]
    covariance = np.linalg.inv(equations.H)[np.ix_(picked, picked)]
    centre, dimensions = state.form.cuboid(mesh)
    if state.form.nearly_round:
        # The offset of the cuboid's centre from the axis depends on the fruit's turn, which is unobservable.
        centre[[0, 2]] = state.form.stretch[[0, 2]] * surface_of(mesh).samples.points[:, [0, 2]].mean(axis=0)
    T_cuboid = state.T.copy()
    T_cuboid[:3, 3] += T_cuboid[:3, :3] @ centre
    return ShapeFit(T_cuboid, dimensions / np.ptp(mesh.vertices, axis=0), covariance, share, on_support)


@dataclass
class _State:
    T: Float64
    form: Form

    def move(self, step: Float64) -> None:
        turn = step[[3, 10, 4]]
        angle = float(np.linalg.norm(turn))
        if angle > 0.0:
            self.T[:3, :3] = self.T[:3, :3] @ rotation_about(turn / angle, min(angle, _MAX_TURN))
        self.T[:3, 3] += step[:3]
        self.form = self.form.changed(
            np.clip(step[5:8], -_MAX_STRETCH, _MAX_STRETCH), np.clip(step[8:10], -_MAX_LEAN, _MAX_LEAN)
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Measured points, the model's surface, and the sample of it that each point is next to, shape (n,)."""

    points: Points
    samples: Samples
    nearest: NDArray[np.int64]

    @classmethod
    def of(cls, cloud: Cloud, surface: Surface, T_camera_object: Float64, mu: float) -> _Measured:
        on_model = (cloud.points - T_camera_object[:3, 3]) @ T_camera_object[:3, :3] / mu
        points = Points(*map(np.ascontiguousarray, (cloud.points, cloud.rays, cloud.deviation, cloud.beside)))
        return cls(points, surface.samples, surface.tree.query(on_model)[1])

    def equations(self, state: _State, reach: float, texture: float) -> tuple[_Normal, float]:
        """Of the points that lie within reach of the surface, and the share of these points."""
        R, t, form = np.ascontiguousarray(state.T[:3, :3]), state.T[:3, 3].copy(), state.form
        placed = PlacedForm(R, t, form.stretch, form.lean, form.radius)
        # number of independently deviating parts of the visible surface: a lobe or a dent is some 10 mm wide
        H, b, share = points_to_surface(self.points, self.samples, placed, self.nearest, reach, texture, 80)
        return _Normal(H, b), share


def _iterate(
    measured: _Measured,
    mesh: Triangles,
    state: _State,
    start: _State,
    band: float,
    priors: Priors,
    support: Plane | None,
    narrowing: tuple[float, ...],
) -> tuple[_Normal, float]:
    """Step until nothing moves; changes `state`. Returns the last equations and the share of points that count."""
    for count in range(_MAX_STEPS):
        reach = band * (narrowing[count] if count < len(narrowing) else 1.0)
        equations, share = measured.equations(state, reach, priors.texture)
        _expect_likeness(equations, state, start, priors)
        if support is not None:
            gap, row = _contact(mesh, state, support)
            equations.expect(row[None], np.array([-gap]), np.array([priors.contact]))
        step = equations.solve()
        state.move(step)
        if count >= len(narrowing) and np.abs(step[:3]).max() < 5e-5 and np.abs(step[3:]).max() < 5e-4:
            break
    return equations, share


_LIKENESS = np.zeros((11, PARAMETERS))  # prior directions: place 3, tilt 2, size, aspect, roundness, lean 2, turn
_LIKENESS[[0, 1, 2, 8, 9, 10], [0, 1, 2, 8, 9, 10]] = 1.0
_LIKENESS[3, 4], _LIKENESS[4, 3] = -1.0, 1.0
_LIKENESS[5, 5:8] = 1.0 / 3.0
_LIKENESS[6, 5:8] = -0.5, 1.0, -0.5
_LIKENESS[7, 5:8] = 1.0, 0.0, -1.0


def _expect_likeness(equations: _Normal, state: _State, start: _State, priors: Priors) -> None:
    """Add the priors of the kind, of the detection and of the uniform scale."""
    axis = state.T[:3, :3].T @ start.T[:3, 1]  # the detected axis as the present object sees it; (0, 1, 0) if alike
    ln_x, ln_y, ln_z = np.log(state.form.stretch / start.form.stretch)
    model_ratio = float(np.log(state.form.radius[0] / state.form.radius[1]))
    round_ratio = -model_ratio if state.form.nearly_round and priors is not RIGID else 0.0
    facing = state.T[:3, :3].T @ start.T[:3, 0]
    values = np.empty(11)
    values[:3] = start.T[:3, 3] - state.T[:3, 3]
    values[3:5] = axis[0], axis[2]
    values[5] = -(ln_x + ln_y + ln_z) / 3.0
    values[6] = priors.proportion - ln_y + 0.5 * (ln_x + ln_z)
    values[7] = round_ratio - (ln_x - ln_z)
    values[8:10] = -state.form.lean
    values[10] = math.atan2(-facing[2], facing[0])
    deviations = np.empty(11)
    deviations[:3], deviations[3:5] = priors.place, priors.tilt
    deviations[5:8] = priors.size, priors.aspect, priors.roundness
    deviations[8:10] = priors.lean
    deviations[10] = RIGID.turn if state.form.nearly_round else priors.turn
    equations.expect(_LIKENESS, values, deviations)


def _contact(mesh: Triangles, state: _State, support: Plane) -> tuple[float, Float64]:
    """Return the height of the lowest point over the support [m], and how it changes with the parameters."""
    R, t = state.T[:3, :3], state.T[:3, 3]
    up = R.T @ support.normal
    on_fruit = state.form.points(mesh.vertices)
    index = int(np.argmin(on_fruit @ up))
    lowest = on_fruit[index]
    gap = float(support.normal @ (R @ lowest + t) + support.offset)
    leaning = up[1] * state.form.lean_derivative(mesh.vertices[index : index + 1])[0]
    x, y, z = np.cross(lowest, up)
    return gap, np.concatenate([support.normal, [x, z], up * lowest, leaning, [y]])
