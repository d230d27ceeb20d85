"""Rendered frames: reproducible, and labelled with their contents."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.skills.perception.detection.close_look import STEM_AXIS, label_rotation
from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.tools.training.annotations import read_annotation
from pomona.tools.training.dataset import frame_paths, render_dataset
from pomona.tools.training.options import SceneKind, SceneOptions
from pomona.tools.training.scene import render_scene

SMALL = SceneOptions(width=320, height=240, camera=(305.3, 305.3, 158.6, 118.8))


@pytest.fixture(scope="module")
def apple() -> FruitModel:
    return load_fruit("apple")


def test_a_seed_gives_the_same_frame_again(apple: FruitModel) -> None:
    first, second = render_scene(apple, SMALL, 5), render_scene(apple, SMALL, 5)
    assert np.array_equal(first.colour, second.colour)
    assert all(
        np.array_equal(a.keypoints, b.keypoints)
        for a, b in zip(first.fruit, second.fruit, strict=True)
    )
    assert not np.array_equal(first.colour, render_scene(apple, SMALL, 6).colour)


@pytest.mark.parametrize("kind", list(SceneKind))
def test_truth_agrees_with_the_picture(apple: FruitModel, kind: SceneKind) -> None:
    chances = tuple(float(k is kind) for k in SceneKind)
    options = SceneOptions(width=320, height=240, camera=SMALL.camera, kinds=chances, distractors=0)  # type: ignore[arg-type]
    fx, fy, cx, cy = options.camera
    seen = 0
    for seed in range(6):
        frame = render_scene(apple, options, seed)
        assert frame.kind is kind
        for truth in frame.fruit:
            T = truth.T_camera_object
            corners = cuboid(truth.scale * apple.dimensions) @ T[:3, :3].T + T[:3, 3]
            assert np.allclose(
                truth.keypoints[:8],
                corners[:, :2] / corners[:, 2:] * (fx, fy) + (cx, cy),
                atol=1e-6,
            )
            assert np.allclose(
                T[:3, :3], label_rotation(T[:3, :3] @ STEM_AXIS, T[:3, 3]), atol=1e-6
            )
            x, y, w, h = truth.box
            if truth.visibility < 0.97 or x == 0 or y == 0 or x + w == 320 or y + h == 240:
                continue
            # A whole fruit's pixels are centred on its centroid and as wide as its outline.
            seen += 1
            assert np.hypot(
                x + w / 2 - truth.keypoints[8, 0], y + h / 2 - truth.keypoints[8, 1]
            ) < 0.12 * max(w, h)
            largest = fx * truth.dimensions.max() / T[2, 3]
            assert 0.75 * largest < max(w, h) < 1.25 * largest
            u, v = np.round(truth.keypoints[8]).astype(int)
            assert (
                0.2 * truth.dimensions.min()
                < T[2, 3] - frame.depth[v, u]
                < 0.6 * truth.dimensions.max()
            )
    assert seen >= 3


def cuboid(dimensions: np.ndarray) -> np.ndarray:
    signs = [
        (1, -1, 1),
        (-1, -1, 1),
        (-1, 1, 1),
        (1, 1, 1),
        (1, -1, -1),
        (-1, -1, -1),
        (-1, 1, -1),
        (1, 1, -1),
    ]
    return np.array(signs) * dimensions / 2


def test_sizes_and_proportions_vary_as_asked(apple: FruitModel) -> None:
    truths = [t for seed in range(25) for t in render_scene(apple, SMALL, seed).fruit]
    widths = np.array([0.5 * (t.dimensions[0] + t.dimensions[2]) for t in truths])
    ratios = np.array([t.dimensions[1] for t in truths]) / widths
    reference = 0.5 * (apple.dimensions[0] + apple.dimensions[2])
    assert 0.59 < widths.min() / reference < 0.68
    assert 1.05 < widths.max() / reference < 1.16
    assert 0.74 < ratios.min() < 0.80
    assert 0.95 < ratios.max() < 1.01
    assert any(np.array_equal(t.dimensions, apple.dimensions) for t in truths)
    assert any(t.visibility < 0.6 for t in truths)


def test_scale_is_the_best_fit_of_the_cad_model(apple: FruitModel) -> None:
    truth = render_scene(apple, SMALL, 3).fruit[0]
    errors = [
        np.linalg.norm(truth.dimensions - s * apple.dimensions)
        for s in (truth.scale - 1e-3, truth.scale, truth.scale + 1e-3)
    ]
    assert errors[1] == min(errors)


def test_frames_hold_the_promised_fruit_and_distractors(apple: FruitModel) -> None:
    floating = SceneOptions(width=320, height=240, camera=SMALL.camera, kinds=(0, 1, 0, 0))
    frames = [render_scene(apple, floating, seed) for seed in range(8)]
    assert all(len(f.fruit) <= 10 for f in frames)
    assert np.median([len(f.fruit) for f in frames]) >= 5
    assert np.median([len(f.decoys) for f in frames]) >= 4


@pytest.mark.slow
def test_data_sets_do_not_depend_on_workers_and_go_on_where_they_stopped(tmp_path: Path) -> None:
    alone, together = tmp_path / "alone", tmp_path / "together"
    reported: list[tuple[int, int]] = []
    report = render_dataset(
        alone, 3, seed=4, options=SMALL, workers=1, progress=lambda a, b: reported.append((a, b))
    )
    assert (report.rendered, report.kept) == (3, 0)
    assert reported[-1] == (3, 3)
    picture, annotation = frame_paths(alone, 1)
    before = picture.read_bytes()
    annotation.unlink()
    assert render_dataset(alone, 3, seed=4, options=SMALL, workers=1).rendered == 1
    assert picture.read_bytes() == before
    render_dataset(together, 21, seed=4, options=SMALL, workers=2)
    assert frame_paths(together, 1)[0].read_bytes() == before
    labels = read_annotation(frame_paths(together, 1)[1])
    assert (labels.width, labels.height) == (320, 240)
    assert cv2.imread(str(picture)).shape == (240, 320, 3)


def test_another_fruit_needs_its_mesh_and_entry_only() -> None:
    lemon = load_fruit("lemon")
    frame = render_scene(lemon, SMALL, 2)
    assert frame.fruit
    ratios = [t.dimensions[1] / (0.5 * (t.dimensions[0] + t.dimensions[2])) for t in frame.fruit]
    own = lemon.dimensions[1] / lemon.dimensions[0]
    assert all(0.8 * own < ratio < 1.2 * own for ratio in ratios)
