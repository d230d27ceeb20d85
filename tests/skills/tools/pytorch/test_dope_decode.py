"""DOPE's decoder, against a slow one written from its description, and against hostile maps."""

import time

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.ndimage import gaussian_filter

from pomona.skills.perception.detection.dope_config import DecodeThresholds
from pomona.skills.perception.detection.errors import BadMaps
from pomona.tools.pytorch.dope_decode import DecodedObject, decode_maps


def draw_maps(
    objects: list[np.ndarray], height: int = 50, width: int = 60
) -> tuple[np.ndarray, np.ndarray]:
    """Belief and affinity of objects given as (9, 2) keypoints in cells."""
    v, u = np.mgrid[0:height, 0:width]
    belief, affinity = (
        np.zeros((9, height, width), np.float32),
        np.zeros((16, height, width), np.float32),
    )
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


def slow_decode(
    belief: np.ndarray, affinity: np.ndarray, t: DecodeThresholds
) -> list[tuple[np.ndarray, float]]:
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
    objects = [
        (np.full((9, 2), np.nan), score, (x, y))
        for x, y, score in peaks[8]
        if score > t.thresh_points
    ]
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
                if (
                    norm == 0
                    or np.linalg.norm(away / np.linalg.norm(away) - field / norm) >= t.thresh_angle
                ):
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
        belief = (belief * rng.uniform(0.3, 1.0) + rng.normal(0, 0.02, belief.shape)).astype(
            np.float32
        )
        affinity = (affinity + rng.normal(0, 0.2, affinity.shape)).astype(np.float32)
        thresholds = DecodeThresholds(sigma=1.0 if rng.random() < 0.5 else 3.0)
        assert_same(
            decode_maps(belief, affinity, thresholds), slow_decode(belief, affinity, thresholds)
        )


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_decoder_agrees_with_a_slow_one_on_arbitrary_maps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    belief = rng.uniform(-0.1, 0.6, (9, 12, 14)).astype(np.float32)
    affinity = rng.uniform(-1, 1, (16, 12, 14)).astype(np.float32)
    thresholds = DecodeThresholds(sigma=float(rng.uniform(0.5, 2.0)))
    assert_same(
        decode_maps(belief, affinity, thresholds), slow_decode(belief, affinity, thresholds)
    )


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
def test_maps_of_other_shapes_are_refused(
    belief: tuple[int, ...], affinity: tuple[int, ...]
) -> None:
    with pytest.raises(BadMaps, match="belief"):
        decode_maps(np.zeros(belief), np.zeros(affinity))
