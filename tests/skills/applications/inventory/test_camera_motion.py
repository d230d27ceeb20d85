"""Motion of the camera, from the contents of two frames."""

import re

import cv2
import numpy as np
import pytest

from pomona.applications.inventory.camera_motion import camera_motion
from pomona.drivers.interfaces import Frame, Intrinsics
from pomona.skills.geometry import rot_x, rot_y, transform

CAMERA = Intrinsics(400.0, 400.0, 199.5, 149.5, 400, 300)


def texture(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    fine, coarse = (cv2.resize(rng.uniform(0, 255, size), (900, 700), interpolation=cv2.INTER_CUBIC)
                    for size in ((350, 450), (70, 90)))  # fmt: skip
    return np.clip(0.5 * fine + 0.5 * coarse, 0, 255).astype(np.uint8)


def wall(
    T_wall_camera: np.ndarray, seed: int = 0, noise: float = 0.0, part: slice = slice(None)
) -> Frame:
    """A view of a painted wall with a step in it: z = 1.2 m left of x = 0, 1.0 m right of it."""
    columns, rows = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    rays = np.stack(
        [(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones(columns.shape)],
        -1,
    )
    rays = rays @ T_wall_camera[:3, :3].T
    eye = T_wall_camera[:3, 3]
    grey = np.zeros(columns.shape, np.uint8)
    depth = np.zeros(columns.shape, np.float32)
    paint = texture(seed)
    for z, left in ((1.2, True), (1.0, False)):
        t = (z - eye[2]) / rays[..., 2]
        hit = eye + t[..., None] * rays
        here = (hit[..., 0] < 0.0) == left
        u, v = 450 + 600 * hit[..., 0] + (40 if left else 0), 350 + 600 * hit[..., 1]
        painted = cv2.remap(paint, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
        grey[here] = painted[here]
        depth[here] = t[here]
    depth += np.random.default_rng(seed + 1).normal(0.0, noise, depth.shape).astype(np.float32)
    hidden = np.zeros_like(depth)
    hidden[:, part] = depth[:, part]
    return Frame(
        0.0, 0, np.repeat(grey[..., None], 3, axis=2), hidden, CAMERA, None, np.eye(4), placed=False
    )


def blank(depth: np.ndarray | None) -> Frame:
    return Frame(0, 0, np.zeros((300, 400, 3), np.uint8), depth, CAMERA, None, np.eye(4))


MOVED = transform(rot_y(0.06) @ rot_x(-0.04), (0.05, -0.03, 0.04))


def test_a_known_motion_is_found_within_its_stated_error() -> None:
    motion = camera_motion(wall(np.eye(4)), wall(MOVED, noise=0.002))
    assert motion.T_earlier_later is not None
    point = np.array([0.0, 0.0, 1.1, 1.0])
    assert np.linalg.norm(((motion.T_earlier_later - MOVED) @ point)[:3]) < 0.003
    assert motion.deviation < 0.005


@pytest.mark.parametrize(
    ("later", "words"),
    [
        (lambda: wall(np.eye(4), seed=7), "points in common|agree on a motion"),
        (lambda: wall(MOVED, part=slice(0, 60)), "points in common|close together"),
        (lambda: blank(np.ones((300, 400), np.float32)), "0 points in common"),
        (lambda: blank(None), "no depth"),
    ],
    ids=("another scene", "a strip", "nothing to see", "no depth"),
)  # fmt: skip
def test_unknown_values_are_not_guessed(later, words: str) -> None:
    motion = camera_motion(wall(np.eye(4)), later())
    assert motion.T_earlier_later is None
    assert re.search(words, motion.why)


def test_half_of_a_scene_that_moves_otherwise_is_not_the_scene() -> None:
    """Two parts move against each other: whichever is believed, the other disagrees; enough must agree."""
    still, moved = wall(np.eye(4)), wall(transform(None, (0.1, 0.0, 0.0)))
    colour, depth = still.colour.copy(), still.depth.copy()
    colour[:, :300], depth[:, :300] = moved.colour[:, :300], moved.depth[:, :300]
    motion = camera_motion(wall(np.eye(4)), Frame(0, 0, colour, depth, CAMERA, None, np.eye(4)))
    if motion.T_earlier_later is not None:  # the larger part is the scene
        assert motion.T_earlier_later[0, 3] == pytest.approx(0.1, abs=0.01)
