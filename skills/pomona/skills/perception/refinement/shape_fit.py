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
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import rotation_about, transform
from pomona.skills.perception.refinement.cloud import Cloud, Plane
from pomona.skills.perception.refinement.depth_image import DepthImage, RefineResult, Triangles, extents, winding
from pomona.skills.perception.refinement.shape_steps import (
    PARAMETERS,
    PlacedForm,
    Points,
    Samples,
    ShapePriors,
    Support,
    contact,
    step_until_still,
)

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

    def height_factor(self, model: Float64) -> Float64:
        """1 + l_x x/r_x + l_z z/r_z at points of the model, shape (n, 3) -> (n,)."""
        factor: Float64 = 1.0 + (model[:, [0, 2]] / self.radius) @ self.lean
        return factor

    def points(self, model: Float64) -> Float64:
        """Where points of the model are on the fruit, shape (n, 3) [m]."""
        leaned = model.copy()
        leaned[:, 1] *= self.height_factor(model)
        return leaned * self.stretch

    def cuboid(self, mesh: Triangles) -> tuple[Float64, Float64]:
        """Centre and dimensions of the fruit's cuboid in the model's axes, shape (3,) each [m]."""
        x, y, z = np.ascontiguousarray(mesh.vertices.T)
        a, b = self.lean / self.radius
        leaned = (x, y * (1.0 + a * x + b * z), z)
        low = self.stretch * [float(axis.min()) for axis in leaned]
        high = self.stretch * [float(axis.max()) for axis in leaned]
        return 0.5 * (low + high), high - low


_SAMPLES = 4000
_NEIGHBOURS = 16
"""Number of neighbours of a sample that are tried for one that is nearer to a point. After a step of up to 10 mm a
search from neighbour to neighbour ends beside the nearest sample for 1 of 10 000 points about the shipped fruit (12: 1
of 1 000)."""
_CELLS, _BESIDE = 24, 0.1
"""Number of the grid's cells along each axis, and how far it reaches beyond the model, relative to its size."""


@lru_cache(maxsize=8)
def surface_of(mesh: Triangles) -> Samples:
    """Sample a mesh; the same mesh object gives the same samples.

    Normals look outwards also where faces are wound inwards, or not alike as in scans with holes: there away from the
    middle, as every part of a fruit's skin does.
    """
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    wound = winding(mesh)
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    away = np.einsum("ij,ij->i", normals, corners.mean(axis=1) - middle)
    normals *= wound if wound else np.where(away < 0.0, -1.0, 1.0)[:, None]
    area = np.linalg.norm(normals, axis=1)
    share = np.cumsum(area) / area.sum()
    face = np.minimum(np.searchsorted(share, (np.arange(_SAMPLES) + 0.5) / _SAMPLES), len(area) - 1)
    along, across = np.random.default_rng(0).random((2, _SAMPLES))
    root = np.sqrt(along)
    weights = np.column_stack([1.0 - root, root * (1.0 - across), root * across])
    points = np.einsum("nc,nci->ni", weights, corners[face])
    tree = cKDTree(points)
    neighbours = np.ascontiguousarray(tree.query(points, _NEIGHBOURS + 1)[1][:, 1:], dtype=np.int32)
    low, high = points.min(axis=0), points.max(axis=0)
    corner = low - _BESIDE * (high - low)
    edges = (1.0 + 2.0 * _BESIDE) * (high - low) / _CELLS
    middles = corner + edges * (np.indices((_CELLS, _CELLS, _CELLS)).transpose(1, 2, 3, 0) + 0.5)
    near = tree.query(middles)[1].astype(np.int32)
    vertices = np.array(mesh.vertices, dtype=np.float64)
    return Samples(points, normals[face] / area[face, None], neighbours, near, corner, edges, vertices)


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
