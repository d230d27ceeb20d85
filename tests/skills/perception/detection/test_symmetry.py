"""The label of a nearly symmetric fruit moves smoothly with the view."""

import itertools

import numpy as np
from hypothesis import given, strategies as st

from pomona.skills.perception.detection.close_look import (
    STEM_AXIS,
    label_rotation,
    minimal_rotation,
)

ANGLE = st.floats(-np.pi, np.pi)
UNIT = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
    lambda v: np.linalg.norm(v) > 0.1
)
CENTRE = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), st.floats(0.3, 1.0))


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(a.T @ b) - 1.0) / 2.0, -1.0, 1.0)))


@given(UNIT, UNIT)
def test_minimal_rotation_maps_and_turns_no_further_than_needed(
    a: tuple[float, ...], b: tuple[float, ...]
) -> None:
    source, target = np.asarray(a) / np.linalg.norm(a), np.asarray(b) / np.linalg.norm(b)
    R = minimal_rotation(source, target)
    assert np.allclose(R @ source, target, atol=1e-6)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-6)
    assert np.isclose(
        angle_between(np.eye(3), R), np.arccos(np.clip(source @ target, -1, 1)), atol=1e-3
    )


@given(UNIT, CENTRE)
def test_label_is_a_rotation_that_keeps_the_stem_axis(
    stem: tuple[float, ...], centre: tuple[float, ...]
) -> None:
    R = label_rotation(stem, centre)
    assert np.allclose(R.T @ R, np.eye(3), atol=1e-6)
    assert np.isclose(np.linalg.det(R), 1.0)
    assert np.allclose(R @ STEM_AXIS, np.asarray(stem) / np.linalg.norm(stem), atol=1e-5)


@given(st.floats(0.0, np.pi / 2), ANGLE, st.floats(0.0, np.deg2rad(60)), ANGLE)
def test_label_moves_smoothly_for_fruit_seen_from_above(
    elevation: float, roll: float, tilt: float, direction: float
) -> None:
    def stem_at(shift: float) -> np.ndarray:
        # Seen from `elevation`, leaning by `tilt` in some direction: never near the singular view from below.
        axis = np.array(
            [
                np.sin(tilt) * np.cos(direction + shift),
                -np.cos(tilt),
                np.sin(tilt) * np.sin(direction + shift),
            ]
        )
        e = elevation + shift
        turn = np.array([[1, 0, 0], [0, np.cos(e), -np.sin(e)], [0, np.sin(e), np.cos(e)]])
        return turn @ axis

    before, after = stem_at(0.0), stem_at(1e-4)
    mean_view = np.array([0.0, -np.cos(np.deg2rad(57)), -np.sin(np.deg2rad(57))])
    if before @ mean_view < -0.8:
        return
    moved = angle_between(label_rotation(before, (0, 0, 0.5)), label_rotation(after, (0, 0, 0.5)))
    assert moved < 20 * 1e-4 * 2


@given(UNIT, CENTRE)
def test_label_of_a_mirrored_view_is_the_mirrored_label(
    stem: tuple[float, ...], centre: tuple[float, ...]
) -> None:
    mirror = np.diag([-1.0, 1.0, 1.0])
    mean_view = np.array([0.0, -np.cos(np.deg2rad(57)), -np.sin(np.deg2rad(57))])
    ray = np.asarray(centre) / np.linalg.norm(centre)
    unit = np.asarray(stem) / np.linalg.norm(stem)
    if minimal_rotation((0, 0, 1), ray).T @ unit @ mean_view < -0.99:
        return  # the singular view has no one label
    mirrored = label_rotation(mirror @ np.asarray(stem), mirror @ np.asarray(centre))
    assert np.allclose(mirrored, mirror @ label_rotation(stem, centre) @ mirror, atol=1e-5)


def test_label_does_not_jump_straight_above() -> None:
    rounds = np.linspace(0.0, 2.0 * np.pi, 200)
    lean = 0.01
    labels = [
        label_rotation((lean * np.cos(a), lean * np.sin(a), -1.0), (0, 0, 0.5)) for a in rounds
    ]
    steps = [angle_between(a, b) for a, b in itertools.pairwise(labels)]
    assert max(steps) < 0.01
