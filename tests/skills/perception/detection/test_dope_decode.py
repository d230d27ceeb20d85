"""DOPE's decoder, against a slow one written from its description, and against hostile maps."""

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.ndimage import gaussian_filter

from pomona.skills.perception.detection.dope_decode import (
    DecodedObject,
    DecodeThresholds,
    decode_maps,
    load_pose_config,
)
from pomona.skills.perception.detection.errors import BadMaps, BadPoseConfig


def draw_maps(objects: list[np.ndarray], height: int = 50, width: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Belief and affinity of objects given as (9, 2) keypoints in cells."""
    v, u = np.mgrid[0:height, 0:width]
    belief, affinity = np.zeros((9, height, width), np.float32), np.zeros((16, height, width), np.float32)
    for points in objects:
        for k, (a, b) in enumerate(points):
            blob = np.exp(-((u - a) ** 2 + (v - b) ** 2) / (2 * 1.5**2))
            belief[k] = np.maximum(belief[k], blob)
            if k < 8:
                direction = (points[8] - points[k]) / np.linalg.norm(points[8] - points[k])
                near = np.hypot(u - a, v - b) < 4
                affinity[2 * k][near], affinity[2 * k + 1][near] = direction
    return belief, affinity


def random_object(rng: np.random.Generator, centre: tuple[float, float]) -> np.ndarray:
    angles = np.arange(8) * np.pi / 4 + rng.uniform(0, 0.5)
    corners = np.asarray(centre) + 8 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.vstack([corners, [centre]])


def slow_decode(belief: np.ndarray, affinity: np.ndarray, t: DecodeThresholds) -> list[tuple[np.ndarray, float]]:
    """Peak by peak and candidate by candidate, as the post-processing is described."""
    height, width = belief.shape[1:]
    peaks: list[list[tuple[float, float, float]]] = []
    for one in belief:
        smooth = gaussian_filter(one, sigma=t.sigma)
        found = []
        for y in range(height):
            for x in range(width):
                around = [
                    smooth[y + b, x + a] if 0 <= y + b < height and 0 <= x + a < width else 0.0
                    for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1))
                ]
                if smooth[y, x] <= t.thresh_map or smooth[y, x] < max(around):
                    continue
                cells = [
                    (x + i, y + j, float(one[y + j, x + i]))
                    for i in range(-5, 6)
                    for j in range(-5, 6)
                    if 0 <= x + i < width and 0 <= y + j < height
                ]
                total = sum(c[2] for c in cells)
                mean_x = sum(c[0] * c[2] for c in cells) / total if total else x
                mean_y = sum(c[1] * c[2] for c in cells) / total if total else y
                found.append((mean_x + 0.4395, mean_y + 0.4395, float(one[y, x])))
        peaks.append(found)
    objects = [(np.full((9, 2), np.nan), score, (x, y)) for x, y, score in peaks[8] if score > t.thresh_points]
    for points, _, centre in objects:
        points[8] = np.array(centre) * 8
    nearest = [[np.inf] * 8 for _ in objects]
    for k in range(8):
        for x, y, score in peaks[k]:
            if score < t.thresh_points:
                continue
            field = affinity[2 * k : 2 * k + 2, int(y), int(x)]
            best, owner = np.inf, -1
            for i, (_, _, centre) in enumerate(objects):
                away = np.array(centre) - (x, y)
                norm = np.linalg.norm(field)
                if norm == 0 or np.linalg.norm(away / np.linalg.norm(away) - field / norm) >= t.thresh_angle:
                    continue
                if np.linalg.norm(away) < best:
                    best, owner = float(np.linalg.norm(away)), i
            if owner >= 0 and best < nearest[owner][k]:
                nearest[owner][k] = best
                objects[owner][0][k] = (x * 8, y * 8)
    return [(points, score) for points, score, _ in objects]


def assert_same(fast: list[DecodedObject], slow: list[tuple[np.ndarray, float]]) -> None:
    assert len(fast) == len(slow)
    for found, (points, score) in zip(fast, slow, strict=True):
        assert np.allclose(found.keypoints, points, atol=1e-4, equal_nan=True)
        assert np.isclose(found.score, score)


def test_keypoints_of_drawn_objects_come_back_with_dopes_offset() -> None:
    rng = np.random.default_rng(0)
    objects = [random_object(rng, (14.0, 15.0)), random_object(rng, (40.0, 30.0))]
    found = decode_maps(*draw_maps(objects))
    assert len(found) == 2
    for one, points in zip(found, objects, strict=True):
        assert np.allclose(one.keypoints, (points + 0.4395) * 8, atol=0.4)
        assert one.score > 0.9


def test_decoder_agrees_with_a_slow_one_on_crowded_noisy_maps() -> None:
    rng = np.random.default_rng(1)
    for _ in range(4):
        objects = [random_object(rng, tuple(rng.uniform((5, 5), (55, 45)))) for _ in range(4)]
        belief, affinity = draw_maps(objects)
        belief = (belief * rng.uniform(0.3, 1.0) + rng.normal(0, 0.02, belief.shape)).astype(np.float32)
        affinity = (affinity + rng.normal(0, 0.2, affinity.shape)).astype(np.float32)
        thresholds = DecodeThresholds(sigma=1.0 if rng.random() < 0.5 else 3.0)
        assert_same(decode_maps(belief, affinity, thresholds), slow_decode(belief, affinity, thresholds))


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_decoder_agrees_with_a_slow_one_on_arbitrary_maps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    belief = rng.uniform(-0.1, 0.6, (9, 12, 14)).astype(np.float32)
    affinity = rng.uniform(-1, 1, (16, 12, 14)).astype(np.float32)
    thresholds = DecodeThresholds(sigma=float(rng.uniform(0.5, 2.0)))
    assert_same(decode_maps(belief, affinity, thresholds), slow_decode(belief, affinity, thresholds))


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0, np.nan, np.inf, -1.0])
def test_maps_that_are_all_equal_return_at_once(value: float) -> None:
    start = time.process_time()
    decode_maps(np.full((9, 60, 80), value), np.full((16, 60, 80), value))
    assert time.process_time() - start < 2.0


def test_hundreds_of_peaks_return_in_bounded_time() -> None:
    belief = np.zeros((9, 120, 160), np.float32)
    belief[:, ::3, ::3] = 1.0
    start = time.process_time()
    found = decode_maps(belief, np.ones((16, 120, 160)), DecodeThresholds(sigma=0.5))
    assert time.process_time() - start < 3.0
    assert len(found) <= 200


@pytest.mark.parametrize(
    ("belief", "affinity"),
    [((8, 5, 5), (16, 5, 5)), ((9, 5, 5), (16, 5, 6)), ((9, 5), (16, 5)), ((9, 0, 0), (16, 0, 0))],
)
def test_maps_of_other_shapes_are_refused(belief: tuple[int, ...], affinity: tuple[int, ...]) -> None:
    with pytest.raises(BadMaps, match="belief"):
        decode_maps(np.zeros(belief), np.zeros(affinity))


PLAIN = """
topic_camera: "/camera/image_raw"
input_is_rectified: True
downscale_height: 400
weights: {"apple": "package://dope/weights/apple.pth", soup: soup.pth}
dimensions: {"apple": [9.756, 8.539, 9.590], soup: [6.7659378051757813, 10.185500144958496, 6.771425724029541]}
class_ids: {"apple": 3}
draw_colors: {"apple": [13, 255, 128]}
model_transforms:
  apple: [[0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]]
meshes: {apple: "file:///apple.dae"}
mesh_scales: {apple: 0.01}
thresh_angle: 0.4
thresh_map: 0.02
sigma: 2
thresh_points: 0.2
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "config_pose.yaml"
    path.write_text(text)
    return path


def test_everything_in_a_plain_file_is_read_in_si_units(tmp_path: Path) -> None:
    config = load_pose_config(write(tmp_path, PLAIN))
    apple = config.objects["apple"]
    assert np.allclose(apple.dimensions, (0.09756, 0.08539, 0.09590))
    assert apple.weights == "package://dope/weights/apple.pth"
    assert (apple.class_id, apple.draw_colour, apple.mesh, apple.mesh_scale) == (
        3,
        (13, 255, 128),
        "file:///apple.dae",
        0.01,
    )
    assert apple.model_transform[0].tolist() == [0, 0, 1, 0]
    assert config.objects["soup"].class_id == 0
    t = config.thresholds
    assert (t.thresh_angle, t.thresh_map, t.sigma, t.thresh_points) == (0.4, 0.02, 2.0, 0.2)
    assert (config.downscale_height, config.input_is_rectified) == (400, True)


def test_thresholds_that_are_not_given_are_dopes(tmp_path: Path) -> None:
    t = load_pose_config(write(tmp_path, "weights: {a: a.pth}\ndimensions: {a: [1, 2, 3]}\n")).thresholds
    assert (t.thresh_angle, t.thresh_map, t.sigma, t.thresh_points) == (0.5, 0.01, 3.0, 0.1)


def test_a_file_of_the_newer_tools_names_its_objects_by_their_dimensions(tmp_path: Path) -> None:
    text = "downscale_height: 512\nthresh_points: 0.0\n"
    text += "dimensions: {soup: [6.8, 10.2, 6.8], apple: [9.756, 8.539, 9.590]}\n"
    config = load_pose_config(write(tmp_path, text))
    assert list(config.objects) == ["soup", "apple"]
    assert config.objects["apple"].weights == ""
    assert (config.downscale_height, config.thresholds.thresh_points) == (512, 0.0)


def test_entries_nested_as_ros_parameters_are_found(tmp_path: Path) -> None:
    nested = "dope:\n  ros__parameters:\n    weights: {a: a.pth}\n    dimensions: {a: [1, 2, 3]}\n"
    assert load_pose_config(write(tmp_path, nested)).objects["a"].weights == "a.pth"


def test_flat_sixteen_numbers_are_a_transform(tmp_path: Path) -> None:
    text = "weights: {a: a.pth}\ndimensions: {a: [1, 2, 3]}\n"
    text += "model_transforms: {a: [1,0,0,5, 0,1,0,6, 0,0,1,7, 0,0,0,1]}\n"
    assert load_pose_config(write(tmp_path, text)).objects["a"].model_transform[:3, 3].tolist() == [5, 6, 7]


ONE = "weights: {a: b}\ndimensions: {a: [1, 2, 3]}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- a\n", "mapping"),
        ("a: [", "cannot be read"),
        ("topic: x\nsigma: 3\n", "names no dimensions of any object"),
        ("weights: {a: b}\nsigma: 3\n", "names no dimensions of any object"),
        ("weights: {a: b}\ndimensions: {c: [1, 2, 3]}\n", "a has weights but no dimensions"),
        ("weights: {a: b}\ndimensions: {a: [1, 2]}\n", "dimensions of a"),
        ("weights: {a: b}\ndimensions: {a: wide}\n", "dimensions of a"),
        ("weights: {a: b}\ndimensions: {a: [1, 2, 3]}\nsigma: big\n", "sigma must be numbers, not 'big'"),
        (ONE + "sigma: .nan\n", "sigma must be a finite number, not nan"),
        (ONE + "thresh_map:\n", "thresh_map must be a finite number, not None"),
        (ONE + "downscale_height: .inf\n", "downscale_height must be a finite number"),
        (ONE + "downscale_height: 0\n", "downscale_height must be positive"),
        (ONE + "class_ids: {a: one}\n", "class_ids of a must be numbers, not 'one'"),
        (ONE + "class_ids: {a: }\n", "class_ids of a must be a finite number"),
        (ONE + "mesh_scales: {a: }\n", "mesh_scales of a must be a finite number"),
        (ONE + "mesh_scales: {a: [1, 1]}\n", "mesh_scales of a must be a finite number"),
        (ONE + "mesh_scales: {a: 0}\n", "mesh_scales of a must be positive"),
        (ONE + "draw_colors: {a: red}\n", "draw_colors of a must be numbers"),
        ("weights: [a]\ndimensions: {a: [1, 2, 3]}\n", "must map"),
    ],
)
def test_files_that_cannot_be_used_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(BadPoseConfig, match=message):
        load_pose_config(write(tmp_path, text))
