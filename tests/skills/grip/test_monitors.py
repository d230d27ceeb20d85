"""Each monitor alone: its condition, its time, and the order of the problems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from benchmarks.grasp_patch import Fruit
from benchmarks.grasp_trial import Lifting, run_trial
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.estimate import GripEstimate
from pomona.skills.grip.grip import GripMode, GripProblem
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.monitors import (
    DeadFingerMonitor,
    FingerForceMonitor,
    GoneMonitor,
    GripState,
    Monitor,
    NeededForceMonitor,
    SaturationMonitor,
    SensorFaultMonitor,
    SlipMonitor,
    SlipWatch,
    _average,
    first_problem,
    has_dead_finger,
    hold_monitors,
)
from pomona.skills.grip.sensor import GripSample, SensorWatch
from pomona.skills.grip.settings import ForceLaw, ForceLoopSettings, GripSettings

SETTINGS = GripSettings()
LIMITS = SETTINGS.watch
PERIOD = 0.002


def pressing(left: float = 1.5, right: float = 1.5, **changes: Any) -> GripEstimate:
    return GripEstimate(left=left, right=right, f_n=2.0 * min(left, right))._replace(**changes)


def state(estimate: GripEstimate | None = None, **changes: Any) -> GripState:
    """A sound grip of a carried fruit, but for the changes."""
    sample = GripSample(1.0, 1, PERIOD, np.zeros((2, 6)))
    sound = GripState(sample, estimate or pressing(), GripMode.CARRIED, 0.07, 2.0, 1.5)._replace(
        **changes
    )
    return sound._replace(has_dead_finger=has_dead_finger(sound.estimate, sound.mode, LIMITS))


def samples_until(monitor: Monitor, now: GripState, most: int = 500) -> int:
    """How many samples of this state the monitor takes until it reports a problem; `most` for none."""
    return next((n for n in range(1, most) if monitor.check(now) is not None), most)


def slip_monitor() -> SlipMonitor:
    return SlipMonitor(SETTINGS, SlipWatch(SETTINGS.slips, SETTINGS.rate))


def test_a_sound_grip_has_no_problem() -> None:
    sensors = SensorWatch(SETTINGS)
    monitors = hold_monitors(SETTINGS, sensors, SaturationMonitor(LIMITS), slip_monitor())
    assert [first_problem(monitors, state()) for _ in range(500)] == [None] * 500


@pytest.mark.parametrize(
    ("monitor", "bad", "code", "after"),
    [
        (GoneMonitor(LIMITS), state(pressing(0.1, 0.05)), "LOST", LIMITS.gone_after),
        (DeadFingerMonitor(LIMITS), state(pressing(0.1, 2.0)), "ONE_FINGER", LIMITS.gone_after),
        (slip_monitor(), state(pressing(f_least=3.2)), "SLIPPED", LIMITS.beyond_after),
        (NeededForceMonitor(14.0), state(f_wanted=14.1), "FORCE_LIMIT", 0.0),
        (FingerForceMonitor(14.0), state(pressing(2.0, 7.1)), "FORCE_LIMIT", 0.0),
        (
            SaturationMonitor(LIMITS),
            state(sample=GripSample(1.0, 1, PERIOD, np.zeros((2, 6)), (False, True))),
            "SENSOR_SATURATED",
            LIMITS.saturated_after,
        ),
    ],
    ids=["gone", "dead", "slip", "needed force", "finger force", "saturated"],
)
def test_a_condition_counts_after_its_time_and_ends_with_it(
    monitor: Monitor, bad: GripState, code: str, after: float
) -> None:
    assert samples_until(monitor, state()) == 500
    assert samples_until(monitor, bad) == pytest.approx(after / PERIOD + 1, abs=1)
    problem = monitor.check(bad)
    assert isinstance(problem, GripProblem)
    assert (problem.code, problem.stamp) == (code, 1.0)
    assert monitor.check(state()) is None
    assert samples_until(monitor, bad) == pytest.approx(
        after / PERIOD + 1, abs=1
    )  # the time begins anew


def test_a_sensor_fault_stays() -> None:
    sensors = SensorWatch(SETTINGS)
    monitor = SensorFaultMonitor(sensors)
    assert monitor.check(state()) is None
    for _ in range(100):
        sensors.compare_with_motor(3.0, 12.0, 0.02)
    problem = monitor.check(state())
    assert problem is not None
    assert problem.code == "SENSOR_FAULT"
    assert "motor presses" in problem.message


def test_slip_adds_up_while_the_force_is_near_the_minimum() -> None:
    monitor = slip_monitor()
    slipping = state(
        pressing(f_least=2.9, slip_speed=0.01)
    )  # 0.97 of the force: below `beyond`, above `slipping`
    assert samples_until(monitor, slipping) == pytest.approx(
        SETTINGS.slip_limit / 0.01 / PERIOD + 1, abs=1
    )
    assert monitor.slip > SETTINGS.slip_limit


def test_pads_that_slide_on_purpose_are_neither_slip_nor_a_dead_finger() -> None:
    now = state(pressing(0.1, 2.0, f_least=9.0, slip_speed=0.1), mode=GripMode.SLIDING)
    assert samples_until(slip_monitor(), now) == 500
    assert samples_until(DeadFingerMonitor(LIMITS), now) == 500


@pytest.mark.parametrize("mode", [GripMode.STANDING, GripMode.LIFTING])
def test_the_tables_friction_may_load_one_finger_but_a_finger_that_reads_nothing_is_dead(
    mode: GripMode,
) -> None:
    assert not state(pressing(0.31, 1.62), mode=mode).has_dead_finger  # of an apple that was pushed
    assert state(pressing(0.31, 1.62)).has_dead_finger  # in the air nothing else bears a difference
    assert state(pressing(0.1, 1.62), mode=mode).has_dead_finger
    assert state(pressing(0.4, 3.5), mode=mode).has_dead_finger  # more than the friction of a table


def test_twice_the_other_finger_counts_when_one_reads_nothing() -> None:
    assert state(pressing(0.1, 2.0)).counted_force == 4.0
    assert state(pressing(1.0, 2.0)).counted_force == 2.0


def test_the_most_serious_problem_comes_first_and_all_timers_run() -> None:
    sensors = SensorWatch(SETTINGS)
    monitors = hold_monitors(SETTINGS, sensors, SaturationMonitor(LIMITS), slip_monitor())
    gone = state(pressing(0.0, 0.0, f_least=5.0), f_wanted=20.0)
    codes = [problem.code if (problem := first_problem(monitors, gone)) else "" for _ in range(40)]
    assert codes[0] == "FORCE_LIMIT"
    assert codes[-1] == "LOST"


HEAVY = Fruit(mass=0.31, width=0.08, mu=0.62, offset=(0.0, 0.011))
APPLE = Fruit(mass=0.24, width=0.075, mu=0.5, offset=(0.004, 0.004))


def lift(fruit: Fruit, told: float, **changes: object) -> tuple:
    """Lift a fruit whose configured friction is `told` times too high: result, controller, reports and their times."""
    contact = SoftContact(told * fruit.mu, fruit.delta, fruit.gamma, fruit.k)
    settings = GripSettings(
        contact=contact,
        mu_uncertainty=0.15,
        offset=0.015,
        initial_force=4.0,
        loop=ForceLoopSettings(max_force=40.0),
    )
    seen: dict[str, float] = {}
    last: list[GripController] = []

    def watch(t: float, controller: GripController, _grasp: object) -> None:
        if controller.problem is not None:
            seen.setdefault(controller.problem.code, t)
        last[:] = [controller]

    settings = replace(settings, **changes)  # type: ignore[arg-type]
    return run_trial(fruit, settings, Lifting(), noise=0.2, seed=6, watch=watch), last[0], seen


@pytest.mark.slow
@pytest.mark.parametrize("fruit", [HEAVY, APPLE], ids=["heavy", "apple"])
@pytest.mark.parametrize("told", [1.3, 1.5])
def test_friction_that_was_configured_too_high_is_corrected_by_the_slip_that_it_causes(
    fruit: Fruit, told: float
) -> None:
    result, controller, _ = lift(fruit, told)
    assert result.held
    assert result.slip < 0.004
    assert 1.0 < result.steady / result.least < 1.6
    assert controller.settings.contact.mu < 1.15 * fruit.mu


def test_the_fruit_is_lost_when_slip_is_not_watched() -> None:
    """The same lift under the paper's static law, which uses the configured friction."""
    result, _, seen = lift(HEAVY, 1.5, law=ForceLaw.STATIC)
    assert not result.held
    assert "SLIPPED" in seen or "LOST" in seen


def test_friction_that_is_right_is_left_alone() -> None:
    for fruit in (HEAVY, APPLE):
        result, controller, seen = lift(fruit, 1.0, mu_uncertainty=0.0)
        assert result.held
        assert controller.friction_share == pytest.approx(1.0)
        assert seen == {}


def held_under(
    loads: Sequence[float], mu_uncertainty: float, lasts: float = 0.4
) -> list[tuple[float, float]]:
    """Time and friction's share of a fruit whose load changes while every sample is called a slip; friction is 0.6."""
    settings = replace(SETTINGS, contact=SoftContact(0.6), mu_uncertainty=mu_uncertainty)
    controller = GripController(settings)
    controller.width, wrenches, shares = 0.07, np.zeros((2, 6)), []
    rng = np.random.default_rng(3)
    for i in range(300 + int(lasts * len(loads) / PERIOD)):
        if i == 150:
            wrenches[:, 2] = -1.2
        if i >= 300:
            wrenches[:, 1] = loads[int((i - 300) * PERIOD / lasts)]
            controller._slips.check = lambda *_: True  # type: ignore[method-assign]
        controller.step(PERIOD * i, i, wrenches + rng.normal(0.0, 1e-4, (2, 6)))
        shares.append((PERIOD * i, controller.friction_share))
    return shares


def test_repeated_slips_take_no_more_from_the_friction_than_is_uncertain() -> None:
    falling = (0.5, 0.35, 0.25, 0.18, 0.12)
    assert min(share for _, share in held_under(falling, 0.15)) == pytest.approx(1.0 - 2.0 * 0.15)
    assert {share for _, share in held_under(falling, 0.0)} == {1.0}


def test_one_slip_is_one_correction_and_fades() -> None:
    shares = held_under((0.5, 0.35, 0.35), 0.4)
    falls = [t for (_, before), (t, after) in pairwise(shares) if after < before]
    assert len(falls) == 2
    assert falls[1] - falls[0] == pytest.approx(0.5, abs=2.0 * PERIOD)
    between = [share for t, share in shares if falls[0] < t < falls[1]]
    lost = 1.0 - np.array(between)
    assert lost[-1] / lost[0] == pytest.approx(np.exp(-0.5 / 10.0), abs=2e-3)


def test_the_contact_points_give_the_slid_distance() -> None:
    result, controller, _ = lift(HEAVY, 1.5)
    assert controller.slipped == pytest.approx(result.slip, abs=5e-4)
    assert np.isfinite(controller.slipped)


# ------------------------------------------------------------------------------------- averages of the contact


def averaged(wrenches: Any, shares: Any, periods: Sequence[int] | None = None) -> Any:
    """Means (3, 5), places (3, 2) and the smallest normal force after wrenches, one each sample."""
    means, places, samples = np.zeros((3, 5)), np.zeros((3, 2)), 0
    for k, wrench in enumerate(wrenches):
        stands_for = 1 if periods is None else periods[k]
        samples += stands_for
        weakest = _average(np.array(wrench), samples, stands_for, shares, means, places)
    return means, places, weakest


def test_at_first_an_average_is_the_plain_mean() -> None:
    wrenches = np.random.default_rng(3).normal([0.0, 0.0, -5.0, 0.0, 0.0, 0.0], 1.0, (20, 6))
    means, places, weakest = averaged(wrenches, np.array([1e-3, 1e-4, 1e-5]))
    fx, fy, fz, mx, my, _mz = wrenches.mean(axis=0)
    for k in range(3):
        assert means[k] == pytest.approx([-fz, my, -mx, fx, fy])
        assert places[k] == pytest.approx([my / -fz, -mx / -fz])
    assert weakest == pytest.approx(-fz)


def test_later_an_average_follows_a_step_with_its_own_time_constant() -> None:
    shares = np.array([0.2, 0.05, 0.01])
    before, after = [1.0, 2.0, -4.0, 0.3, 0.2, 0.0], [3.0, 2.0, -2.0, 0.1, 0.4, 0.0]
    means, places, weakest = averaged([before] * 200 + [after] * 7, shares)
    for k, share in enumerate(shares):
        left = (1.0 - share) ** 7
        normal, first, second = (
            new + left * (old - new) for old, new in ((4.0, 2.0), (0.2, 0.4), (-0.3, -0.1))
        )
        assert means[k, 0] == pytest.approx(normal)
        assert means[k, 3] == pytest.approx(3.0 + left * (1.0 - 3.0))
        assert means[k, 4] == pytest.approx(2.0)
        assert places[k] == pytest.approx([first / normal, second / normal])
    assert weakest == pytest.approx(means[:, 0].min()) == pytest.approx(means[0, 0])
    rising = averaged([after] * 200 + [before] * 7, shares)
    assert rising[2] == pytest.approx(rising[0][2, 0])


def test_a_sample_that_stands_for_several_counts_as_often_and_never_more_than_whole() -> None:
    shares = np.array([0.2, 0.05, 0.01])
    before, after = [0.0, 0.0, -4.0, 0.0, 0.0, 0.0], [0.0, 0.0, -2.0, 0.0, 0.0, 0.0]
    means, _, _ = averaged([before] * 200 + [after], shares, [1] * 200 + [10])
    assert means[:, 0] == pytest.approx([2.0, 4.0 - 0.5 * 2.0, 4.0 - 0.1 * 2.0])


# --------------------------------------------------------------------------------------------- limits of slip

SLIPS = SETTINGS.slips
NEAR = replace(SLIPS, moved_far=0.0)
FAST_TO_SLOW = 5.0**-0.25 - 5.0**-1.25
"""Largest difference of two averages after a step, of time constants as 1 to 5, relative to the step."""


def slips_after(
    step: float,
    speed: float = 0.0,
    settings: Any = NEAR,
    noise: float = 0.0,
    load: float = 0.0,
    is_carried: bool = False,
    normal: float = 3.0,
    until: int = 200,
) -> bool:
    """Whether a contact that has rested for 1.2 s and then moves a step [m] or at a speed [m/s] is found to slip.

    `noise` is that of the torques [N m]; `load` comes in the moment of the step [N].
    """
    watch = SlipWatch(settings, SETTINGS.rate)
    still = np.zeros((8, 2, 6))
    still[::2, 0, 4], still[1::2, 0, 4] = 2.0 * noise, -2.0 * noise
    still[:, 1, 3] = 9.0  # steady: no noise
    watch.calibrate(still)
    watch.start()
    found = False
    for k in range(-600, until):
        place = 0.01 + (k >= 0) * (step + speed * k / SETTINGS.rate)
        wrench = np.array([load * (k >= 0), 0.0, -normal, 0.0, normal * place, 0.0])
        found |= watch.check(pressing(unfiltered=wrench), 1, is_carried)
    return found


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("limit", "given"),
    [
        (SLIPS.moved / FAST_TO_SLOW, {}),
        (SLIPS.moved / FAST_TO_SLOW, {"is_carried": True}),
        (SLIPS.moved_far, {"settings": SLIPS}),
        (SLIPS.moved / FAST_TO_SLOW + 2.0 * SLIPS.compliance * 0.5, {"load": 0.5}),
        (5.5 * 5e-3 / 3.0 * np.sqrt(np.tanh(0.05)) / FAST_TO_SLOW, {"noise": 5e-3}),
    ],
)
def test_a_step_of_the_contact_is_slip_from_its_limit(
    limit: float, given: dict[str, Any], way: float
) -> None:
    assert slips_after(1.03 * way * limit, **given)
    assert not slips_after(0.97 * way * limit, **given)


@pytest.mark.parametrize(("relative", "found"), [(1.1, True), (0.97, False)])
@pytest.mark.parametrize(
    ("lag", "is_carried"),
    [(0.5 - 0.1, True), (0.1 - 0.02, False)],  # an average lags behind by its time constant
)
def test_slow_slip_is_found_from_its_limit_and_slower_in_a_carried_fruit(
    lag: float, is_carried: bool, relative: float, found: bool
) -> None:
    speed = relative * SLIPS.moved / lag
    assert slips_after(0.0, speed, is_carried=is_carried, until=1250) is found


def test_a_contact_that_hardly_presses_has_no_place() -> None:
    assert not slips_after(0.02, normal=0.149)
    assert slips_after(0.02, normal=0.151)


def test_the_slid_distance_counts_from_the_start() -> None:
    watch = SlipWatch(SLIPS, SETTINGS.rate)
    for start in (0.0, 5e-3):
        watch.start()
        assert watch.slipped == 0.0
        for place in (start, start + 8e-4):
            for _ in range(600):
                wrench = np.array([0.0, 0.0, -3.0, 0.0, 3.0 * place, 0.0])
                watch.check(pressing(unfiltered=wrench), 1, False)
            assert watch.slipped == pytest.approx(place - start, abs=1e-5)


def turns_after(lever: float, step: float, is_carried: bool = True, **changes: Any) -> bool:
    """Whether a load whose lever changes by a step [m] after 1.2 s is found to turn."""
    watch = SlipWatch(SLIPS, SETTINGS.rate)
    watch.start()
    wrench = np.array([0.0, 0.0, -3.0, 0.0, 0.0, 0.0])
    found = False
    for k in range(-600, 200):
        now = pressing(unfiltered=wrench, f_t=2.0)._replace(**changes)
        arm = lever + (k >= 0) * step
        found |= watch.check(now._replace(tau_n=now.f_t * arm), 1, is_carried)
    return found


@pytest.mark.parametrize(
    ("lever", "least", "changes"),
    [
        (0.0, SLIPS.lever_moved, {}),
        (0.0, SLIPS.lever_stds * 1e-4, {"tau_std": 2e-4}),
        (-0.01, SLIPS.lever_ratio * 0.01, {}),
    ],
)
def test_a_change_of_the_lever_is_turning_from_its_limit(
    lever: float, least: float, changes: dict[str, float]
) -> None:
    limit = least / (15.0 ** (-1 / 14) - 15.0 ** (-15 / 14))
    assert turns_after(lever, 1.05 * limit, **changes)
    assert not turns_after(lever, 0.94 * limit, **changes)
    assert not turns_after(lever, 9.0 * limit, is_carried=False, **changes)
    assert not turns_after(lever, 9.0 * limit, **changes, f_t=0.299)


@pytest.mark.parametrize("slow", [0.0, 1.0])
def test_a_turn_is_how_far_the_lever_has_moved_since_the_load_settled(slow: float) -> None:
    """Whether it moves at once or within three seconds; while the load comes onto the pads, it may move."""
    watch = SlipWatch(SLIPS, SETTINGS.rate)
    watch.start()
    wrench = np.array([0.0, 0.0, -3.0, 0.0, 0.0, 0.0])
    for k in range(3000):
        loading = 4e-3 * max(0.1 - k / SETTINGS.rate, 0.0)
        share = min(max(k - 600, 0) / (1500.0 * slow + 1.0), 1.0)
        now = pressing(unfiltered=wrench, f_t=2.0)._replace(tau_n=2.0 * (loading + 6e-4 * share))
        watch.check(now, 1, True)
        if k == 599:
            assert watch.turned < 1e-4
    assert watch.turned == pytest.approx(6e-4, abs=1e-4)


def test_after_a_slip_the_distance_goes_on_from_where_it_was_found() -> None:
    watch = SlipWatch(NEAR, SETTINGS.rate)
    watch.calibrate(np.zeros((8, 2, 6)))
    watch.start()
    found = []
    for k in range(1800):
        wrench = np.array([0.0, 0.0, -3.0, 0.0, 3.0 * (2e-3 if k >= 600 else 0.0), 0.0])
        if watch.check(pressing(unfiltered=wrench), 1, False):
            found.append(k)
    assert found
    assert all(later - earlier > 1 for earlier, later in pairwise(found))
    assert found[-1] < 700
    assert watch.slipped == pytest.approx(2e-3, rel=0.02)


def test_a_turn_that_was_found_is_not_found_again() -> None:
    watch = SlipWatch(SLIPS, SETTINGS.rate)
    watch.start()
    wrench = np.array([0.0, 0.0, -3.0, 0.0, 0.0, 0.0])
    found = []
    for k in range(1800):
        arm = 1.3 * SLIPS.lever_moved * (k >= 600) / (15.0 ** (-1 / 14) - 15.0 ** (-15 / 14))
        now = pressing(unfiltered=wrench, f_t=2.0)._replace(tau_n=2.0 * arm)
        if watch.check(now, 1, True):
            found.append(k)
    assert len(found) == 1


@pytest.mark.parametrize(("second", "expected"), [(-1.0, 1e-2), (1.0, 0.0), (0.0, 5e-3)])
def test_noise_of_the_torques_is_that_of_both_pads_which_face_each_other(
    second: float, expected: float
) -> None:
    """A torque about x of the second pad counts with the other sign, in the frame of the first one."""
    readings = np.zeros((4, 2, 6))
    readings[::2, 0, 3], readings[1::2, 0, 3] = 1e-2, -1e-2
    readings[:, 1, 3] = second * readings[:, 0, 3]
    watch = SlipWatch(NEAR, SETTINGS.rate)
    watch.calibrate(readings)
    assert watch._torque_std == pytest.approx(expected)
