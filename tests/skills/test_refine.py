"""The Refine skill with mock devices: outputs, and one test per failure code."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Frame, Workspace
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.executive.views import ImageView
from pomona.skills.geometry import inverse, rot_x, rot_y, transform
from pomona.skills.perception.detection.detection import Detection
from pomona.skills.perception.refinement.errors import RenderFailed
from pomona.skills.perception.refinement.measure import measure as measure_fruit
from pomona.skills.perception.refinement.render import ImageBox, render_depth, usable_renderer
from pomona.skills.perception.refinement.scale_fit import moved_and_scaled
from pomona.skills.refine import Refine

T_BASE_CAMERA = transform(rot_x(2.8), (-0.04, -0.25, 0.60))
SCALE = 0.85


def measure(inputs: dict[str, object], table_z: float | None = None) -> SkillEnd:
    workspace = Workspace(table_z, np.full(3, -1.0), np.full(3, 1.0))
    return drive(Refine(), inputs, devices={Workspace: workspace})


@pytest.fixture
def detection(apple, camera) -> Detection:
    """An apple of 0.85 of the model's size, detected with the model's size at the place where it looks the same."""
    T_camera_object = transform(rot_x(-0.9) @ rot_y(0.4), (0.02, 0.01, 0.68))
    whole = ImageBox(0, 0, camera.width, camera.height)
    sigma = (1.0 - SCALE) * float(np.linalg.norm(T_camera_object[:3, 3]))
    depth, _ = render_depth(
        apple, moved_and_scaled(T_camera_object, sigma), camera, whole, using="zbuffer"
    )
    depth = np.where(depth > 0.0, depth, np.float32(0.75))
    colour = np.zeros((camera.height, camera.width, 3), np.uint8)
    frame = Frame(1.0, 0, colour, depth, camera, None, T_BASE_CAMERA, "test")
    return Detection(
        apple,
        frame,
        T_BASE_CAMERA,
        T_camera_object,
        np.full((9, 2), np.nan),
        0.9,
        1e-4 * np.eye(6),
        0,
        1,
    )


def use(renderer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pomona.skills.refine.usable_renderer", lambda _wanted: (renderer, ""))


def with_depth(detection: Detection, depth: np.ndarray | None) -> Detection:
    return replace(detection, frame=replace(detection.frame, depth=depth))


@pytest.mark.parametrize("renderer", ["pyrender", "zbuffer"])
@pytest.mark.parametrize("method", ["uniform", "paper"])
def test_measures_size_and_place_in_the_base_frame(detection, method, renderer, monkeypatch):
    use(renderer, monkeypatch)
    outcome = measure({"detection": detection, "method": method})
    assert outcome.status is Status.SUCCESS
    measured = outcome.outputs["measured"]
    np.testing.assert_allclose(measured.dimensions, SCALE * detection.fruit.dimensions, atol=2e-6)
    T_camera_fruit = inverse(T_BASE_CAMERA) @ measured.T_base_fruit
    np.testing.assert_allclose(
        T_camera_fruit[:3, 3], SCALE * detection.T_camera_object[:3, 3], atol=2e-5
    )
    np.testing.assert_allclose(
        T_camera_fruit[:3, :3], detection.T_camera_object[:3, :3], atol=1e-12
    )
    assert measured.mu == pytest.approx(SCALE, abs=2e-5)
    assert measured.sigma == pytest.approx(
        0.15 * np.linalg.norm(detection.T_camera_object[:3, 3]), abs=2e-5
    )
    assert measured.inlier_ratio > 0.99
    assert measured.method == method
    assert np.linalg.eigvalsh(measured.covariance).min() > -1e-15


def test_none_hands_the_detection_on(detection):
    outcome = measure({"detection": detection, "method": "none"})
    measured = outcome.outputs["measured"]
    np.testing.assert_allclose(measured.T_base_fruit, T_BASE_CAMERA @ detection.T_camera_object)
    np.testing.assert_allclose(measured.dimensions, detection.fruit.dimensions)
    assert (measured.mu, measured.sigma, measured.method) == (1.0, 0.0, "none")


def test_shows_the_outline_in_the_image(detection):
    outcome = measure({"detection": detection, "method": "uniform"})
    ((topic, view),) = outcome.published
    assert topic == "refine"
    assert isinstance(view, ImageView)
    measured = outcome.outputs["measured"]
    u, v = measured.contour.T
    seen = np.argwhere(detection.frame.depth < 0.74)
    assert [v.min(), u.min()] == seen.min(axis=0).tolist()
    assert [v.max(), u.max()] == seen.max(axis=0).tolist()


def reason_of(detection: Detection, **inputs: Any):
    outcome = measure({"detection": detection, **inputs})
    assert outcome.status is Status.FAILURE
    assert "measured" not in outcome.outputs
    return outcome.reason


@pytest.mark.parametrize("nothing", [0.0, np.nan])
def test_no_depth(detection, nothing):
    reason = reason_of(with_depth(detection, np.full_like(detection.frame.depth, nothing)))
    assert reason.code == "NO_DEPTH"
    assert reason.data["valid_pixels"] == 0


def test_no_depth_from_a_colour_camera(detection):
    assert reason_of(with_depth(detection, None)).code == "NO_DEPTH"


def on_table(detection: Detection, T_base_camera: np.ndarray) -> Detection:
    """The fruit before a table that stands where a camera at this pose has it, 0.6 m below the real pose."""
    lens, above = detection.frame.intrinsics, T_base_camera[2, 3] + 0.12
    v, u = np.indices((lens.height, lens.width))
    rays = np.stack([(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones(u.shape)], axis=-1)
    table = (above / -(rays @ T_base_camera[2, :3])).astype(np.float32)
    depth = detection.frame.depth
    return with_depth(detection, np.where(depth < 0.74, depth, table))


def test_pose_mismatch(detection):
    assert (
        measure({"detection": on_table(detection, T_BASE_CAMERA)}, table_z=-0.12).status
        is Status.SUCCESS
    )
    turned = T_BASE_CAMERA @ transform(rot_y(np.radians(2.0)), (0.0, 0.0, 0.004))
    outcome = measure({"detection": on_table(detection, turned)}, table_z=-0.12)
    assert outcome.reason.code == "POSE_MISMATCH"
    assert outcome.reason.data["tilt_rad"] == pytest.approx(np.radians(2.0), abs=3e-3)
    assert "calibrate hand-eye" in outcome.reason.message
    assert "measured" not in outcome.outputs
    look = dict(outcome.published)["doubted_look"]
    seen, stated = look.table[:, :3]
    assert np.arccos(seen @ stated) == pytest.approx(np.radians(2.0), abs=3e-3)
    assert look.on_arm is (detection.frame.q is not None)


def test_depth_mismatch(detection):
    tilted = T_BASE_CAMERA @ transform(rot_y(np.radians(6.0)))
    stated = replace(detection, T_base_camera=tilted)
    mirrored = with_depth(stated, on_table(detection, tilted).frame.depth[:, ::-1].copy())
    outcome = measure({"detection": mirrored}, table_z=-0.12)
    assert outcome.reason.code == "DEPTH_MISMATCH"
    assert "mirrored left to right" in outcome.reason.message


def test_no_depth_in_metres(detection):
    reason = reason_of(with_depth(detection, 1000.0 * detection.frame.depth))
    assert reason.code == "NO_DEPTH"
    assert "millimetres" in reason.message


def test_too_few_inliers(detection):
    rng = np.random.default_rng(0)
    scattered = rng.uniform(0.3, 0.9, detection.frame.depth.shape).astype(np.float32)
    reason = reason_of(with_depth(detection, scattered))
    assert reason.code == "TOO_FEW_INLIERS"
    assert reason.data["inlier_ratio"] < 0.25


def test_size_out_of_range(detection):
    reason = reason_of(with_depth(detection, 0.4 * detection.frame.depth))
    assert reason.code == "SIZE_OUT_OF_RANGE"
    assert reason.data["ratio"] == pytest.approx(0.4 * SCALE, abs=1e-3)


def test_at_bound(detection):
    reason = reason_of(with_depth(detection, 2.4 * detection.frame.depth), largest=10.0)
    assert reason.code == "AT_BOUND"
    assert reason.data["bound"] == pytest.approx(0.8 * 0.68)


@pytest.mark.parametrize("z", [-0.68, 0.02])
def test_render_failed_behind_the_camera(detection, z):
    T = detection.T_camera_object.copy()
    T[2, 3] = z
    reason = reason_of(replace(detection, T_camera_object=T))
    assert reason.code == "RENDER_FAILED"
    assert "behind the camera" in reason.message


@pytest.fixture
def zbuffer(monkeypatch):
    use("zbuffer", monkeypatch)


@pytest.fixture
def no_opengl(monkeypatch):
    def broken(*_: object) -> None:
        raise RenderFailed("pyrender cannot use EGL")

    monkeypatch.setattr("pomona.skills.perception.refinement.render._render", broken)
    usable_renderer.cache_clear()
    yield
    usable_renderer.cache_clear()


def test_without_opengl_the_z_buffer_measures_and_is_reported_once(
    detection, no_opengl, monkeypatch
):
    workspace = Workspace(None, np.full(3, -1.0), np.full(3, 1.0))
    skill = Refine()
    skill.prepare()
    first, second = (
        drive(skill, {"detection": detection}, devices={Workspace: workspace}) for _ in range(2)
    )
    use("zbuffer", monkeypatch)
    plain = measure({"detection": detection})
    for end in (first, second, plain):
        assert end.status is Status.SUCCESS
        np.testing.assert_array_equal(
            end.outputs["measured"].dimensions, plain.outputs["measured"].dimensions
        )
    said = "virtual depth comes from the z-buffer: pyrender cannot use EGL"
    assert (first.feedback, second.feedback, plain.feedback) == (said, "", "")


def test_without_opengl_the_library_measures_all_the_same(detection, no_opengl, zbuffer):
    """Skills of applications call it without a renderer of their own."""
    plain = measure({"detection": detection}).outputs["measured"]
    np.testing.assert_array_equal(
        measure_fruit(detection, table_z=None).dimensions, plain.dimensions
    )


def test_render_failed_for_a_flat_mesh(detection):
    fruit = replace(detection.fruit, vertices=detection.fruit.vertices * [1.0, 0.0, 1.0])
    reason = reason_of(replace(detection, fruit=fruit))
    assert reason.code == "RENDER_FAILED"
    assert "size in all three directions" in reason.message


def test_a_wall_is_not_its_shape(detection):
    v, u = np.indices(detection.frame.depth.shape)
    wall = (0.62 / (1.0 + 4e-4 * (u - 160) - 3e-4 * (v - 120))).astype(np.float32)
    reason = reason_of(with_depth(detection, wall), method="uniform", inlier_band=8e-3)
    assert reason.code == "NOT_ITS_SHAPE"
    assert reason.data["curvature"] == pytest.approx(0.0, abs=0.05)


def test_a_tray_under_the_fruit_is_reported_where_the_table_is_seen_beside_it(detection):
    T_camera_base = inverse(T_BASE_CAMERA)
    K = detection.frame.intrinsics
    v, u = np.indices(detection.frame.depth.shape)
    rays = np.stack([(u - K.cx) / K.fx, (v - K.cy) / K.fy, np.ones(u.shape)], -1)
    normal = T_camera_base[:3, 2]  # of the table
    lowest = T_BASE_CAMERA @ np.r_[detection.T_camera_object[:3, 3] * SCALE, 1.0]
    seen_z, told_z = lowest[2] - 0.035, lowest[2] - 0.06
    table, tray = ((T_camera_base[:3, 3] @ normal + z) / (rays @ normal) for z in (told_z, seen_z))
    apple = np.argwhere(detection.frame.depth < 0.74)
    middle, reach = apple.mean(axis=0), np.ptp(apple, axis=0).max()
    table = np.where(np.hypot(v - middle[0], u - middle[1]) < reach, tray, table)
    depth = np.where(detection.frame.depth < 0.74, detection.frame.depth, table).astype(np.float32)
    depth = np.where(np.isfinite(depth) & (depth > 0.0) & (depth < 3.0), depth, 0.0).astype(
        np.float32
    )
    end = measure({"detection": with_depth(detection, depth), "method": "uniform"}, table_z=told_z)
    assert end.status is Status.SUCCESS
    assert "a surface is seen 25 mm above the table" in end.feedback


def test_the_table_of_the_workspace_is_the_support(scene, apple, zbuffer):
    s = scene((62, 47, 62), 70, 3)
    frame = Frame(
        0.0,
        0,
        np.zeros((*s.depth.shape, 3), np.uint8),
        s.depth,
        s.intrinsics,
        None,
        s.T_base_camera,
    )
    seen = Detection(
        apple,
        frame,
        s.T_base_camera,
        s.T_camera_detected,
        np.full((9, 2), np.nan),
        0.9,
        np.eye(6),
        0,
        1,
    )
    inputs = {"detection": seen}
    on_table, in_the_air = (measure(inputs, table_z).outputs["measured"] for table_z in (0.0, None))
    assert on_table.method == "shape+plane"
    assert in_the_air.method == "shape"
    lowest = (
        apple.vertices * (on_table.dimensions / apple.dimensions) @ on_table.T_base_fruit[2, :3]
    )
    assert lowest.min() + on_table.T_base_fruit[2, 3] == pytest.approx(0.0, abs=3e-3)
    assert on_table.covariance[2, 2] <= in_the_air.covariance[2, 2]


def test_an_earlier_measurement_is_fused_in(scene, apple, zbuffer):
    measured = None
    for elevation in (35, 60, 84):
        s = scene((73, 64, 73), elevation, 4)
        frame = Frame(
            0.0,
            0,
            np.zeros((*s.depth.shape, 3), np.uint8),
            s.depth,
            s.intrinsics,
            None,
            s.T_base_camera,
        )
        seen = Detection(
            apple,
            frame,
            s.T_base_camera,
            s.T_camera_detected,
            np.full((9, 2), np.nan),
            0.9,
            np.eye(6),
            0,
            1,
        )
        before = measured
        inputs = {"detection": seen, "earlier": before}
        measured = measure(inputs).outputs["measured"]
        if before is not None:
            assert measured.method == "shape+views"
            assert measured.earlier[-1][0] is before.frame
    assert len(measured.earlier) == 2
    assert s.errors(inverse(s.T_base_camera) @ measured.T_base_fruit, measured.dimensions)[1] < 4.0


def test_interrupted_it_gives_up(detection):
    skill, devices = Refine(), {Workspace: Workspace(None, np.full(3, -1.0), np.full(3, 1.0))}
    outcome = drive(skill, {"detection": detection}, devices, computing=10, interrupt_after=5)
    assert outcome.status is Status.INVALID
    assert outcome.cancelled == 1
    assert outcome.outputs == {}
    assert outcome.published == ()
    assert drive(skill, {"detection": detection}, devices, computing=10).status is Status.SUCCESS
