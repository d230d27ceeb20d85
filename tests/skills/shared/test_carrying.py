"""A fruit hangs when its weight is on the fingers, independent of the normal forces."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault
from pomona.skills.grip.grip import GripProblem
from pomona.skills.shared import carrying
from pomona.skills.shared.carrying import (
    GripOverloaded,
    Hanging,
    OverloadMonitor,
    PadLoad,
    TouchedDown,
    lower_until_contact,
)
from tests.skills.picking_scene import OBSERVE, PickingScene


def watch(loads: list[float], period: float = 0.02, pace: float = 1.0) -> tuple[Hanging, list[str]]:
    """Look once a tick at a hold that bears these loads [N]."""
    hold: Any = SimpleNamespace(problem=None, reading=SimpleNamespace(stamp=0.0, f_t=0.0))
    hanging, said = Hanging(hold), []
    for n, load in enumerate(loads):
        hold.reading = SimpleNamespace(stamp=period * n, f_t=load)
        said.append(hanging.look(pace))
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


def test_a_load_that_stays_above_a_third_of_its_largest_is_no_loss() -> None:
    for left, gone in ((0.72, False), (0.61, True)):  # of 2 N, which fade to 1.8 N
        _, said = watch([2.0] * 100 + [left] * 5, 0.02)
        assert any(said) is gone


def test_a_load_has_gone_after_sixty_milliseconds() -> None:
    _, said = watch([2.0] * 100 + [0.1] * 8, 0.016)
    assert [bool(text) for text in said[100:]] == [False] * 3 + [True] * 5
    assert said[-1].endswith("0.1 N of 1.8 N are left")


@pytest.mark.parametrize("pace", [0.1, 0.5, 1.0])
def test_pads_that_were_loaded_upwards_bear_nothing_in_between_for_as_long_as_the_arm_takes(
    pace: float,
) -> None:
    between = np.abs(np.linspace(-0.6, 0.6, round(8 / pace)))  # 0.16 s at full speed
    _, said = watch([0.6] * 50 + between.tolist() + [2.0] * 50, 0.02, pace)
    assert set(said) == {""}
    _, said = watch([2.0] * 50 + [0.1] * round(4 / pace), 0.02, pace)
    noticed = next(k for k, text in enumerate(said[50:], 1) if text)
    assert 0.059 < 0.02 * noticed * pace < 0.081


def test_a_load_that_comes_back_begins_its_absence_anew() -> None:
    _, said = watch(([2.0] * 50) + [0.1, 0.1, 0.1, 2.0] * 10, 0.016)
    assert set(said) == {""}


def test_the_largest_load_fades_within_a_second() -> None:
    hanging, said = watch([8.0] * 100 + [2.9] * 200)
    assert set(said) == {""}
    assert hanging._most == pytest.approx(2.9, rel=0.01)
    hanging, _ = watch([8.0] * 100 + [0.0])
    before = hanging._most
    hanging._hold.reading = SimpleNamespace(stamp=100 * 0.02 + 0.5, f_t=0.0)  # type: ignore[assignment]
    hanging.look()
    assert hanging._most == pytest.approx(before * np.exp(-0.5))


def test_the_average_load_follows_within_a_tenth_of_a_second() -> None:
    assert watch([5.0])[0]._load == 0.0  # one sample is no time
    hanging, _ = watch([0.0] + [1.0] * 5)
    assert hanging._load == pytest.approx(1.0 - np.exp(-1.0))
    for weight, hangs in ((0.26, True), (0.24, False)):
        hanging, _ = watch([weight] * 100)
        assert (hanging.missing() == "") is hangs


def test_a_sample_of_before_is_no_time() -> None:
    hanging, _ = watch([1.0] * 20)
    before = hanging._load
    hanging._hold.reading = SimpleNamespace(stamp=0.0, f_t=5.0)  # type: ignore[assignment]
    hanging.look()
    assert hanging._load == before


# ------------------------------------------------------------------------------------------------- overload


def grip(code: str = "FORCE_LIMIT", stamp: float = 0.0, **data: float) -> Any:
    return GripProblem(code, "it needs 30 N of 20 N", stamp, data)


def test_an_overload_ends_the_lift_when_it_lasts() -> None:
    hold: Any = SimpleNamespace(problem=None, estimate=SimpleNamespace(load=np.array([0.0, -4.0])))
    monitor = OverloadMonitor(hold)
    monitor.require_bearable()
    for stamp in (1.0, 1.03, 1.059):
        hold.problem = grip(stamp=stamp)
        monitor.require_bearable()
    hold.problem = None
    monitor.require_bearable()
    for stamp in (1.07, 1.129):  # it began anew
        hold.problem = grip("SLIPPED", stamp)
        monitor.require_bearable()
    hold.problem = grip("ONE_FINGER", 1.2)  # not an overload
    monitor.require_bearable()
    hold.problem = grip(stamp=1.3)
    monitor.require_bearable()
    hold.problem = last = grip(stamp=1.361)
    with pytest.raises(GripOverloaded) as raised:
        monitor.require_bearable()
    assert raised.value.problem is last
    assert str(raised.value) == last.message


def test_a_load_is_gone_when_less_of_it_is_left_along_its_own_direction() -> None:
    hold: Any = SimpleNamespace(estimate=SimpleNamespace(load=np.array([3.0, -4.0])))
    pads = PadLoad(hold)
    for load, gone in (
        ((3.0, -4.0), False),
        ((0.16, -0.2), False),  # 0.256 N along it
        ((0.14, -0.2), True),  # 0.244 N
        ((-3.0, 4.0), True),
        ((4.0, 3.0), True),  # across it
    ):
        hold.estimate.load = np.array(load)
        assert pads.is_gone is gone


@pytest.mark.parametrize(
    ("code", "weight", "risen", "outcome", "words"),
    [
        ("FORCE_LIMIT", 19.0, 0.0, "FORCE_LIMIT", "put back where it stood; at this grip position"),
        ("FORCE_LIMIT", 20.0, 0.0, "FORCE_LIMIT", "put back where it stood; at this grip position"),
        ("FORCE_LIMIT", 21.0, 0.9e-3, "TOO_HEAVY", "put back where it stood; at any grip position"),
        ("SLIPPED", 21.0, 0.012, "SLIPPED", "still 12 mm up, with no straight way back; with the"),
        ("SLIPPED", 21.0, 1e-3, "SLIPPED", "still 1 mm up"),
    ],
)
def test_an_overload_is_named_by_its_cause_and_by_where_the_fruit_is(
    code: str, weight: float, risen: float, outcome: str, words: str
) -> None:
    problem = grip(code, for_weight_alone_n=weight, limit_n=20.0)
    told = GripOverloaded(problem, SimpleNamespace()).outcome(risen)  # type: ignore[arg-type]
    assert told[0] == outcome
    assert told[1].startswith(words)


# -------------------------------------------------------------------------------------------- on the way down


def lowered(
    monkeypatch: pytest.MonkeyPatch, length: float, loads: list[float], postures: int = 41
) -> tuple[list[Any], list[float], str]:
    """Go down a line of a length [m] while the fingers bear these loads [N], one in each tick of its last part.

    Return the paths, the contacts at which the fingers rest, and how it ended.
    """
    scene = PickingScene()
    q = np.linspace(OBSERVE, OBSERVE + 0.2, postures)
    line: Any = SimpleNamespace(q=q, length=length)
    wrenches = np.zeros((2, 6))
    scene.fingers.feel = lambda _now: wrenches
    wrenches[:, 0] = 0.5 * loads[0]
    scene.clock.advance(0.1)
    devices = scene.devices
    paths: list[Any] = []
    rests: list[float] = []
    skill: Any = SimpleNamespace(
        device=devices.__getitem__, optional_device=devices.get, clock=scene.clock
    )

    def travel(path: Any, watch: Any) -> Any:
        paths.append(path)
        quick = len(paths) == 1 and length > carrying.NEAR
        for force in [loads[0]] if quick else loads:
            wrenches[:, 0] = 0.5 * force
            scene.clock.advance(0.1)
            watch()
            yield None

    skill.travel = travel
    monkeypatch.setattr(carrying, "rest_on_contact", lambda _skill, contact: rests.append(contact))
    monkeypatch.setattr(carrying, "take_over", lambda _gripper: rests.append(-1.0))
    try:
        for _ in lower_until_contact(skill, line, 0.2, 1.0, lambda: None):
            pass
    except TouchedDown:
        return paths, rests, "touched"
    return paths, rests, "end"


def test_the_last_fifteen_millimetres_of_the_way_down_are_slow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (quick, slow), _, ended = lowered(monkeypatch, 0.1, [2.0])
    assert ended == "end"
    np.testing.assert_allclose(quick.q[-1], slow.q[0])
    np.testing.assert_allclose(quick.q[0], OBSERVE)
    np.testing.assert_allclose(slow.q[-1], OBSERVE + 0.2)
    gone = (slow.q[0] - OBSERVE)[0] / 0.2
    assert 0.0825 <= 0.1 * gone <= 0.085
    for path, height, speed, acceleration in (
        (quick, 0.1 * gone, 0.2, 1.0),
        (slow, 0.1 * (1.0 - gone), 0.03, 0.3),
    ):
        way = height * (path.q[:, 0] - path.q[0, 0]) / np.ptp(path.q[:, 0])
        rate = np.gradient(way, path.t)
        assert rate.max() == pytest.approx(speed, rel=0.05)
        jerk = acceleration / 0.1
        lasts = height / speed + speed / acceleration + acceleration / jerk  # of an S-curve
        assert path.t[-1] == pytest.approx(lasts, rel=0.01)


@pytest.mark.parametrize("length", [0.008, 0.0155, 0.0161])
def test_a_short_way_down_is_slow_from_its_beginning(
    monkeypatch: pytest.MonkeyPatch, length: float
) -> None:
    (path,), _, _ = lowered(monkeypatch, length, [2.0])
    np.testing.assert_allclose(path.q[[0, -1]], [OBSERVE, OBSERVE + 0.2])


@pytest.mark.parametrize(("weight", "contact"), [(1.0, 0.35), (3.4, 0.35), (8.0, 0.8)])
def test_a_fruit_touches_down_when_its_load_changes_by_a_contact(
    monkeypatch: pytest.MonkeyPatch, weight: float, contact: float
) -> None:
    _, rests, ended = lowered(monkeypatch, 0.1, [weight, weight - 0.97 * contact])
    assert ended == "end"
    assert rests == [pytest.approx(contact)]
    _, rests, ended = lowered(monkeypatch, 0.1, [weight, weight - 1.03 * contact])
    assert ended == "touched"
    assert rests == [pytest.approx(contact), -1.0]  # the fingers are let rest
