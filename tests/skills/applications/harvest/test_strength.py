import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.applications.harvest.strength import Strength, draw_strength, used

BEARS = Strength(pull=20.0, twist=0.15, bend=0.12, stiffness=0.08, tear=30.0)
ROW = BEARS.row()


def spur(force, moment):
    return used(np.array(force, float), np.array(moment, float), ROW)[0]


def test_each_load_alone_breaks_at_its_own_strength():
    assert spur([0, 0, 20.0], [0, 0, 0]) == pytest.approx(1.0)
    assert spur([12.0, 16.0, 0], [0, 0, 0]) == pytest.approx(1.0)
    assert spur([0, 0, 0], [0, 0, -0.15]) == pytest.approx(1.0)
    assert spur([0, 0, 0], [0.12, 0, 0]) == pytest.approx(1.0)
    assert spur([0, 0, 0], [0.072, 0.096, 0]) == pytest.approx(1.0)


def test_a_third_of_each_load_breaks_together():
    part = np.sqrt(1.0 / 3.0)
    assert spur([0, 0, 20.0 * part], [0.12 * part, 0, 0.15 * part]) == pytest.approx(1.0)


def test_a_stem_is_torn_out_by_its_pull_alone():
    assert used(np.array([0.0, 0.0, 30.0]), np.array([0.5, 0.5, 0.5]), ROW)[1] == pytest.approx(1.0)


@given(st.lists(st.floats(-50.0, 50.0), min_size=6, max_size=6), st.floats(0.0, 1.0))
def test_a_smaller_load_never_uses_more(load, share):
    whole, part = np.array(load), share * np.array(load)
    assert spur(part[:3], part[3:]) <= spur(whole[:3], whole[3:]) + 1e-12


def test_draws_have_the_measured_quantiles(numbers):
    rng = np.random.default_rng(1)
    drawn = [draw_strength(numbers, rng) for _ in range(20_000)]
    twist, pull = np.array([s.twist for s in drawn]), np.array([s.pull for s in drawn])
    assert np.quantile(twist, 0.95) == pytest.approx(0.257, rel=0.03)
    assert np.median(pull) == pytest.approx(20.0, rel=0.02)
    assert np.corrcoef(np.log(twist), np.log(pull))[0, 1] == pytest.approx(
        numbers.strength_shared, abs=0.03
    )
    ratio = np.array([s.bend / s.stiffness for s in drawn])
    assert ratio.min() >= numbers.bend_angle[0] - 1e-9
    assert ratio.max() <= numbers.bend_angle[1] + 1e-9
