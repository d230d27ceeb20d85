"""From a detection to a measured fruit: what a fit is given, and what its result becomes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pomona.drivers.depth_model import DepthModel
from pomona.drivers.interfaces import Frame, Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import inverse, rot_x, rot_y, transform
from pomona.skills.perception.detection.detection import Detection
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.refinement import measure as module
from pomona.skills.perception.refinement.cloud import Plane, horizontal_plane
from pomona.skills.perception.refinement.curvature import Curvature
from pomona.skills.perception.refinement.errors import NoDepth, NotItsShape
from pomona.skills.perception.refinement.measure import (
    FITS,
    Judge,
    measure,
    other_starts,
    outline,
    refine,
    size_deviation,
)
from pomona.skills.perception.refinement.render import DepthLook, ImageBox, Limits, RefineResult
from pomona.skills.perception.refinement.scale_fit import Task

APPLE = load_fruit("apple")
LENS = Intrinsics(100.0, 100.0, 39.5, 29.5, 80, 60)
MODEL = DepthModel(disparity=0.5, baseline=0.05, alike=7.0)
T_BASE_CAMERA = transform(rot_x(np.pi - 0.3) @ rot_y(0.2), (0.1, 0.2, 0.7))
T_CAMERA_OBJECT = transform(rot_y(0.4), (0.01, 0.02, 0.4))
BOX = ImageBox(30, 20, 36, 24)


def detection(depth: Any = None) -> Detection:
    frame = Frame(
        1.0, 0, np.zeros((60, 80, 3), np.uint8), depth, LENS, None, T_BASE_CAMERA, "seen", MODEL
    )
    spread = np.diag([9.0, 9.0, 9.0, 1e-4, 4e-4, 9e-4])
    points = np.zeros((9, 2))
    return Detection(APPLE, frame, T_BASE_CAMERA, T_CAMERA_OBJECT, points, 0.9, spread, 0, 1)


def result(method: str = "shape", difference: Any = 0.0, ratio: float = 0.97) -> RefineResult:
    virtual = np.full(BOX.shape, 0.4, np.float32)
    virtual[0] = 0.0
    return RefineResult(
        T_CAMERA_OBJECT, np.array([0.06, 0.08, 0.1]), 0.9, 0.01,
        np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), ratio, 2e-3, BOX, virtual > 0.0, virtual, method,
    )  # fmt: skip


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> list[Task]:
    """The tasks of a fit `own` and `two+views` that have one result."""
    tasks: list[Task] = []
    for name in ("own", "two+views"):

        def fit(task: Task, _T: Float64, name: str = name) -> RefineResult:
            tasks.append(task)
            return result(name)

        monkeypatch.setitem(FITS, name, fit)  # type: ignore[misc]
    return tasks


def test_the_size_in_the_picture_is_as_unsure_as_the_distance_along_the_ray() -> None:
    p = T_CAMERA_OBJECT[:3, 3]
    along = p / np.linalg.norm(p)
    variance = along**2 @ [1e-4, 4e-4, 9e-4]
    assert size_deviation(detection()) == pytest.approx(variance**0.5 / np.linalg.norm(p))


def test_a_result_is_expressed_in_the_base_frame(given: list[Task]) -> None:
    seen = detection(np.full((60, 80), 0.45, np.float32))
    found = measure(seen, "own", renderer="zbuffer", table_z=0.2)
    (task,) = given
    assert task.known.support is not None
    expected = horizontal_plane(T_BASE_CAMERA, 0.2)
    np.testing.assert_allclose(task.known.support.normal, expected.normal)
    assert task.known.support.offset == expected.offset
    assert task.known.size_deviation == size_deviation(seen)
    assert task.known.looks == ()
    assert task.look.renderer == "zbuffer"
    assert task.look.depth_model is MODEL
    R = T_BASE_CAMERA[:3, :3]
    np.testing.assert_allclose(found.T_base_fruit, T_BASE_CAMERA @ T_CAMERA_OBJECT)
    np.testing.assert_allclose(found.covariance[:3, :3], R @ np.diag([1.0, 2.0, 3.0]) @ R.T)
    np.testing.assert_allclose(found.covariance[3:, 3:], np.diag([4.0, 5.0, 6.0]))
    assert (found.mu, found.sigma, found.inlier_ratio, found.residual) == (0.9, 0.01, 0.97, 2e-3)
    assert (found.method, found.earlier) == ("own", ())
    assert found.contour.min(axis=0) == pytest.approx([30.0, 21.0])
    assert found.contour.max(axis=0) == pytest.approx([35.0, 23.0])
    assert found.doubt == ""


def test_earlier_looks_are_fused_and_kept_where_they_were_used(given: list[Task]) -> None:
    depth = np.full((60, 80), 0.45, np.float32)
    seen = detection(depth)
    before = replace(
        measure(seen, "own", renderer="zbuffer"), T_base_camera=transform(None, (0.0, 0.0, 0.5))
    )
    blind = (replace(seen.frame, depth=None), T_BASE_CAMERA)
    before = replace(before, earlier=(blind,))
    for method, kept in (("own", 0), ("two+views", 2)):
        assert len(measure(seen, method, renderer="zbuffer", earlier=before).earlier) == kept
        (look,) = given[-1].known.looks
        np.testing.assert_allclose(
            look.T_camera_look, inverse(T_BASE_CAMERA) @ before.T_base_camera
        )
    assert given[-1].known.support is None


@pytest.mark.parametrize(("height", "side"), [(0.03, "above"), (-0.03, "below")])
def test_a_surface_beside_the_table_raises_a_doubt(
    given: list[Task], height: float, side: str
) -> None:
    T_down = transform(rot_x(np.pi), (0.0, 0.0, 0.7))
    seen = replace(detection(np.full((60, 80), 0.4, np.float32)), T_base_camera=T_down)
    doubt = measure(seen, "own", renderer="zbuffer", table_z=0.3 - height).doubt
    assert f"a surface is seen 30 mm {side} the table and 0° tilted" in doubt


def test_without_a_fit_the_detectors_pose_and_the_models_size_stay() -> None:
    found = measure(detection(), "none", renderer="zbuffer")
    R = T_BASE_CAMERA[:3, :3]
    spread = np.zeros((6, 6))
    spread[:3, :3] = R @ np.diag([1e-4, 4e-4, 9e-4]) @ R.T
    np.testing.assert_allclose(found.covariance, spread)
    np.testing.assert_allclose(found.T_base_fruit, T_BASE_CAMERA @ T_CAMERA_OBJECT)
    np.testing.assert_array_equal(found.dimensions, APPLE.dimensions)
    assert (found.mu, found.sigma, found.inlier_ratio, found.residual) == (1.0, 0.0, 0.0, 0.0)
    assert found.method == "none"
    assert len(found.contour) > 20
    with pytest.raises(NoDepth):
        measure(detection(), "shape", renderer="zbuffer")


def test_the_outline_is_the_longest_one_in_the_whole_image() -> None:
    virtual = np.zeros((5, 9), np.float32)
    virtual[1:4, 1:5] = 0.4
    virtual[1:3, 7:] = 0.4
    found = outline(virtual, ImageBox(10, 20, 19, 25))
    edge = {(u, v) for u in range(11, 15) for v in range(21, 24)} - {(12, 22), (13, 22)}
    assert {tuple(point) for point in found} == edge
    assert outline(np.zeros((5, 9), np.float32), BOX).shape == (0, 2)


def test_the_band_is_as_wide_as_the_sensors_noise_asks(given: list[Task]) -> None:
    depth = np.full((60, 80), 0.4, np.float32)
    for disparity, band in ((0.01, 4e-3), (0.5, 2.0 * 0.16 * 0.5 / (100.0 * 0.05))):
        look = DepthLook(depth, LENS, DepthModel(disparity=disparity, baseline=0.05))
        refine(look, T_CAMERA_OBJECT, APPLE, method="own")
        assert given[-1].limits.inlier_band == pytest.approx(band)
    assert given[-1].known.sizes is None
    given_limits = Limits(inlier_band=0.1, min_inliers=0.5)
    refine(look, T_CAMERA_OBJECT, APPLE, method="own", limits=given_limits)
    assert given[-1].limits == given_limits


@pytest.mark.parametrize(
    ("ratio", "found", "refused"),
    [
        (0.9, Curvature(0.2, 0.0, 0.95, 0.9), True),
        (0.9, Curvature(-0.2, 0.0, 0.9, 0.9), True),
        (0.951, Curvature(0.2, 0.0, 0.95, 0.9), False),
        (0.95, Curvature(0.2, 0.0, 0.95, 0.9), True),
        (0.9, Curvature(0.2, 0.0, 0.89, 0.9), False),
        (0.9, Curvature(0.21, 0.0, 0.95, 0.9), False),
        (0.9, Curvature(0.29, 0.05, 0.95, 0.9), True),
        (0.9, Curvature(0.3, 0.1, 0.95, 0.9), False),
        (0.9, Curvature(-0.21, 0.0, 0.95, 0.9), False),
        (0.9, None, False),
    ],
)
def test_only_a_surface_that_is_surely_flat_is_refused(
    ratio: float, found: Curvature | None, refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(module, "least_curvature", lambda *given: asked.append(given) or found)
    monkeypatch.setitem(FITS, "own", lambda _task, _T: result(ratio=ratio))  # type: ignore[misc]
    depth = np.arange(4800, dtype=np.float32).reshape(60, 80)
    look = DepthLook(depth, LENS, MODEL)
    if refused:
        with pytest.raises(NotItsShape) as caught:
            refine(look, T_CAMERA_OBJECT, APPLE, method="own", limits=Limits(inlier_band=9.0))
        assert (caught.value.curvature, caught.value.needed) == (found and found.least, 0.5)
    else:
        refine(look, T_CAMERA_OBJECT, APPLE, method="own", limits=Limits(inlier_band=9.0))
    for measured, _virtual, _inliers, _band, alike in asked:
        np.testing.assert_array_equal(measured, depth[20:24, 30:36])
        assert alike == 7.0


def test_a_model_is_judged_by_pixels_that_agree_differ_or_are_hidden() -> None:
    depth = np.full((60, 80), 0.4, np.float32)
    part = depth[BOX.slices]
    part[0] = 0.5  # beside the model
    part[1, :3] = 0.41 + 1e-4  # behind it
    part[1, 3:] = 0.409
    part[2, :2] = 0.349  # hidden by something
    part[2, 2] = 0.351
    part[3, :4] = 0.0, np.nan, np.inf, -1.0
    one = result()
    judge = Judge(depth, 0.01, np.array([0.06, 0.08, 0.1]), 0.1)
    assert judge.explained(one) == (8, 4)
    assert judge.aspect_penalty(one.dimensions) == pytest.approx(0.0)
    higher = np.array([0.03, 0.12, 0.05])
    assert judge.aspect_penalty(higher) == pytest.approx((np.log(3.0) / 0.1) ** 2)
    assert judge.score(one) == pytest.approx((4.0, 0.16, False))
    odd = replace(one, dimensions=np.array([0.06, 0.088, 0.1]))
    assert judge.score(odd)[0] == pytest.approx(4.0 - 0.05 * (np.log(1.1) / 0.1) ** 2 * 8)
    part[:] = 0.4
    part[1, 0] = 0.5
    assert judge.score(one) == pytest.approx((16.0, 0.34, False))
    part[1, 0] = 0.4
    assert judge.score(one)[2]


def test_the_stem_is_turned_by_the_shortest_way() -> None:
    T = transform(rot_x(0.3), (0.1, 0.0, 0.5))
    up = np.array([0.0, -np.cos(0.5), -np.sin(0.5)])
    towards, away, over = other_starts(T, Plane(up, 0.3))
    np.testing.assert_allclose(towards[:3, :3], rot_x(0.5), atol=1e-12)
    np.testing.assert_allclose(away[:3, :3], rot_x(0.5 - np.pi), atol=1e-12)
    np.testing.assert_allclose(over[:3, :3], rot_x(0.3 + np.pi), atol=1e-7)
    stems = [-start[:3, 1] for start in other_starts(T, None)]
    x, y, z = T[:3, :3].T
    half = np.sqrt(0.5)
    aside = [half * (a + turn * y) for turn in (-1.0, 1.0) for a in (x, -x, z, -z)]
    np.testing.assert_allclose(stems, [y, *aside], atol=1e-7)
