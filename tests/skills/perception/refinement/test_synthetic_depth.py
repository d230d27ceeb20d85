"""The generator of test scenes agrees with its description."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.synthetic_depth import D435I, as_d435i, looking_at, standing, true_depth
from pomona.skills.geometry import apply


@pytest.mark.parametrize("tilt", [0.0, 0.2])
def test_fruit_stands_on_the_table_with_its_true_size(apple, tilt):
    fruit = standing(
        apple, (0.07, 0.06, 0.07), (0.1, -0.2), tilt, 1.0, dents=0.01, rng=np.random.default_rng(0)
    )
    np.testing.assert_allclose(np.ptp(fruit.vertices, axis=0), [0.07, 0.06, 0.07])
    in_base = apply(fruit.T_base_object, fruit.vertices)
    assert in_base[:, 2].min() == pytest.approx(0.0, abs=1e-12)
    up = -fruit.T_base_object[:3, 1]
    assert np.arccos(up[2]) == pytest.approx(tilt, abs=1e-9)


def test_camera_looks_at_its_target():
    T = looking_at((0.1, 0.2, 0.03), 0.6, np.radians(40.0), 0.7)
    np.testing.assert_allclose(T[:3, 3] + 0.6 * T[:3, 2], [0.1, 0.2, 0.03], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert T[2, 1] < 0.0  # the image's y axis points down


def test_noise_is_that_of_the_data_sheet():
    flat = np.full((480, 640), 0.6)
    error = as_d435i(flat, np.random.default_rng(0)) - flat
    assert error.std() == pytest.approx(0.6**2 * 0.08 / (D435I.fx * 0.05), rel=0.1)
    beside = np.corrcoef(error[:, :-1].ravel(), error[:, 1:].ravel())[0, 1]
    assert 0.5 < beside < 0.95


def test_grazing_surfaces_and_points_that_one_imager_sees_have_no_depth(apple):
    fruit = standing(apple, (0.09, 0.08, 0.09))
    T = looking_at((0.0, 0.0, 0.04), 0.6, np.radians(60.0))
    true = true_depth([fruit], T)
    measured = as_d435i(true, np.random.default_rng(1))
    alone = true_depth([fruit], T, table=False) > 0
    lost = measured == 0.0
    assert lost[alone].mean() < 0.15
    columns = np.nonzero(alone.any(axis=0))[0]
    row = int(np.nonzero(alone.any(axis=1))[0].mean())
    left, right = columns[0] - 6, columns[-1] + 6
    assert (
        lost[row - 10 : row + 10, left : columns[0] + 2].mean()
        > lost[row - 10 : row + 10, columns[-1] : right].mean()
    )
