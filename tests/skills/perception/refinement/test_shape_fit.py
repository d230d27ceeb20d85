"""The stretched model against points that were taken from a stretched model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from benchmarks.synthetic_depth import D435I, as_d435i, looking_at, standing, true_depth
from pomona.drivers.depth_model import DepthModel
from pomona.drivers.interfaces import Intrinsics
from pomona.skills.geometry import inverse, rot_x, rot_y, rotation_about, transform
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.refinement.cloud import (
    Cloud,
    Plane,
    cloud,
    horizontal_plane,
    together,
)
from pomona.skills.perception.refinement.render import DepthLook, render_depth
from pomona.skills.perception.refinement.shape_fit import (
    FEW_POINTS,
    RIGID,
    Form,
    Priors,
    ShapeFit,
    covariance_of,
    fit_shape,
    step_until_still,
)

APPLE = load_fruit("apple")
CAMERA = Intrinsics(305.3, 305.3, 159.5, 119.5, 320, 240)
UPRIGHT = transform(rot_x(-0.9) @ rot_y(0.3), (0.03, -0.02, 0.6))


def seen(points):
    """Points as a camera at the origin sees them, with a millimetre of noise."""
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    return Cloud(points, rays, np.full(len(points), 1e-3), np.zeros(len(points)), 12.0)


def seen_points(T, stretch, count: int = 2500) -> Cloud:
    """Points of the stretched apple's surface that face the camera, from the faces' centres."""
    stretched = APPLE.vertices * stretch
    corners = stretched[APPLE.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ T[:3, :3].T
    points = corners.mean(axis=1) @ T[:3, :3].T + T[:3, 3]
    facing = np.sum(normals * points, axis=1) < 0.0
    points = points[facing][:count]
    return seen(points)


@settings(max_examples=25)
@given(
    width=st.floats(0.6, 1.2),
    aspect=st.floats(0.8, 1.15),
    tilt=st.floats(-0.25, 0.25),
    about=st.floats(-3.1, 3.1),
)
def test_finds_the_stretch_and_tilt_of_exact_points(width, aspect, tilt, about):
    stretch = width * np.array([1.0 / 0.983, aspect, 1.0])  # a round section, as apples have
    axis = np.array([np.cos(about), 0.0, np.sin(about)])
    T_true = UPRIGHT.copy()
    T_true[:3, :3] = UPRIGHT[:3, :3] @ rotation_about(axis, tilt)
    start = UPRIGHT.copy()
    start[:3, 3] += [0.002, -0.002, 0.003]
    fit = fit_shape(seen_points(T_true, stretch), APPLE, start, width)
    np.testing.assert_allclose(
        fit.stretch * APPLE.dimensions, stretch * APPLE.dimensions, atol=1e-3
    )
    np.testing.assert_allclose(fit.T_camera_object[:3, 3], T_true[:3, 3], atol=1e-3)
    assert fit.T_camera_object[:3, 1] @ T_true[:3, 1] > np.cos(np.radians(3.0))
    assert fit.share > 0.95


def test_rigid_priors_leave_one_scale_and_the_axis():
    stretch = np.array([0.9, 0.8, 0.9])
    fit = fit_shape(seen_points(UPRIGHT, stretch), APPLE, UPRIGHT, 0.85, priors=RIGID)
    assert np.ptp(fit.stretch) < 2e-3
    assert fit.T_camera_object[:3, 1] @ UPRIGHT[:3, 1] > 1.0 - 1e-6


def test_hidden_height_is_as_uncertain_as_its_prior_says():
    """Only the cap around the stem is visible: the height follows mostly from the prior."""
    from_above = transform(rot_x(-np.pi / 2), (0.0, 0.0, 0.6))
    cap = seen_points(from_above, np.ones(3))
    cap = cap.chosen(cap.points[:, 2] < 0.58)
    loose, tight = (
        fit_shape(cap, APPLE, from_above, 1.0, priors=Priors(aspect=a)) for a in (0.2, 0.02)
    )
    deviation = [np.sqrt(f.covariance[4, 4]) for f in (loose, tight)]
    assert deviation[0] > 1.4 * deviation[1]
    standing = Plane(np.array([0.0, 0.0, -1.0]), 0.6 + APPLE.dimensions[1] / 2.0)
    on_table = fit_shape(cap, APPLE, from_above, 1.0, support=standing, priors=Priors(aspect=0.2))
    assert on_table.on_support
    assert np.sqrt(on_table.covariance[4, 4]) < 0.5 * deviation[0]


@pytest.mark.parametrize("gap", [0.03, -0.03])
def test_a_support_far_from_the_fruit_is_not_used(gap):
    from_above = transform(rot_x(-np.pi / 2), (0.0, 0.0, 0.6))
    far = Plane(np.array([0.0, 0.0, -1.0]), 0.6 + APPLE.dimensions[1] / 2.0 + gap)
    fit = fit_shape(seen_points(from_above, np.ones(3)), APPLE, from_above, 1.0, support=far)
    assert not fit.on_support
    assert fit.stretch == pytest.approx(np.array([1.0, 1.0, 1.0]), abs=0.03)


@pytest.mark.parametrize("wrong", [-0.01, 0.01])
def test_a_support_that_the_look_does_not_show_may_be_wrong_by_ten_millimetres(wrong):
    T_base_camera, fruit = looking_at([0.0, 0.0, 0.04], 0.5, 0.7), standing(APPLE, APPLE.dimensions)
    at = inverse(T_base_camera) @ fruit.T_base_object
    depth = true_depth([fruit], T_base_camera, CAMERA, table=False).astype(np.float32)
    points = cloud(
        DepthLook(depth, CAMERA, DepthModel(disparity=0.08)),
        render_depth(APPLE, at, CAMERA, using="zbuffer")[1],
    )
    fit = fit_shape(points, APPLE, at, 1.0, support=horizontal_plane(T_base_camera, wrong))
    assert fit.on_support
    assert abs(np.log(fit.stretch[1])) < 2.0 * np.sqrt(fit.covariance[4, 4])
    assert abs(fit.stretch[1] - 1.0) * APPLE.dimensions[1] < 5e-3


def test_points_of_something_else_are_left_out():
    stretch = np.full(3, 0.9)
    fruit = seen_points(UPRIGHT, stretch)
    rng = np.random.default_rng(0)
    clutter = rng.uniform(-0.06, 0.06, (600, 3)) + UPRIGHT[:3, 3]
    other = seen(clutter)
    fit = fit_shape(together([fruit, other]), APPLE, UPRIGHT, 0.92)
    np.testing.assert_allclose(fit.stretch[[0, 2]], 0.9, atol=0.02)
    np.testing.assert_allclose(fit.T_camera_object[:3, 3], UPRIGHT[:3, 3], atol=1.5e-3)


def test_no_points_leave_the_start():
    nowhere = np.full((200, 3), 9.0)
    fit = fit_shape(seen(nowhere), APPLE, UPRIGHT, 0.9)
    assert fit.share == 0.0
    np.testing.assert_allclose(
        fit.T_camera_object, UPRIGHT, atol=1e-3
    )  # the centre goes to the axis
    assert np.exp(np.log(fit.stretch).mean()) == pytest.approx(0.9, rel=1e-3)


def test_without_points_the_fruit_is_as_uncertain_as_its_priors_say():
    few = seen(np.full((3, 3), 9.0))
    covariance = fit_shape(few, APPLE, UPRIGHT, 0.9, at_most=FEW_POINTS).covariance
    np.testing.assert_allclose(covariance[:3, :3], 0.01**2 * np.eye(3), atol=1e-9)
    size, aspect, roundness = 0.15**2, 0.12**2, 0.03**2
    # ln stretch of the size, of height over width, and of one width over the other
    ways = np.array([[1.0, 1.0, 1.0], [-1 / 3, 2 / 3, -1 / 3], [0.5, 0.0, -0.5]])
    of_priors = ways.T @ np.diag([size, aspect, roundness]) @ ways
    np.testing.assert_allclose(covariance[3:, 3:], of_priors, rtol=1e-6, atol=1e-12)


def test_the_covariance_adds_form_errors_and_the_common_error_of_depth():
    fit = ShapeFit(
        transform(translation=(0.1, 0.0, 0.5)), np.ones(3), np.diag(np.arange(1.0, 7.0)), 1.0, False
    )
    sizes = np.array([0.06, 0.08, 0.1])
    of_fit = 0.75 * np.diag([1.0, 2.0, 3.0, *np.array([4.0, 5.0, 6.0]) * sizes**2])
    change = [0.1, 0.0, 0.5, 0.06, 0.08, 0.1]
    for on_support, height in ((False, 0.012), (True, 0.004)):
        found = covariance_of(replace(fit, on_support=on_support), sizes, 0.02, 0.5, 3e-4)
        form = 0.08 / 0.5 * np.array([0.01, 0.01, 0.01, 0.003, height, 0.003])
        form[3:] = np.hypot(form[3:], 3e-4)
        whole = 0.02**2 * np.outer(change, change)
        np.testing.assert_allclose(found, of_fit + np.diag(form**2) + whole, rtol=1e-12)


def test_a_camera_whose_depth_errs_more_leaves_the_fruit_less_surely_known():
    camera = Intrinsics(610.6, 610.6, 79.5, 59.5, 160, 120)
    at = transform(rot_x(-0.9), (0.0, 0.0, 0.6))
    depth, box = render_depth(APPLE, at, camera, using="zbuffer")
    whole = np.zeros((camera.height, camera.width), np.float32)
    whole[box.slices] = depth
    near, far = (
        cloud(DepthLook(whole, camera, DepthModel(disparity, 0.05)), box)
        for disparity in (0.08, 0.32)
    )
    assert far.deviation == pytest.approx(4.0 * near.deviation)
    surely, hardly = (fit_shape(points, APPLE, at, 1.0).covariance for points in (near, far))
    assert np.all(np.sqrt(np.diag(hardly)[:3]) > 1.2 * np.sqrt(np.diag(surely)[:3]))


def test_widths_of_far_fruit_are_as_uncertain_as_stated():
    lemon, model, ratios = load_fruit("lemon"), DepthModel(disparity=0.08), []
    for seed in range(12):
        rng = np.random.default_rng([57, seed])
        T_base_camera = looking_at([0.0, 0.0, 0.04], rng.uniform(1.0, 1.2), rng.uniform(0.4, 1.2))
        fruit = standing(lemon, lemon.dimensions, tilt=0.1, azimuth=rng.uniform(-3.0, 3.0))
        at = inverse(T_base_camera) @ fruit.T_base_object
        depth = as_d435i(true_depth([fruit], T_base_camera, D435I), rng)
        virtual, box = render_depth(lemon, at, D435I, using="zbuffer")
        fit = fit_shape(cloud(DepthLook(depth, D435I, model), box, virtual > 0.0), lemon, at, 1.0)
        ratios.append(np.log(fit.stretch[[0, 2]]) / np.sqrt(np.diag(fit.covariance)[[3, 5]]))
    assert np.sqrt(np.mean(np.square(ratios))) < 1.1


@pytest.mark.parametrize("turned", [-0.3, 0.25])
def test_a_fruit_that_is_not_round_is_turned_about_its_stem_until_it_fits(turned):
    mango = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    mango.apply_scale([0.055, 0.04, 0.032])
    T_true = transform(rot_x(-0.9) @ rot_y(0.5), (0.0, 0.0, 0.5))
    virtual, box = render_depth(mango, T_true, CAMERA, using="zbuffer")
    depth = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    depth[box.slices] = virtual
    start = T_true @ transform(rot_y(turned))
    fit = fit_shape(cloud(DepthLook(depth, CAMERA, DepthModel()), box), mango, start, 1.0)
    assert np.degrees(np.arccos(fit.T_camera_object[:3, 0] @ T_true[:3, 0])) < 3.0
    assert fit.stretch == pytest.approx([1.0, 1.0, 1.0], abs=0.03)


def test_all_fits_use_one_compilation():
    points, tilted = (
        seen_points(UPRIGHT, np.ones(3)),
        np.linalg.qr(np.array([[0.0, 0.5, 0.1]] * 3) + np.eye(3))[0],
    )
    for normal in (np.array([0.0, 0.0, -1.0]), tilted[:, 0]):
        fit_shape(points, APPLE, UPRIGHT, 1.0, support=Plane(normal, 0.6))
    assert len(step_until_still.signatures) == 1


BALL = trimesh.creation.icosphere(subdivisions=5, radius=0.05)


def test_cuboid_of_a_leaning_fruit_is_higher():
    upright = Form.scaled(BALL, 1.0)
    leaning = replace(upright, lean=np.array([0.05, 0.02]), stretch=np.array([1.0, 1.1, 0.9]))
    assert upright.cuboid(BALL)[1] == pytest.approx([0.1, 0.1, 0.1], rel=1e-3)
    assert upright.cuboid(BALL)[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    x, y, z = BALL.vertices.T
    placed = np.array([x, 1.1 * y * (1.0 + (0.05 * x + 0.02 * z) / leaning.radius[0]), 0.9 * z])
    centre, sizes = leaning.cuboid(BALL)
    np.testing.assert_allclose(sizes, np.ptp(placed, axis=1))
    np.testing.assert_allclose(centre, 0.5 * (placed.min(axis=1) + placed.max(axis=1)), atol=1e-12)


def test_nearly_round_models_are_known(apple):
    assert Form.scaled(apple, 1.0).nearly_round
    assert not Form.scaled(trimesh.creation.box((0.1, 0.05, 0.08)), 1.0).nearly_round
