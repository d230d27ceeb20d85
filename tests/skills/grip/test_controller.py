"""The controller on a LuGre contact that shares no code with it: lifts, bad input, comparison, determinism."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.grasp_mujoco import TORSION, MujocoGrasp, cone_contact
from benchmarks.grasp_patch import Fruit, PatchGrasp
from benchmarks.grasp_trial import Corrupt, Lifting, TrialResult, run_trial
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.grip import GripPhase, UnusableRate
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.settings import ForceLaw, ForceLoopSettings, GripSettings

APPLE = Fruit(mass=0.2, width=0.075, mu=0.6, offset=(0.004, -0.003))


def settings_of(fruit: Fruit, **changes: Any) -> GripSettings:
    contact = SoftContact(fruit.mu, fruit.delta, fruit.gamma, fruit.k)
    return replace(GripSettings(contact=contact, loop=ForceLoopSettings(max_force=30.0)), **changes)


def lift(fruit: Fruit = APPLE, **kwargs: Any) -> TrialResult:
    changes = kwargs.pop("settings", {})
    lifting = kwargs.pop("lifting", Lifting(hold=1.5))
    return run_trial(fruit, settings_of(fruit, **changes), lifting, **{"noise": 0.1, **kwargs})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fruit", "most_turn"),
    [
        (APPLE, 4.0),
        (Fruit(mass=0.06, width=0.055, mu=0.9), 4.0),
        (Fruit(mass=0.35, width=0.085, mu=0.45, offset=(-0.004, 0.008)), 5.0),
        (
            Fruit(mass=0.15, mu=0.7, offset=(0.010, 0.0), off_centre=0.003),
            7.0,
        ),  # 5.6 to 6.9° over twelve seeds
    ],
)
def test_a_fruit_of_unknown_weight_is_lifted_with_little_more_than_the_least_force(
    fruit: Fruit, most_turn: float
) -> None:
    result = lift(fruit)
    assert result.held
    assert result.slip < 0.002
    assert np.degrees(result.turn) < most_turn
    assert 1.0 < result.steady / result.least < 1.25 + 0.1 / result.least
    assert result.pressure < 0.10e6
    assert result.grasp_time < 1.2


def test_the_simulators_contact_is_held_too() -> None:
    fruit = Fruit(mass=0.2, mu=0.7, offset=(0.003, 0.0))
    settings = settings_of(fruit, contact=cone_contact(0.7, TORSION))
    result = run_trial(fruit, settings, Lifting(hold=1.5), noise=0.1, world=MujocoGrasp)
    assert result.held
    assert result.slip < 0.002
    assert result.steady / result.least == pytest.approx(1.1, abs=0.1)


@pytest.mark.parametrize("wrong", [0.85, 1.15])
def test_friction_that_is_known_badly_costs_force_and_no_fruit(wrong: float) -> None:
    contact = SoftContact(APPLE.mu * wrong)
    result = lift(settings={"contact": contact, "mu_uncertainty": 0.15})
    assert result.held
    assert result.slip < 0.002
    assert result.steady / result.least < 1.6


def test_a_pull_is_answered_before_the_fruit_slides_away() -> None:
    result = lift(lifting=Lifting(hold=2.0, pull=2.0))
    assert result.held
    assert result.pull_slip < 0.002
    assert result.reaction <= 0.040


def test_a_reserve_bears_a_pull_without_waiting_for_the_fingers() -> None:
    result = lift(lifting=Lifting(hold=2.0, pull=2.0), settings={"reserve": 2.0, "offset": 0.015})
    assert result.held
    assert result.pull_slip < 0.0005


def test_first_contact_is_soft_even_off_the_middle() -> None:
    result = lift(replace(APPLE, off_centre=0.004))
    assert result.held
    assert result.contact_peak < 2.5
    assert lift().contact_peak < 1.0


@pytest.mark.slow
def test_baselines_run_in_the_same_code_and_do_worse() -> None:
    ours = lift()
    coulomb = lift(settings={"law": ForceLaw.COULOMB})
    constant = lift(settings={"law": ForceLaw.CONSTANT, "initial_force": 10.0})
    assert np.degrees(coulomb.turn) > 3.0 * np.degrees(ours.turn)
    assert constant.held
    assert constant.steady > 1.5 * ours.steady


def test_a_trial_repeats_itself_exactly() -> None:
    first, again = lift(seed=3), lift(seed=3)
    assert np.abs(np.array(first.trace.f_n) - np.array(again.trace.f_n)).max() < 1e-9


# --------------------------------------------------------------------------------------------------- bad input


def now_and_then(
    change: Callable[[int, float, np.ndarray], list[tuple[int, float, np.ndarray]]], at: int
) -> Corrupt:
    """Deliver good samples until the `at`-th after the grip was made, then each changed by `change`."""
    count = 0

    def corrupt(
        sequence: int, stamp: float, wrenches: np.ndarray
    ) -> list[tuple[int, float, np.ndarray]]:
        nonlocal count
        count += 1
        if count < at:
            return [(sequence, stamp, wrenches)]
        return change(count - at, stamp, wrenches.copy(), sequence)  # type: ignore[call-arg]

    return corrupt


def run_held(corrupt: Corrupt, hold: float = 1.0) -> tuple[TrialResult, float, float]:
    """A held fruit whose stream goes bad 0.2 s after the lift: the result, most opened and most closed since [m]."""
    lifting = Lifting(height=0.05, acceleration=1.0, hold=hold)
    result = lift(lifting=lifting, corrupt=corrupt, settings={"relax_rate": 20.0})
    since = round((0.04 + lifting.duration + 0.2) / 0.002)
    width = np.array(result.trace.width)[since:]
    return result, float(width.max() - width[0]), float(width[0] - width.min())


LIFTED = round((0.04 + Lifting(height=0.05, acceleration=1.0).duration + 0.2) / 0.002)
STEADY_WAY = 3e-4
"""How far the fingers move in this time without any fault: the force is still relaxing [m]."""


def repeated(
    _n: int, stamp: float, wrenches: np.ndarray, sequence: int
) -> list[tuple[int, float, np.ndarray]]:
    return [(sequence, stamp, wrenches)] * 3


def out_of_order(
    n: int, stamp: float, wrenches: np.ndarray, sequence: int
) -> list[tuple[int, float, np.ndarray]]:
    return [(sequence, stamp, wrenches), (sequence - 3, stamp - 0.006, -wrenches)]


def not_finite(
    n: int, stamp: float, wrenches: np.ndarray, sequence: int
) -> list[tuple[int, float, np.ndarray]]:
    if n % 3 == 0:
        wrenches[n % 2, n % 6] = np.nan if n % 2 else np.inf
    return [(sequence, stamp, wrenches)]


def gap(length: float) -> Callable[..., list[tuple[int, float, np.ndarray]]]:
    def missing(
        n: int, stamp: float, wrenches: np.ndarray, sequence: int
    ) -> list[tuple[int, float, np.ndarray]]:
        return [] if n * 0.002 < length else [(sequence, stamp, wrenches)]

    return missing


def dead(
    n: int, stamp: float, wrenches: np.ndarray, sequence: int
) -> list[tuple[int, float, np.ndarray]]:
    wrenches[1] = 0.0
    return [(sequence, stamp, wrenches)]


def biased(
    finger: int, channel: int, offset: float
) -> Callable[..., list[tuple[int, float, np.ndarray]]]:
    def bias(
        n: int, stamp: float, wrenches: np.ndarray, sequence: int
    ) -> list[tuple[int, float, np.ndarray]]:
        wrenches[finger, channel] += offset
        return [(sequence, stamp, wrenches)]

    return bias


@pytest.mark.parametrize(
    ("fault", "closes"),
    [
        (repeated, 1e-4),
        (out_of_order, 1e-4),
        (not_finite, 1e-4),
        (gap(0.005), 1e-4),
        (gap(0.020), 1e-4),
        (gap(0.100), 3e-4),
        (dead, 2e-3),
        (biased(0, 2, -1.0), 5e-4),
        (biased(0, 2, +1.0), 2.5e-3),
        (biased(1, 0, +1.0), 3e-3),
        (biased(1, 0, -1.0), 3e-3),
    ],
    ids=[
        "repeated", "out of order", "not finite", "5 ms missing", "20 ms missing", "100 ms missing", "one finger dead",
        "presses 1 N more", "presses 1 N less", "pulled 1 N more", "pulled 1 N less",
    ],
)  # fmt: skip
def test_bad_input_never_opens_the_grip_and_closes_it_by_a_bounded_step(
    fault: Callable[..., list[tuple[int, float, np.ndarray]]], closes: float
) -> None:
    result, opened, closed = run_held(now_and_then(fault, LIFTED))
    assert result.held
    assert result.slip < 0.002
    assert opened < STEADY_WAY
    assert closed < closes + STEADY_WAY


def holding(**changes: Any) -> tuple[GripController, np.ndarray]:
    """A controller that holds, stepped by hand, and the wrenches that it feels."""
    controller = GripController(replace(GripSettings(), **changes))  # type: ignore[arg-type]
    controller.width = 0.08
    wrenches = np.zeros((2, 6))
    for i in range(500):
        wrenches[:, 2] = 0.0 if i < 120 else -1.1
        wrenches[:, 0] = 0.3 if i > 200 else 0.0
        controller.step(0.002 * i, i, wrenches)
    assert controller.phase is GripPhase.HOLDING
    return controller, wrenches


def test_a_saturated_finger_neither_opens_nor_closes_and_is_reported() -> None:
    controller, wrenches = holding()
    speeds = [
        controller.step(1.0 + 0.002 * i, 500 + i, 3.0 * wrenches, (True, False)) for i in range(100)
    ]
    assert {speed for speed in speeds if speed is not None} == {0.0}
    assert controller.problem is not None
    assert controller.problem.code == "SENSOR_SATURATED"


def test_a_dead_finger_is_reported_and_the_other_one_counts() -> None:
    controller, wrenches = holding()
    wrenches[0] = 0.0
    for i in range(100):
        controller.step(1.0 + 0.002 * i, 500 + i, wrenches)
    assert controller.problem is not None
    assert controller.problem.code == "ONE_FINGER"
    assert controller.phase is GripPhase.HOLDING


def test_a_finger_that_reads_too_little_does_not_let_the_other_one_press_beyond_the_limit() -> None:
    """The pads give as springs; the left finger's signal shows half of its load, and the fruit needs 12 N."""
    controller, wrenches = holding()
    wrenches[:, 0] = 3.6
    pressed = 1.1
    most = 0.0
    for i in range(2000):
        wrenches[:, 2] = -0.5 * pressed, -pressed
        controller.step(1.0 + 0.002 * i, 500 + i, wrenches)
        pressed -= 0.5 * controller.settings.loop.stiffness * controller.speed * 0.002
        most = max(most, pressed)
    assert (
        0.4 * controller.settings.loop.max_force
        < most
        <= 0.505 * controller.settings.loop.max_force
    )
    assert controller.problem is not None


def test_after_a_jump_of_one_fingers_load_alone_the_force_never_falls_again() -> None:
    controller, wrenches = holding()
    for i in range(1000):
        if i == 500:
            before = controller.reading.f_ref
            wrenches[0, 0] -= 1.0
        controller.step(1.0 + 0.002 * i, 500 + i, wrenches)
        wrenches[:, 2] += (
            0.5 * controller.settings.loop.stiffness * controller.speed * 0.002
        )  # the pads give
    assert controller.is_frozen
    assert controller.reading.f_ref >= before - 0.02


def test_a_load_that_jumps_on_one_finger_is_no_fault_while_a_support_carries_the_fruit() -> None:
    controller, wrenches = holding()
    controller.rests = True
    wrenches[0, 0] -= 1.0
    for i in range(100):
        controller.step(1.0 + 0.002 * i, 500 + i, wrenches)
    controller.rests = False
    for i in range(100):
        controller.step(1.2 + 0.002 * i, 600 + i, wrenches)
    assert controller.problem is None
    assert not controller.is_frozen


def test_after_a_jump_of_one_fingers_press_alone_the_fingers_do_not_open() -> None:
    controller, wrenches = holding()
    wrenches[1, 2] -= 1.0
    speeds = [controller.step(1.0 + 0.002 * i, 500 + i, wrenches) for i in range(100)]
    assert all(speed is None or speed <= 0.0 for speed in speeds)


def test_a_million_steps_leave_nothing_behind() -> None:
    """In miniature; the bench does the million."""
    controller, wrenches = holding()
    sizes = []
    for i in range(3000):
        controller.step(1.0 + 0.002 * i, 500 + i, wrenches)
        if i % 1500 == 1499:
            sizes.append(len(pickle.dumps(controller)))
    assert sizes[1] - sizes[0] < 100  # [bytes]; numbers that grow take another byte


def test_a_pushed_fruit_that_hops_from_one_finger_to_the_other_is_still_grasped() -> None:
    fruit = Fruit(mass=0.3895, width=0.0583, mu=0.604, offset=(-0.0001, 0.0124), off_centre=-0.0028)
    for seed in (0, 50):  # with the second the fruit hops
        trial = run_trial(fruit, settings_of(fruit), Lifting(hold=0.2), noise=0.2, seed=seed)
        assert trial.grasped
        assert trial.held


def test_the_contact_of_a_light_fruit_that_is_pressed_hard_gives_no_energy() -> None:
    grasp = PatchGrasp(Fruit(mass=0.05, width=0.05, mu=0.4, offset=(0.015, 0.010)), opening=0.051)
    grasp.command = -0.02
    borne = []
    for i in range(800):
        if grasp.f_n > 40.0:
            grasp.command = 0.0
        grasp.pull = (0.0, -3.0 if i > 600 else 0.0)
        grasp.step()
        if i > 500:
            borne.append(np.hypot(*grasp.wrenches[:, :2].sum(axis=0)))
    assert grasp.f_n > 38.0
    assert max(borne) < 4.0
    assert abs(grasp.turn) < 0.2


# ------------------------------------------------------------------------------------------------ sensors' rates


@pytest.mark.parametrize("rate", [100.0, 250.0, 330.0, 1000.0, 2000.0])
def test_a_sensor_of_any_usable_rate_lifts_the_fruit(rate: float) -> None:
    result = lift(settings={"rate": rate}, lifting=Lifting(hold=0.5))
    assert result.held
    assert result.slip < 0.002
    assert np.degrees(result.turn) < 5.0
    assert 1.0 < result.steady / result.least < 1.4


@pytest.mark.parametrize("rate", [0.0, 99.0, 2001.0, float("nan")])
def test_a_sensor_that_is_too_slow_or_too_fast_is_refused_in_words(rate: float) -> None:
    with pytest.raises(UnusableRate, match="samples a second; a grip needs 100 to 2000"):
        GripSettings(rate=rate)
