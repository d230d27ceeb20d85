"""A fruit hangs when its weight is on the fingers, independent of the normal forces."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from pomona.drivers.errors import DeviceFault
from pomona.skills.grip.grip import GripProblem
from pomona.skills.shared.carrying import Hanging


def watch(loads: list[float], period: float = 0.02) -> tuple[Hanging, list[str]]:
    """Look once a tick at a hold that bears these loads [N]."""
    hold: Any = SimpleNamespace(problem=None, reading=SimpleNamespace(stamp=0.0, f_t=0.0))
    hanging, said = Hanging(hold), []
    for n, load in enumerate(loads):
        hold.reading = SimpleNamespace(stamp=period * n, f_t=load)
        said.append(hanging.look())
    return hanging, said


def test_a_weight_that_stays_is_a_fruit_that_hangs() -> None:
    hanging, said = watch([0.0] * 5 + [2.0] * 50)
    assert set(said) == {""}
    assert hanging.missing() == ""


def test_a_vanished_weight_is_reported_within_a_tenth_of_a_second() -> None:
    _, said = watch([2.0] * 50 + [0.1] * 6)
    assert said[:52] == [""] * 52
    assert "weight has gone" in said[-1]


def test_nothing_ever_on_the_fingers_is_no_lift() -> None:
    hanging, said = watch([0.1] * 50)
    assert set(said) == {""}
    assert "no weight" in hanging.missing()


def test_a_bump_and_a_lift_that_slows_down_are_no_loss() -> None:
    bump = [2.0] * 50 + [7.0] * 3 + [2.0] * 50
    slowing = [2.6] * 30 + [1.4] * 20 + [2.0] * 20
    for loads in (bump, slowing):
        hanging, said = watch(loads)
        assert set(said) == {""}
        assert hanging.missing() == ""


@pytest.mark.parametrize("code", ["SENSOR_FAULT", "SENSOR_STALE", "SENSOR_SATURATED", "ONE_FINGER"])
def test_fingers_that_lie_end_the_run(code: str) -> None:
    problem = GripProblem(code, "the left finger repeats one value", 1.0)
    hold: Any = SimpleNamespace(problem=problem, reading=SimpleNamespace(stamp=1.0, f_t=2.0))
    with pytest.raises(DeviceFault, match="repeats one value"):
        Hanging(hold).look()
