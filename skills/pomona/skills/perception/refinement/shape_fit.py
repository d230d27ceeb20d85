"""Height, widths, place and tilt of a fruit from measured points: beyond one scale for all directions.

The model is stretched along its own axes by three factors, made higher on one side than on the other, tilted about its
two horizontal axes, turned about the third one unless it is about round, and moved, until the measured points lie on
its surface (Gauss-Newton on point-to-plane distances, Tukey's weights, a band that narrows). Priors determine the rest:
the spread of proportions within a kind, the tilt against the detection, the roundness, and, with a known support, that
the fruit stands on it. The steps are compiled: they come first, `fit_shape` last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.geometry import transform
from pomona.skills.perception.refinement.cloud import Cloud, Plane, Samples, surface_of
from pomona.skills.perception.refinement.render import Triangles, extents

PARAMETERS = 11  # move 3, tilt about x and z, ln stretch 3, lean 2, turn about y


class Points(NamedTuple):
    """Measured points for the kernel: a `Cloud`, arrays of shape (n, 3) or (n,) [m]."""

    points: Float64
    rays: Float64
    deviation: Float64
    beside: Float64


class PlacedForm(NamedTuple):
    """The present object: rotation (3, 3) and place (3,) in the camera's frame; see `Form` for the rest."""

    R: Float64
    t: Float64
    stretch: Float64
    lean: Float64
    radius: Float64


@kernel(nogil=True, error_model="numpy")
def start_of_walk(samples: Samples, x: float, y: float, z: float) -> int:
    """Return the sample that is nearest to the grid's cell of a point of the model's frame."""
    last = len(samples.near) - 1
    i = min(max(int((x - samples.corner[0]) / samples.edges[0]), 0), last)
    j = min(max(int((y - samples.corner[1]) / samples.edges[1]), 0), last)
    k = min(max(int((z - samples.corner[2]) / samples.edges[2]), 0), last)
    start: int = samples.near[i, j, k]
    return start


@kernel(nogil=True, error_model="numpy")
def walk_to_nearest(samples: Samples, x: float, y: float, z: float, start: int) -> int:
    """From neighbour to neighbour while that is nearer to a point of the model's frame."""
    points = samples.points
    neighbours = samples.neighbours
    best = start
    near = (x - points[best, 0]) ** 2 + (y - points[best, 1]) ** 2 + (z - points[best, 2]) ** 2
    while True:
        here = best
        for k in range(neighbours.shape[1]):
            j = neighbours[here, k]
            square = (x - points[j, 0]) ** 2 + (y - points[j, 1]) ** 2 + (z - points[j, 2]) ** 2
            if square < near:
                near = square
                best = j
        if best == here:
            return best


@kernel(nogil=True, error_model="numpy")
def points_to_surface(
    measured: Points,
    samples: Samples,
    placed: PlacedForm,
    nearest: NDArray[np.int64],
    reach: float,
    texture: float,
    patches: float,
) -> tuple[Float64, Float64, float]:
    """Return the normal equations of point-to-plane distances, with Tukey's weights and each point's uncertainty.

    They are H, shape (11, 11), b, shape (11,), and the ratio of the points that count.

    Args:
        nearest: the previous nearest sample of each point, start of the search, shape (n,), -1 where there is none;
            changed in place.
        reach: points farther from the surface do not count [m].
        texture: standard deviation of the surface against the model [m].
        patches: number of independently deviating parts of the visible surface.
    """
    points = measured.points
    rays = measured.rays
    deviation = measured.deviation
    beside = measured.beside
    on_model = samples.points
    normals = samples.normals
    R = placed.R
    t = placed.t
    sx, sy, sz = placed.stretch
    lx, lz = placed.lean / placed.radius
    count = len(points)
    # derivatives of one point's distance, and the distance itself
    terms = np.empty((count, PARAMETERS + 1))
    slant = np.empty(count)
    counts = np.zeros(count, np.bool_)
    counted = 0
    for i in range(count):
        px = points[i, 0] - t[0]
        py = points[i, 1] - t[1]
        pz = points[i, 2] - t[2]
        u = R[0, 0] * px + R[1, 0] * py + R[2, 0] * pz
        v = R[0, 1] * px + R[1, 1] * py + R[2, 1] * pz
        w = R[0, 2] * px + R[1, 2] * py + R[2, 2] * pz
        x = u / sx
        z = w / sz
        y = v / (sy * (1.0 + lx * x + lz * z))
        j = nearest[i]
        if j < 0:
            j = start_of_walk(samples, x, y, z)
        j = walk_to_nearest(samples, x, y, z, j)
        nearest[i] = j
        mx = on_model[j, 0]
        my = on_model[j, 1]
        mz = on_model[j, 2]
        higher = 1.0 + lx * mx + lz * mz
        qx = sx * mx
        qy = sy * my * higher
        qz = sz * mz
        up = normals[j, 1] / higher
        a = (normals[j, 0] - up * my * lx) / sx
        b = up / sy
        c = (normals[j, 2] - up * my * lz) / sz
        shorter = 1.0 / math.sqrt(a * a + b * b + c * c)
        a = a * shorter
        b = b * shorter
        c = c * shorter
        distance = a * (u - qx) + b * (v - qy) + c * (w - qz)
        slant[i] = 0.0
        for axis in range(3):
            terms[i, axis] = R[axis, 0] * a + R[axis, 1] * b + R[axis, 2] * c
            slant[i] += terms[i, axis] * rays[i, axis]
        # cosine between a normal and the ray from which a surface faces away: it is the far side of the model
        counts[i] = abs(distance) < reach and slant[i] < 0.1
        counted += counts[i]
        terms[i, 3], terms[i, 4], terms[i, 10] = qy * c - qz * b, qx * b - qy * a, qz * a - qx * c
        terms[i, 5], terms[i, 6], terms[i, 7] = a * qx, b * qy, c * qz
        raised = b * sy * my
        terms[i, 8], terms[i, 9] = raised * mx / placed.radius[0], raised * mz / placed.radius[1]
        terms[i, PARAMETERS] = distance
    patch = texture**2 * max(1.0, counted / patches)
    sums = np.zeros((PARAMETERS, PARAMETERS + 1))
    for i in range(count):
        if not counts[i]:
            continue
        aside = beside[i] ** 2 * max(1.0 - slant[i] ** 2, 0.0)
        variance = deviation[i] ** 2 + aside + patch
        weight = (1.0 - (terms[i, PARAMETERS] / reach) ** 2) ** 2 / variance
        for row in range(PARAMETERS):
            scaled = weight * terms[i, row]
            for column in range(PARAMETERS + 1):
                sums[row, column] += scaled * terms[i, column]
    return sums[:, :PARAMETERS].copy(), sums[:, PARAMETERS].copy(), counted / max(count, 1)


_MAX_TURN = 0.3
_MAX_STRETCH = 0.2
_MAX_LEAN = 0.05
_PATCHES = 80.0  # number of independently deviating parts of the visible surface: a lobe or a dent is some 10 mm wide
# steps [m], and [rad] or relative, below which the fit has ended
_STILL_PLACE = 5e-5
_STILL_FORM = 5e-4


class ShapePriors(NamedTuple):
    """Priors of the kind, of the detection and of the uniform scale."""

    start: PlacedForm
    weighted: Float64  # prior directions over the parameters, over their variances, shape (11, 11)
    likeness: Float64  # their part of the normal equations, shape (11, 11)
    proportion: float  # expected ln(height / mean width), relative to the model's
    roundness: float  # expected ln(d_x / d_z), relative to the model's
    texture: float  # standard deviation of the surface against the model [m]


class Support(NamedTuple):
    """A plane, normal · p + offset = 0, that the fruit stands on within a standard deviation [m]; inf: it does not."""

    normal: Float64
    offset: float
    deviation: float


@kernel(nogil=True)
def move(placed: PlacedForm, step: Float64) -> None:
    """Turn, move and stretch the object by a step, shape (11,), limited in size."""
    angle = math.sqrt(step[3] ** 2 + step[10] ** 2 + step[4] ** 2)
    if angle > 0.0:
        x = step[3] / angle
        y = step[10] / angle
        z = step[4] / angle
        sine = math.sin(min(angle, _MAX_TURN))
        versine = 1.0 - math.cos(min(angle, _MAX_TURN))
        for i in range(3):
            a = placed.R[i, 0]
            b = placed.R[i, 1]
            c = placed.R[i, 2]
            along = versine * (a * x + b * y + c * z)
            placed.R[i, 0] = (1.0 - versine) * a + along * x + sine * (b * z - c * y)
            placed.R[i, 1] = (1.0 - versine) * b + along * y + sine * (c * x - a * z)
            placed.R[i, 2] = (1.0 - versine) * c + along * z + sine * (a * y - b * x)
    for k in range(3):
        placed.t[k] += step[k]
        placed.stretch[k] *= math.exp(min(max(step[5 + k], -_MAX_STRETCH), _MAX_STRETCH))
    for k in range(2):
        placed.lean[k] += min(max(step[8 + k], -_MAX_LEAN), _MAX_LEAN)


@kernel(nogil=True)
def contact(vertices: Float64, placed: PlacedForm, support: Support) -> tuple[float, Float64]:
    """Return the height of the lowest point over the support [m], and how it changes with the parameters, (11,)."""
    up = np.zeros(3)
    for i in range(3):
        for k in range(3):
            up[k] += placed.R[i, k] * support.normal[i]
    stretch = placed.stretch
    x = up[0] * stretch[0]
    y = up[1] * stretch[1]
    z = up[2] * stretch[2]
    a = placed.lean[0] / placed.radius[0]
    b = placed.lean[1] / placed.radius[1]
    lowest = np.inf
    index = 0
    for i in range(len(vertices)):
        height = x * vertices[i, 0] + z * vertices[i, 2]
        height += y * vertices[i, 1] * (1.0 + a * vertices[i, 0] + b * vertices[i, 2])
        if height < lowest:
            lowest = height
            index = i
    v = (vertices[index, 0], vertices[index, 1], vertices[index, 2])
    q = (stretch[0] * v[0], stretch[1] * v[1] * (1.0 + a * v[0] + b * v[2]), stretch[2] * v[2])
    row = np.empty(PARAMETERS)
    gap = lowest + support.offset
    for k in range(3):
        row[k], row[5 + k] = support.normal[k], up[k] * q[k]
        gap += support.normal[k] * placed.t[k]
    row[3], row[10], row[4] = (
        q[1] * up[2] - q[2] * up[1],
        q[2] * up[0] - q[0] * up[2],
        q[0] * up[1] - q[1] * up[0],
    )
    row[8], row[9] = y * v[1] * v[0] / placed.radius[0], y * v[1] * v[2] / placed.radius[1]
    return gap, row


@kernel(nogil=True)
def _unlikeness(expected: ShapePriors, placed: PlacedForm) -> Float64:
    """Expected changes along the prior directions, shape (11,)."""
    start = expected.start
    values = np.empty(PARAMETERS)
    # the detected axes as the present object sees them
    axis = np.zeros(3)
    facing = np.zeros(3)
    for i in range(3):
        values[i] = start.t[i] - placed.t[i]
        for k in range(3):
            axis[k] += placed.R[i, k] * start.R[i, 1]
            facing[k] += placed.R[i, k] * start.R[i, 0]
    ln_x = math.log(placed.stretch[0] / start.stretch[0])
    ln_y = math.log(placed.stretch[1] / start.stretch[1])
    ln_z = math.log(placed.stretch[2] / start.stretch[2])
    values[3], values[4] = axis[0], axis[2]
    values[5] = -(ln_x + ln_y + ln_z) / 3.0
    values[6] = expected.proportion - ln_y + 0.5 * (ln_x + ln_z)
    values[7] = expected.roundness - (ln_x - ln_z)
    values[8], values[9] = -placed.lean[0], -placed.lean[1]
    values[10] = math.atan2(-facing[2], facing[0])
    return values


@kernel(nogil=True)
def _solve(H: Float64, b: Float64) -> Float64:
    """x of H x = b for a positive definite H (Cholesky)."""
    size = len(b)
    root = np.zeros((size, size))
    x = b.copy()
    for i in range(size):
        for k in range(i + 1):
            left = H[i, k]
            for m in range(k):
                left -= root[i, m] * root[k, m]
            root[i, k] = left / root[k, k] if k < i else math.sqrt(left)
        for m in range(i):
            x[i] -= root[i, m] * x[m]
        x[i] /= root[i, i]
    for i in range(size - 1, -1, -1):
        for m in range(i + 1, size):
            x[i] -= root[m, i] * x[m]
        x[i] /= root[i, i]
    return x


@kernel(nogil=True)
def step_until_still(
    measured: Points,
    samples: Samples,
    placed: PlacedForm,
    nearest: NDArray[np.int64],
    expected: ShapePriors,
    support: Support,
    bands: Float64,
) -> tuple[Float64, float]:
    """Step until nothing moves; changes `placed` and `nearest`. Return the last matrix H, shape (11, 11), and the ratio
    of points that count.

    Args:
        bands: half-width of the band about the surface in which points count, for each step at most [m]; the last
            value is the final one.
    """
    likeness = expected.likeness
    weighted = expected.weighted
    H = likeness
    share = 0.0
    for band in bands:
        H, b, share = points_to_surface(
            measured, samples, placed, nearest, band, expected.texture, _PATCHES
        )
        values = _unlikeness(expected, placed)
        for i in range(PARAMETERS):
            for k in range(PARAMETERS):
                H[i, k] += likeness[i, k]
                b[k] += values[i] * weighted[i, k]
        if support.deviation < np.inf:
            gap, row = contact(samples.vertices, placed, support)
            for i in range(PARAMETERS):
                certain = row[i] / support.deviation**2
                b[i] -= gap * certain
                for k in range(PARAMETERS):
                    H[i, k] += row[k] * certain
        step = _solve(H, b)
        move(placed, step)
        still = True
        for k in range(PARAMETERS):
            still = still and abs(step[k]) < (_STILL_PLACE if k < 3 else _STILL_FORM)
        if still and band == bands[-1]:
            break
    return H, share


_NEARLY_ROUND = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """(x, y, z) of the model -> (s_x x, s_y y (1 + l_x x/r_x + l_z z/r_z), s_z z), r half the model's widths."""

    stretch: Float64  # factors s along the axes, shape (3,)
    lean: Float64  # l, by how much the height differs at the sides, towards x and towards z, shape (2,)
    radius: Float64  # r, shape (2,) [m]

    @classmethod
    def scaled(cls, mesh: Triangles, mu: float) -> Form:
        """Return the model's own form at another size."""
        return cls(np.full(3, mu), np.zeros(2), 0.5 * extents(mesh)[[0, 2]])

    @property
    def nearly_round(self) -> bool:
        """Whether the model is nearly a body of revolution, so that its turn about the axis is unobservable."""
        return bool(abs(np.log(self.radius[0] / self.radius[1])) < _NEARLY_ROUND)

    def cuboid(self, mesh: Triangles) -> tuple[Float64, Float64]:
        """Centre and dimensions of the fruit's cuboid in the model's axes, shape (3,) each [m]."""
        x, y, z = np.ascontiguousarray(mesh.vertices.T)
        a, b = self.lean / self.radius
        leaned = (x, y * (1.0 + a * x + b * z), z)
        low = self.stretch * [float(axis.min()) for axis in leaned]
        high = self.stretch * [float(axis.max()) for axis in leaned]
        return 0.5 * (low + high), high - low


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
    R = T_camera_object[:3, :3].copy()
    t = T_camera_object[:3, 3].copy()
    start = PlacedForm(R, t, form.stretch, form.lean, form.radius)
    placed = PlacedForm(*(part.copy() for part in start))
    expected = _expected(start, form, priors)
    plane = Support(np.zeros(3), 0.0, np.inf)
    steps = np.full(_MAX_STEPS, band)
    bands = np.concatenate(
        [band * np.array(_NARROWING), np.full(_MAX_STEPS_OF_FEW - len(_NARROWING), band)]
    )
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
        doubt = (
            row @ np.linalg.solve(H, row)
            + (0.05 * extents(mesh)[1] * mu) ** 2
            + support.deviation**2
        )
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
    round_ratio = (
        -math.log(form.radius[0] / form.radius[1])
        if form.nearly_round and priors is not RIGID
        else 0.0
    )
    deviations = [
        *[priors.place] * 3,
        *[priors.tilt] * 2,
        priors.size,
        priors.aspect,
        priors.roundness,
    ]
    weighted = _LIKENESS / np.array([*deviations, priors.lean, priors.lean, turn])[:, None] ** 2
    likeness = _LIKENESS.T @ weighted
    return ShapePriors(start, weighted, likeness, priors.proportion, round_ratio, priors.texture)


def _points(cloud: Cloud) -> Points:
    return Points(
        *map(np.ascontiguousarray, (cloud.points, cloud.rays, cloud.deviation, cloud.beside))
    )


_UNMODELLED = np.array([0.01, 0.01, 0.01, 0.003, 0.012, 0.003])
_UNMODELLED_ON_SUPPORT = np.array([0.01, 0.01, 0.01, 0.003, 0.004, 0.003])
"""Standard deviations of position and dimensions from form errors of a stretched model (lobes, dents, one shoulder
higher than the other, the turn about the axis), relative to the mean dimension; over the visible ratio of the fruit."""


def covariance_of(
    fit: ShapeFit, dimensions: Float64, whole: float, seen: float, doubt: float
) -> Float64:
    """Return the covariance of (position, dimensions): of the fit, of form errors, and of the common depth error.

    Args:
        fit, dimensions: the stretched model.
        whole: standard deviation of the common depth error, relative.
        seen: ratio of the fruit that is visible and agrees.
        doubt: standard deviation of the dimensions, as other ways to measure disagree [m].
    """
    change = np.concatenate([fit.T_camera_object[:3, 3], dimensions])
    to_size = np.diag(np.concatenate([np.ones(3), dimensions]))
    # factor on the fit's own variances: its weights measure best, but as variances they are too large
    covariance: Float64 = 0.75 * to_size @ fit.covariance @ to_size
    unmodelled = (_UNMODELLED_ON_SUPPORT if fit.on_support else _UNMODELLED) * dimensions.mean()
    unmodelled /= seen
    unmodelled[3:] = np.hypot(unmodelled[3:], doubt)
    return covariance + np.diag(unmodelled**2) + whole**2 * np.outer(change, change)
