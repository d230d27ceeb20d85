"""Knots of a motion: their spacing, their velocities, and the wait of a motion that begins."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.base.knot_maker import KnotMaker
from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.drivers.path_motion import PathMotion
from pomona.drivers.streamed_motion import StreamedMotion
from pomona.executive.clock import ManualClock

PERIOD = 0.01
LIMITS = ArmLimits(
    np.array([-2.0]), np.array([2.0]), np.array([2.0]), np.array([20.0]), np.array([500.0])
)


def quick_path() -> Trajectory:
    """A fifth of a second, 0.1 rad."""
    t = np.linspace(0.0, 0.2, 21)
    x = np.pi * t / 0.2
    rate = np.pi / 0.2
    q = 0.05 * (1.0 - np.cos(x))
    return Trajectory(
        t, q[:, None], (0.05 * rate * np.sin(x))[:, None], (0.05 * rate**2 * np.cos(x))[:, None]
    )


def along(spacing: float, lead: float = 0.1) -> tuple[KnotMaker, ManualClock, PathMotion]:
    clock = ManualClock(7.0)
    motion = PathMotion(quick_path(), LIMITS, PERIOD)
    return KnotMaker(motion, np.zeros(1), clock, PERIOD, spacing, lead), clock, motion


@pytest.mark.parametrize(
    ("spacing", "steps"), [(0.04, 4), (0.02, 2), (0.01, 1), (0.001, 1), (0.034, 3), (0.036, 4)]
)
def test_knots_are_whole_periods_apart(spacing: float, steps: int) -> None:
    maker, _, _ = along(spacing)
    assert (maker.due, maker.q_last.tolist()) == (7.0, [0.0])
    knot = maker.next(7.0)
    assert knot is not None
    elapsed, q, qd = knot
    assert elapsed == pytest.approx(steps * PERIOD)
    x = np.pi * elapsed / 0.2
    assert q[0] == pytest.approx(0.05 * (1.0 - np.cos(x)))
    assert qd[0] == pytest.approx(0.05 * np.pi / 0.2 * np.sin(x))
    assert maker.q_last is q
    assert maker.due >= 7.0 + elapsed - 1e-12


def test_the_last_knot_is_at_rest_and_nothing_follows_it() -> None:
    maker, clock, motion = along(0.08)
    knots = []
    due = 7.0
    while (knot := maker.next(due)) is not None:
        knots.append(knot)
        due += knot[0]
        clock.advance(knot[0])
    assert [elapsed for elapsed, _, _ in knots] == pytest.approx([0.08, 0.08, 0.04])
    assert [q[0] for _, q, _ in knots][-1] == pytest.approx(0.1)
    assert knots[-1][2].tolist() == [0.0]
    assert knots[0][2][0] > 0.1
    assert motion.set_point_rests
    assert maker.q_last[0] == pytest.approx(0.1)


def streamed(lead: float) -> tuple[KnotMaker, ManualClock, StreamedMotion]:
    clock = ManualClock(7.0)
    motion = StreamedMotion(np.zeros(1), LIMITS, PERIOD, 10.0)
    return KnotMaker(motion, np.zeros(1), clock, PERIOD, 0.02, lead), clock, motion


def test_a_set_point_that_rests_is_stepped_once_a_period() -> None:
    maker, clock, motion = streamed(0.05)
    stepped = []
    step = motion.step

    def counted() -> tuple[np.ndarray, np.ndarray]:
        stepped.append(clock.now())
        return step()

    motion.step = counted  # type: ignore[method-assign]
    for _ in range(12):
        assert maker.next(7.0) is None
        clock.advance(0.25 * PERIOD)
    assert stepped == pytest.approx([7.0, 7.01, 7.02])
    clock._now = 3.0  # a clock that went back is no reason to wait
    assert maker.next(7.0) is None
    assert stepped[-1] == 3.0


@pytest.mark.parametrize(("lead", "late"), [(0.05, 0.0), (0.05, 0.03), (0.0, 0.0)])
def test_a_streamed_motion_that_begins_waits_for_its_lead(lead: float, late: float) -> None:
    maker, clock, motion = streamed(lead)
    motion.aim(np.array([0.5]))
    clock.advance(late)
    first = maker.next(7.0)
    assert first is not None
    if lead:
        wait, q, qd = first
        assert wait == pytest.approx(lead + late)
        assert (q.tolist(), qd.tolist()) == ([0.0], [0.0])
        assert maker.q_last.tolist() == [0.0]
        first = maker.next(7.0 + wait)
        assert first is not None
    elapsed, q, qd = first
    assert elapsed == pytest.approx(0.02)
    assert q[0] > 0.0
    assert maker.q_last is q
    second = maker.next(7.0 + lead + late + elapsed)
    assert second is not None
    assert second[0] == pytest.approx(0.02)
    assert second[1][0] > q[0]  # it moves: no wait any more


def test_a_knot_that_is_due_later_than_the_lead_waits_for_nothing() -> None:
    maker, _, motion = streamed(0.05)
    motion.aim(np.array([0.5]))
    knot = maker.next(7.06)
    assert knot is not None
    assert knot[0] == pytest.approx(0.02)
    assert maker.due == pytest.approx(7.08, abs=0.0101)


def test_a_path_waits_for_nothing() -> None:
    maker, _, _ = along(0.02, lead=0.5)
    knot = maker.next(7.0)
    assert knot is not None
    assert knot[1][0] > 0.0
