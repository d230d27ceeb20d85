"""Depth that lies on its colour, and depth that does not."""

import re
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest

from pomona.drivers.interfaces import Frame, Intrinsics
from pomona.skills.perception.frame_check import depth_elsewhere

WIDTH, HEIGHT = 480, 300
CAMERA = Intrinsics(400.0, 400.0, 239.5, 149.5, WIDTH, HEIGHT)

misplaced_depth = partial(depth_elsewhere, or_nowhere=True)


def leaves(seed: int, count: int = 60, noise: float = 0.003) -> Frame:
    """Leaves of their own colour and distance one in front of the other, on a wall, with paint that depth lacks."""
    rng = np.random.default_rng(seed)
    colour = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
    depth = np.full((HEIGHT, WIDTH), 2.5, np.float32)
    for z in np.sort(rng.uniform(0.8, 2.0, count))[::-1]:
        centre, axes = rng.uniform((0, 0), (WIDTH, HEIGHT)), rng.uniform(8, 30, 2) / z
        ellipse = (
            tuple(centre.astype(int).tolist()),
            tuple(axes.astype(int).tolist()),
            float(rng.uniform(0, 180)),
        )
        cv2.ellipse(colour, *ellipse, 0, 360, rng.uniform(0, 255, 3).tolist(), -1)
        cv2.ellipse(depth, *ellipse, 0, 360, float(z), -1)
    for _ in range(20):
        start, end = (tuple(rng.integers((0, 0), (WIDTH, HEIGHT)).tolist()) for _ in range(2))
        cv2.line(colour, start, end, rng.uniform(0, 255, 3).tolist(), 1)
    colour = np.clip(colour + rng.normal(0.0, 4.0, colour.shape), 0, 255).astype(np.uint8)
    depth += rng.normal(0.0, noise, depth.shape).astype(np.float32)
    return Frame(0.0, 0, colour, depth, CAMERA, None, np.eye(4))


def with_depth(frame: Frame, depth: np.ndarray | None) -> Frame:
    return replace(frame, depth=None if depth is None else np.ascontiguousarray(depth))


def moved(depth: np.ndarray, right: int = 0, down: int = 0, scale: float = 1.0) -> np.ndarray:
    M = np.array(
        [[scale, 0, (1 - scale) * WIDTH / 2 + right], [0, scale, (1 - scale) * HEIGHT / 2 + down]]
    )
    return cv2.warpAffine(depth, M, (WIDTH, HEIGHT), flags=cv2.INTER_NEAREST)


@pytest.mark.parametrize("seed", range(8))
def test_depth_on_its_colour_is_not_doubted_and_mirrored_or_moved_it_is(seed: int) -> None:
    frame = leaves(seed)
    depth = frame.depth
    assert misplaced_depth(frame) == ""
    assert misplaced_depth(with_depth(frame, moved(depth, right=3))) == ""
    assert "mirrored left to right" in misplaced_depth(with_depth(frame, depth[:, ::-1]))
    assert "mirrored top to bottom" in misplaced_depth(with_depth(frame, depth[::-1]))
    assert "turned by 180°" in misplaced_depth(with_depth(frame, depth[::-1, ::-1]))
    aside = misplaced_depth(with_depth(frame, moved(depth, right=36)))
    found = re.fullmatch(r"depth lies (\d+) px right(?: and \d px \w+)? against colour", aside)
    assert found is not None
    assert abs(int(found[1]) - 36) <= 3
    both = misplaced_depth(with_depth(frame, moved(depth, right=-24, down=30)))
    found = re.fullmatch(r"depth lies (\d+) px left and (\d+) px down against colour", both)
    assert found is not None
    assert np.abs(np.array([int(found[1]), int(found[2])]) - (24, 30)).max() <= 3


@pytest.mark.parametrize("seed", range(8))
def test_depth_of_another_lens_or_another_scene_lies_nowhere(seed: int) -> None:
    frame = leaves(seed)
    for other in (moved(frame.depth, scale=1.35), leaves(seed + 100).depth):
        assert misplaced_depth(with_depth(frame, other)) == "depth's edges lie nowhere on colour's"


def test_without_evidence_nothing_is_reported() -> None:
    frame = leaves(1)
    none, flat = np.zeros_like(frame.depth), np.full_like(frame.depth, 1.5)
    assert [misplaced_depth(with_depth(frame, depth)) for depth in (None, none, flat)] == [""] * 3
    assert misplaced_depth(replace(frame, colour=np.full_like(frame.colour, 90))) == ""
