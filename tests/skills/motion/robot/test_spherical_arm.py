"""The vectors of the closed solution, beside numpy's and scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pomona.skills.motion.robot.spherical_arm import (
    _cross,
    _dot,
    _frame_of_line,
    _rotate,
    _three_axes,
    _unit,
    _unit_across,
)

SEEDS = range(12)


def vectors(seed: int, count: int) -> list[tuple[float, float, float]]:
    x = np.random.default_rng(seed).normal(size=(count, 3))
    return [(float(a), float(b), float(c)) for a, b, c in x]


@pytest.mark.parametrize("seed", SEEDS)
def test_products_lengths_and_turns_are_those_of_numpy(seed: int) -> None:
    a, b = vectors(seed, 2)
    assert _dot(a, b) == pytest.approx(np.dot(a, b))
    assert _cross(a, b) == pytest.approx(np.cross(a, b))
    assert _unit(a) == pytest.approx(a / np.linalg.norm(a))
    axis, angle = _unit(a), 0.3 * seed - 2.0
    turned = Rotation.from_rotvec(angle * np.array(axis)).apply(b)
    assert _rotate(axis, np.cos(angle), np.sin(angle), b) == pytest.approx(turned)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_vector_across_is_perpendicular_and_towards_the_other(seed: int) -> None:
    v, along = vectors(seed, 2)
    along = _unit(along)
    found = np.array(_unit_across(v, along))
    expected = np.array(v) - np.dot(v, along) * np.array(along)
    assert found == pytest.approx(expected / np.linalg.norm(expected))
    for scale in (3.0, -3.0):  # parallel: any that is perpendicular
        found = np.array(
            _unit_across((scale * along[0], scale * along[1], scale * along[2]), along)
        )
        assert np.dot(found, along) == pytest.approx(0.0, abs=1e-12)
        assert np.linalg.norm(found) == pytest.approx(1.0)
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        assert np.linalg.norm(_unit_across(axis, axis)) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_frame_of_a_line_is_right_handed_along_it(seed: int) -> None:
    line, sideways = vectors(seed, 2)
    forward, side, up = (np.array(axis) for axis in _frame_of_line(line, sideways))
    assert np.column_stack([forward, side, up]).T @ np.column_stack(
        [forward, side, up]
    ) == pytest.approx(np.eye(3))
    assert np.cross(forward, side) == pytest.approx(up)
    assert forward * np.linalg.norm(line) == pytest.approx(line)
    assert np.dot(side, sideways) > 0.0


@pytest.mark.parametrize("branch", [1.0, -1.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_three_angles_about_perpendicular_axes_give_their_rotation(
    seed: int, branch: float
) -> None:
    first, second = vectors(seed, 2)
    a = _unit(first)
    b = _unit_across(second, a)
    across = np.cross(a, b)
    tilt = 0.4 * seed
    c = tuple(float(x) for x in np.cos(tilt) * np.array(a) + np.sin(tilt) * across)
    R = Rotation.random(random_state=seed).as_matrix()
    rows = tuple(tuple(float(x) for x in row) for row in R)
    angles = np.full(5, np.nan)
    _three_axes(a, b, c, rows, branch, angles, 1)
    assert np.isnan(angles[[0, 4]]).all()
    turns = [
        Rotation.from_rotvec(angle * np.array(axis))
        for angle, axis in zip(angles[1:4], (a, b, c), strict=True)
    ]
    assert (turns[0] * turns[1] * turns[2]).as_matrix() == pytest.approx(R, abs=1e-9)


def test_the_two_branches_are_two_solutions_and_a_singular_one_leaves_all_to_the_last() -> None:
    a, b, c = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    R = Rotation.from_euler("ZYZ", [0.3, 0.7, -0.4])
    rows = tuple(tuple(float(x) for x in row) for row in R.as_matrix())
    angles = np.empty(3)
    _three_axes(a, b, c, rows, 1.0, angles, 0)
    assert angles == pytest.approx([0.3, 0.7, -0.4])
    _three_axes(a, b, c, rows, -1.0, angles, 0)
    assert angles == pytest.approx([0.3 - np.pi, -0.7, -0.4 + np.pi])
    turned = Rotation.from_euler("z", 0.9).as_matrix()
    rows = tuple(tuple(float(x) for x in row) for row in turned)
    _three_axes(a, b, c, rows, 1.0, angles, 0)
    assert angles == pytest.approx([0.0, 0.0, 0.9])
