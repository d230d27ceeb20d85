"""From a detection to a measured fruit: true size and position from depth, by a fit of `FITS`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.later import Later
from pomona.skills.geometry import inverse, rotation_about
from pomona.skills.perception.detection.detection import Detection
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.perception.refinement.cloud import (
    Cloud,
    Plane,
    gather,
    gather_others,
    horizontal_plane,
    near_model,
    plane_below,
    points_around,
    seen_elsewhere,
)
from pomona.skills.perception.refinement.curvature import least_curvature
from pomona.skills.perception.refinement.errors import (
    NoDepth,
    NotItsShape,
    RefineError,
    TooFewInliers,
)
from pomona.skills.perception.refinement.render import (
    DepthImage,
    DepthLook,
    ImageBox,
    Limits,
    RefineResult,
    RendererName,
    Triangles,
    check_pose,
    extents,
    farthest,
    render_depth,
    share_inside,
    usable_renderer,
)
from pomona.skills.perception.refinement.scale_fit import (
    FruitContext,
    Task,
    scale_model,
    scale_model_by_rendering,
    scale_model_of_kind,
)
from pomona.skills.perception.refinement.shape_fit import (
    FEW_POINTS,
    MAX_POINTS,
    RIGID,
    covariance_of,
    fit_shape,
)

cv2: Any = Later("cv2")


def size_deviation(detection: Detection) -> float:
    """Return that of the fruit's size in the picture, relative: the CAD-sized model seems as large as it is near."""
    p = detection.T_camera_object[:3, 3]
    return float(np.sqrt(abs(p @ detection.covariance[3:, 3:] @ p)) / (p @ p))


def measure(
    detection: Detection,
    method: str = "shape",
    limits: Limits | None = None,
    renderer: RendererName = "pyrender",
    table_z: float | None = None,
    earlier: MeasuredFruit | None = None,
) -> MeasuredFruit:
    """Refine a detection and express it in the base frame; method `none` keeps the detector's pose and the CAD size.

    Args:
        method: see `refine`, as for `limits`.
        renderer: where it does not work, the z-buffer is used.
        table_z: height of the table in the base frame [m], if the fruit may stand on one.
        earlier: the same fruit, measured from another place: its looks are fused in.

    Raises RefineError: see `refine`; `NoDepth` also when the frame has no depth image.
    """
    frame = detection.frame
    renderer, _ = usable_renderer(renderer)
    if method == "none":
        return _unrefined(detection, renderer)
    if frame.depth is None:
        raise NoDepth(0, 0)
    past = () if earlier is None else (*earlier.earlier, (earlier.frame, earlier.T_base_camera))
    T_camera_base = inverse(detection.T_base_camera)
    support = None if table_z is None else horizontal_plane(detection.T_base_camera, table_z)
    look = DepthLook(frame.depth, frame.intrinsics, frame.depth_model, renderer=renderer)
    looks = tuple(
        DepthLook(f.depth, f.intrinsics, f.depth_model, T_camera_base @ T, renderer)
        for f, T in past
        if f.depth is not None
    )
    known = FruitContext(
        support=support,
        looks=looks,
        sizes=detection.fruit.sizes,
        size_deviation=size_deviation(detection),
    )
    result = refine(
        look, detection.T_camera_object, detection.fruit, method=method, known=known, limits=limits
    )
    turn = np.eye(6)
    turn[:3, :3] = detection.T_base_camera[:3, :3]
    return MeasuredFruit(
        fruit=detection.fruit,
        T_base_fruit=detection.T_base_camera @ result.T_camera_object,
        T_base_camera=detection.T_base_camera,
        dimensions=result.dimensions,
        mu=result.mu,
        sigma=result.sigma,
        covariance=turn @ result.covariance @ turn.T,
        inlier_ratio=result.inlier_ratio,
        residual=result.residual,
        contour=outline(result.virtual_depth, result.box),
        frame=frame,
        method=result.method,
        earlier=past if result.method.endswith("+views") else (),
        doubt="" if support is None else _doubt(look, result, support),
    )


def _doubt(look: DepthLook, result: RefineResult, support: Plane) -> str:
    """Return a sentence if the surface around the fruit contradicts the cell file, otherwise an empty text."""
    elsewhere = seen_elsewhere(support, points_around(look, result.box, result.virtual_depth))
    if elsewhere is None:
        return ""
    height, tilt = elsewhere
    side = "above" if height > 0.0 else "below"
    return (
        f"around the fruit a surface is seen {1e3 * abs(height):.0f} mm {side} the table and {math.degrees(tilt):.0f}° "
        "tilted against it: the fruit lies on an object, or the table's height, the camera's place or its intrinsics "
        "are wrong"
    )


def outline(virtual_depth: DepthImage, box: ImageBox) -> Float64:
    """Return the longest outline of the pixels with depth in the whole image, shape (n, 2) [px]; may be empty."""
    seen = (virtual_depth > 0.0).astype(np.uint8)
    contours, _ = cv2.findContours(seen, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.empty((0, 2))
    longest = max(contours, key=len).reshape(-1, 2).astype(np.float64)
    shifted: Float64 = longest + np.array([box.left, box.top], dtype=np.float64)
    return shifted


def _unrefined(detection: Detection, renderer: RendererName) -> MeasuredFruit:
    virtual_depth, box = render_depth(
        detection.fruit, detection.T_camera_object, detection.frame.intrinsics, using=renderer
    )
    R = detection.T_base_camera[:3, :3]
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = R @ detection.covariance[3:, 3:] @ R.T
    return MeasuredFruit(
        fruit=detection.fruit,
        T_base_fruit=detection.T_base_camera @ detection.T_camera_object,
        T_base_camera=detection.T_base_camera,
        dimensions=detection.fruit.dimensions.copy(),
        mu=1.0,
        sigma=0.0,
        covariance=covariance,
        inlier_ratio=0.0,
        residual=0.0,
        contour=outline(virtual_depth, box),
        frame=detection.frame,
        method="none",
    )


_LEAST_POINTS = 150
_FEW_STARTS = 3
_FINALISTS = 2
"""More other axes of the stem than that are fitted with few points first, and the best ones with all points."""
_LEAST_AGREEMENT = 0.8  # least ratio of a stretched model's agreeing pixels to the scaled model's

_NOISE_IN_BAND = 2.0
"""Minimum width of the band in standard deviations of the depth error. Of 53 finds with depth in two real frames (1.0
to 1.9 m) a band of 4 mm measures 45, one of 8 mm 49, of 10 mm and of 16 mm 51, all as exactly: 10 mm results there from
the sensor's noise and a registration error of 5 px."""

_THROUGH = 2.0
_MOST_THROUGH = 0.1  # ratio of a stretched model that may be seen through, by this number of bands

_UNSEEN_DOUBT = 0.6
"""If a fruit is half hidden, the mean sizes of the stretched and the scaled model differ by errors of the former: the
dimensions' uncertainty is this factor times the difference, times the hidden over the visible ratio."""

_FLAT = 0.2
_CURVED = 0.5
_SURELY = 2.0
_SMOOTH = 0.9
"""Relative curvature of flat and of curved surfaces, the number of standard deviations, and the ratio of the surface
that one curvature must explain: a leaf beside a fruit makes no smooth surface. The least of 290 whole and half hidden
apples was 0.77, with its uncertainty; 28 walls and posts had 0.2 at most; of 53 finds in real frames one is refused."""


def refine(
    look: DepthLook,
    T_camera_object: Float64,
    mesh: Triangles,
    *,
    method: str = "shape",
    known: FruitContext | None = None,
    limits: Limits | None = None,
) -> RefineResult:
    """Measure a fruit whose pose was estimated as if it had the size of its CAD model.

    Args:
        look: the depth image.
        T_camera_object: the detector's pose of the CAD-sized model (the paper's p_hat and Q_hat).
        mesh: the CAD model or a scan, its origin in the centre of its cuboid; a `FruitModel` is one. It may have holes
            where the camera does not look.
        method: name of a fit in `FITS`.
        known: support, other looks, sizes of the kind.
        limits: of accepted measurements.

    Raises:
        RefineError: `BadDepth`, `BadMesh` or `BadPose` if an argument is no depth image of this camera, no mesh or no
            pose; `NoDepth`, `TooFewInliers`, `SizeOutOfRange`, `AtBound`, `NotItsShape` or `RenderFailed` if there is
            no measurement.
    """
    fit = FITS[method]
    known = known or FruitContext()
    limits = limits or Limits()
    for one in (look, *known.looks):
        one.check()
    check_pose(T_camera_object)
    extents(mesh)
    apart = look.depth_model.agreeing(
        np.array(look.distance(T_camera_object[:3, 3])), look.intrinsics.fx
    )
    limits = replace(limits, inlier_band=max(limits.inlier_band, _NOISE_IN_BAND * float(apart)))
    task = Task(look, mesh, known, limits)
    if known.sizes is not None:
        proportion = float(np.log(known.sizes.height_over_width / task.model_proportion))
        priors = replace(
            known.priors, proportion=proportion, aspect=known.sizes.height_over_width_deviation
        )
        task = replace(task, known=replace(known, priors=priors))
    result = fit(task, T_camera_object)
    _check_curvature(task, result)
    return result


def _best_of_starts(task: Task, T_camera_object: Float64) -> RefineResult:
    """Fit from the detected pose and, if that does not fit well, from other axes of the stem.

    Raises:
        RefineError: no start leads to a measurement; the error is that of the detected pose.
    """
    judge = Judge(
        task.look.depth, task.limits.inlier_band, extents(task.mesh), task.known.priors.aspect
    )
    best: RefineResult | None = None
    plane: Plane | None = None  # the support, measured once
    problem: TooFewInliers | None = None
    score = 0.0
    try:
        scaled = scale_model(task, T_camera_object)
        cloud, plane = _gathered(task, scaled)
        best = _fitted(task, scaled, cloud, plane)
        score, _, settled = judge.score(best)
        if settled:
            return best
    except TooFewInliers as error:
        problem = error
    # Every start is tried: if half of the fruit is hidden, the first one that fits well may be wrong.
    trials: list[tuple[float, RefineResult, Cloud]] = []
    starts = other_starts(T_camera_object, task.known.support)
    few = len(starts) > _FEW_STARTS
    for T_start in starts:
        try:
            scaled = scale_model(task, T_start)
            cloud, plane = _gathered(task, scaled, plane)
        except RefineError:
            continue
        found = judge.score(_fitted(task, scaled, cloud, plane, FEW_POINTS))[0] if few else 0.0
        trials.append((found, scaled, cloud))
    for _, scaled, cloud in sorted(trials, key=lambda trial: -trial[0])[
        : _FINALISTS if few else _FEW_STARTS
    ]:
        other = _fitted(task, scaled, cloud, plane)
        found, clearly, _ = judge.score(other)
        if other.method.startswith("shape") and found > score + clearly:
            best = other
            score = found
    if best is None:
        assert problem is not None
        raise problem
    return best


def _check_curvature(task: Task, result: RefineResult) -> None:
    """Refuse a measurement whose surface is flat.

    Raises:
        NotItsShape: the points that agree with the model form one smooth surface that is flat in some direction.
    """
    # Ratio of agreeing depth from which the shape is not checked: of 60 walls, posts and edges the most was 0.94
    if result.inlier_ratio > 0.95:
        return
    measured = task.look.depth[result.box.slices]
    band = task.limits.inlier_band
    found = least_curvature(
        measured, result.virtual_depth, result.inliers, band, task.look.depth_model.alike
    )
    if found is None or found.explained < _SMOOTH:
        return
    unsure = _SURELY * found.deviation
    if abs(found.least) <= _FLAT + unsure and found.least + unsure < _CURVED:
        raise NotItsShape(found.least, _CURVED)


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
    x = T_camera_object[:3, 0]
    y = T_camera_object[:3, 1]
    stems = [y]
    if support is not None:
        stems = [support.normal, -support.normal, y]
    else:
        aside = (x, -x, T_camera_object[:3, 2], -T_camera_object[:3, 2])
        stems += [
            np.sin(_ASIDE) * a + turn * np.cos(_ASIDE) * y for turn in (-1.0, 1.0) for a in aside
        ]
    return [_with_stem(T_camera_object, stem) for stem in stems]


def _with_stem(T_camera_object: Float64, stem: Float64) -> Float64:
    """Return the pose turned by the shortest way until the stem (the object's -y) points along a unit vector."""
    now = -T_camera_object[:3, 1]
    axis = np.cross(now, stem)
    sine = float(np.linalg.norm(axis))
    if sine > 1e-9:
        axis = axis / sine
    else:  # along it already, or half a turn away from it
        axis = T_camera_object[:3, 0]
        sine = 0.0
    result = T_camera_object.copy()
    result[:3, :3] = (
        rotation_about(axis, float(np.arctan2(sine, now @ stem))) @ T_camera_object[:3, :3]
    )
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
        model = result.virtual_depth
        measured = self.depth[result.box.slices]
        valid = (model > 0.0) & np.isfinite(measured) & (measured > 0.0)
        difference = measured[valid] - model[valid]
        agree = np.count_nonzero(np.abs(difference) <= self.band)
        # distance in front of the model from which an object hides it, in bands
        hidden = np.count_nonzero(difference < -5.0 * self.band)
        return int(agree), int(difference.size - agree - hidden)

    def aspect_penalty(self, dimensions: Float64) -> float:
        """How far height over width is from the model's, squared, in standard deviations."""
        wide = dimensions[[0, 2]].mean()
        model_wide = self.model[[0, 2]].mean()
        return float(
            (np.log(dimensions[1] * model_wide / (wide * self.model[1])) / self.aspect) ** 2
        )

    def score(self, result: RefineResult) -> tuple[float, float, bool]:
        """Return explained minus contradicting pixels and oddness; the margin for a better one; and whether it is
        settled.
        """
        agree, differ = self.explained(result)
        penalty = _ASPECT_WEIGHT * self.aspect_penalty(result.dimensions) * agree
        # ratio of agreeing depth from which the detected axis of the stem is accepted
        return agree - differ - penalty, _CLEARLY * agree, agree >= 0.95 * (agree + differ)


def _gathered(
    task: Task, scaled: RefineResult, plane: Plane | None = None
) -> tuple[Cloud, Plane | None]:
    """Return the points of all looks about a scaled fruit, and the support as the camera sees it, unless it is known.

    Raises TooFewInliers: the points that agree with the model lie on the support.
    """
    look = task.look
    mesh = task.mesh
    known = task.known
    if known.support is not None and plane is None:
        plane = plane_below(look, scaled, known.support)
    points = gather(look, scaled, plane)
    T_scaled = scaled.T_camera_object.copy()
    T_scaled[:3, :3] *= scaled.mu
    others = gather_others(known.looks, mesh, T_scaled, plane, task.limits.inlier_band)
    return near_model([points, *others], T_scaled[:3, 3], scaled.mu * farthest(mesh)), plane


def _fitted(
    task: Task,
    scaled: RefineResult,
    cloud: Cloud,
    plane: Plane | None,
    at_most: int = MAX_POINTS,
    method: str = "shape",
) -> RefineResult:
    """Stretch the model onto points; return the scaled one where the points do not support that."""
    look = task.look
    mesh = task.mesh
    known = task.known
    limits = task.limits
    if len(cloud.points) < _LEAST_POINTS:
        return scaled
    fit = fit_shape(
        cloud,
        mesh,
        scaled.T_camera_object,
        scaled.mu,
        support=plane,
        band=limits.inlier_band,
        priors=known.priors,
        at_most=at_most,
    )
    T_fitted = fit.T_camera_object.copy()
    T_fitted[:3, :3] *= fit.stretch
    virtual_depth, box = look.render(mesh, T_fitted)
    measured = look.depth[box.slices]
    valid = (virtual_depth > 0.0) & np.isfinite(measured) & (measured > 0.0)
    difference = np.where(valid, measured - virtual_depth, np.inf)
    inliers = np.abs(difference) <= limits.inlier_band
    agreeing = np.count_nonzero(inliers)
    through = np.count_nonzero(difference[valid] > _THROUGH * limits.inlier_band)
    if (
        agreeing < _LEAST_AGREEMENT * np.count_nonzero(scaled.inliers)
        or through > _MOST_THROUGH * np.count_nonzero(valid)
        or not (limits.size[0] <= fit.stretch.min() and fit.stretch.max() <= limits.size[1])
    ):
        return scaled
    dimensions = fit.stretch * extents(mesh)
    seen = (
        agreeing
        / np.count_nonzero(virtual_depth > 0.0)
        * share_inside(mesh, T_fitted, box, look.intrinsics)
    )
    doubt = (
        _UNSEEN_DOUBT * (1.0 - seen) / seen * float(dimensions.mean() - scaled.dimensions.mean())
    )
    whole = look.depth_model.of_the_whole(float(fit.T_camera_object[2, 3]))
    return replace(
        scaled,
        T_camera_object=fit.T_camera_object,
        dimensions=dimensions,
        covariance=covariance_of(fit, dimensions, whole, seen, doubt),
        inlier_ratio=agreeing / np.count_nonzero(valid),
        residual=float(np.sqrt(np.mean(difference[inliers] ** 2))),
        box=box,
        inliers=inliers,
        virtual_depth=virtual_depth,
        method=method
        + ("+plane" if fit.on_support else "")
        + ("+views" if cloud.looks > 1 else ""),
    )


def _of_one_scale(task: Task, T_camera_object: Float64) -> RefineResult:
    """Fit one scale; with other looks, place and scale to the points of all."""
    scaled = scale_model_of_kind(task, T_camera_object)
    if not task.known.looks:
        return scaled
    rigid = replace(task, known=replace(task.known, priors=RIGID))
    return _fitted(rigid, scaled, *_gathered(task, scaled), method="uniform")


Fit = Callable[
    [Task, Float64], RefineResult
]  # of the model, from the detector's pose; raises RefineError

FITS: Mapping[str, Fit] = {
    "shape": _best_of_starts,  # height, widths and tilt separately where the depth supports it, otherwise as uniform
    "uniform": _of_one_scale,  # the closed form with one render
    "paper": scale_model_by_rendering,  # the same optimum by repeated rendering
}
"""Fits by name: one more line here is one more `method` of Refine."""
