"""The closed form against repeated rendering, a bounded optimiser, and scenes whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st
from scipy.optimize import minimize_scalar

from pomona.drivers.interfaces import Intrinsics
from pomona.skills.geometry import rotation_about, transform
from pomona.skills.perception.refinement import DepthLook, Limits, refine
from pomona.skills.perception.refinement.errors import (
    BadDepth,
    DepthNotInMetres,
    NoDepth,
    TooFewInliers,
)
from pomona.skills.perception.refinement.render import image_box, render_depth
from pomona.skills.perception.refinement.scale_fit import fit_scale, moved_and_scaled, sigma_bound

CAMERA = Intrinsics(610.6, 610.6, 322.3, 241.9, 640, 480)
MESHES = {
    "ball": trimesh.creation.icosphere(subdivisions=3, radius=0.045),
    "egg": trimesh.creation.icosphere(subdivisions=3, radius=0.04).apply_scale((1.0, 1.3, 0.9)),
    "block": trimesh.creation.box((0.08, 0.06, 0.07)),
    "ring": trimesh.creation.torus(0.035, 0.014),
}

meshes = st.sampled_from(sorted(MESHES))
sigmas = st.floats(-0.25, 0.25)


@st.composite
def poses(draw: st.DrawFn) -> np.ndarray:
    angle = draw(st.floats(-3.0, 3.0))
    axis = np.array([draw(st.floats(-1.0, 1.0)), draw(st.floats(-1.0, 1.0)), 1.5])
    p = [draw(st.floats(-0.12, 0.12)), draw(st.floats(-0.08, 0.08)), draw(st.floats(0.45, 0.75))]
    return transform(rotation_about(axis / np.linalg.norm(axis), angle), p)


@settings(max_examples=40)
@given(name=meshes, T=poses(), sigma=sigmas)
@pytest.mark.parametrize("using", ["pyrender", "zbuffer"])
def test_one_render_times_mu_is_the_render_at_every_sigma(using, name, T, sigma):
    mesh = MESHES[name]
    virtual, box = render_depth(mesh, T, CAMERA, using=using)
    moved, _ = render_depth(mesh, moved_and_scaled(T, sigma), CAMERA, box, using=using)
    mu = 1.0 - sigma / np.linalg.norm(T[:3, 3])
    both = (virtual > 0) & (moved > 0)
    assert np.count_nonzero((virtual > 0) != (moved > 0)) <= 0.002 * np.count_nonzero(both) + 2
    error = np.abs(moved - mu * virtual)[both]
    assert np.quantile(error, 0.99) < 1e-6  # a pixel on an edge may see the face beside it
    assert error.max() < 1e-3


@settings(max_examples=30)
@given(name=meshes, T=poses(), sigma=sigmas)
def test_scale_equals_the_bounded_optimiser_that_renders_anew(name, T, sigma):
    mesh = MESHES[name]
    virtual, box = render_depth(mesh, T, CAMERA, using="zbuffer")
    depth, _ = render_depth(mesh, moved_and_scaled(T, sigma), CAMERA, box, using="zbuffer")
    length = np.linalg.norm(T[:3, 3])

    def objective(tried: float) -> float:
        rendered, _ = render_depth(mesh, moved_and_scaled(T, tried), CAMERA, box, using="zbuffer")
        both = (rendered > 0) & (depth > 0)
        return float(np.mean((depth[both].astype(float) - rendered[both]) ** 2))

    bound = 0.8 * T[2, 3]
    search = minimize_scalar(
        objective, bounds=(-bound, bound), method="bounded", options={"xatol": 1e-9}
    )
    mu = fit_scale(depth, virtual).mu
    assert mu == pytest.approx(1.0 - search.x / length, abs=1e-6)
    assert mu == pytest.approx(1.0 - sigma / length, abs=1e-6)


def _ball_on_background(
    outliers: float, seed: int, background: float = 0.62
) -> tuple[np.ndarray, np.ndarray]:
    """A 92 mm ball at 0.55 m with 1.5 mm noise; a share of its pixels shows the table behind instead."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.046)
    virtual, _ = render_depth(
        ball, transform(translation=(0.03, 0.02, 0.55)), CAMERA, using="zbuffer"
    )
    rng = np.random.default_rng(seed)
    depth = virtual + rng.normal(0.0, 1.5e-3, virtual.shape)
    rows = np.flatnonzero((virtual > 0).any(axis=1))
    last = rows[0] + round(len(rows) * outliers)
    depth[rows[0] : last] = background + rng.normal(0.0, 1.5e-3, depth[rows[0] : last].shape)
    return depth.astype(np.float32), virtual


@pytest.mark.parametrize("outliers", [0.0, 0.1, 0.2, 0.4])
@pytest.mark.parametrize("background", [0.62, 0.56, 0.40])
def test_scale_is_unbiased_with_forty_percent_other_pixels(outliers, background):
    diameters = [
        92.0 * fit_scale(*_ball_on_background(outliers, seed, background)).mu for seed in range(5)
    ]
    assert abs(np.mean(diameters) - 92.0) < 0.2


def test_inliers_are_the_pixels_that_agree():
    depth, virtual = _ball_on_background(0.4, seed=1)
    fit = fit_scale(depth, virtual)
    agree = (virtual > 0) & (np.abs(depth - fit.mu * virtual) <= 4e-3)
    assert np.array_equal(fit.inliers, agree)
    assert fit.inlier_ratio == pytest.approx(np.count_nonzero(agree) / np.count_nonzero(virtual))
    assert fit.residual == pytest.approx(1.5e-3, rel=0.1)


def test_pixels_without_measurement_are_ignored():
    depth, virtual = _ball_on_background(0.0, seed=2)
    full = fit_scale(depth, virtual)
    depth[::3] = 0.0
    depth[1::3, ::2] = np.nan
    depth[:, ::7] = np.inf
    assert fit_scale(depth, virtual).mu == pytest.approx(full.mu, abs=2e-4)


@pytest.mark.parametrize("nothing", [0.0, np.nan, np.inf, -1.0])
def test_no_depth_is_no_measurement(nothing):
    _, virtual = _ball_on_background(0.0, seed=0)
    with pytest.raises(NoDepth) as caught:
        fit_scale(np.full_like(virtual, nothing), virtual)
    assert caught.value.valid_pixels == 0
    assert caught.value.model_pixels == np.count_nonzero(virtual)


def test_millimetres_are_named():
    depth, virtual = _ball_on_background(0.1, seed=0)
    with pytest.raises(DepthNotInMetres, match="millimetres"):
        fit_scale(1000.0 * depth, virtual)


def test_images_of_different_shape_are_refused():
    depth, virtual = _ball_on_background(0.0, seed=0)
    with pytest.raises(BadDepth, match="shape"):
        fit_scale(depth[1:], virtual)


def test_box_holds_the_whole_model():
    T = transform(translation=(0.02, -0.03, 0.5))
    virtual, box = render_depth(MESHES["egg"], T, CAMERA, using="zbuffer")
    assert box == image_box(MESHES["egg"], T, CAMERA)
    assert not virtual[[0, -1]].any()
    assert not virtual[:, [0, -1]].any()


@settings(max_examples=60)
@given(
    depths=st.lists(st.floats(0.05, 3.0), min_size=40, max_size=60),
    band=st.floats(1e-6, 0.05),
)
def test_any_depth_gives_a_supported_scale_or_a_refusal(depths, band):
    depth = np.array(depths, np.float32)[None]
    virtual = np.linspace(0.4, 0.6, len(depths), dtype=np.float32)[None]
    try:
        fit = fit_scale(depth, virtual, band)
    except TooFewInliers:
        return
    assert np.isfinite([fit.mu, fit.variance, fit.residual]).all()
    assert fit.inliers.any()
    assert fit.residual <= band


def test_sigma_moves_along_the_ray_and_scales_with_the_distance():
    T = np.eye(4)
    T[:3, 3] = [0.1, -0.2, 0.5]
    moved = moved_and_scaled(T, 0.1)
    length = np.linalg.norm(T[:3, 3])
    assert np.linalg.norm(moved[:3, 3]) == pytest.approx(length - 0.1)
    np.testing.assert_allclose(np.cross(moved[:3, 3], T[:3, 3]), 0.0, atol=1e-12)
    np.testing.assert_allclose(moved[:3, :3], np.eye(3) * (length - 0.1) / length)
    assert sigma_bound(T[:3, 3]) == pytest.approx(0.4)


@pytest.mark.parametrize("elevation", [35, 60, 80])
def test_both_methods_agree_on_noisy_depth(scene, apple, elevation):
    """They choose their inliers differently; with the inliers alike, so is the scale."""
    s = scene((89, 81, 89), elevation, 1)
    results = [
        refine(
            DepthLook(s.depth, s.intrinsics, renderer="zbuffer"),
            s.T_camera_detected,
            apple,
            method=method,
            limits=Limits(8e-3),
        )
        for method in ("uniform", "paper")
    ]
    assert results[0].mu == pytest.approx(results[1].mu, abs=4e-3)
    assert (
        np.linalg.norm(results[0].T_camera_object[:3, 3] - results[1].T_camera_object[:3, 3]) < 3e-3
    )
    assert results[1].method == "paper"
