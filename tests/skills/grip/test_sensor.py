"""Samples are validated once."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from pomona.devices.emulators.suntouch import SunTouchEmulator, encode
from pomona.devices.suntouch.calibration import FingerCalibration
from pomona.devices.suntouch.codec import decode
from pomona.drivers.interfaces import ForceSensor
from pomona.executive.files import find_cell
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.estimate import GripEstimate
from pomona.skills.grip.grip import GripPhase, UnfitSensor
from pomona.skills.grip.sensor import (
    GripSample,
    LowPass,
    SensorWatch,
    StreamGuard,
    Timer,
    check_bias,
)
from pomona.skills.grip.settings import RATES, BiasSettings, GripSettings
from pomona.tools.mock import MockClock, MockForceSensor


def periods(guard: StreamGuard, stamp: float, sequence: int, wrenches: np.ndarray) -> int:
    """Periods of the sample that the guard lets through, or 0."""
    sample = guard.accept(stamp, sequence, wrenches)
    return 0 if sample is None else sample.periods


def test_the_guard_counts_periods_and_drops_irregular_samples() -> None:
    guard = StreamGuard(0.002)
    zero = np.zeros((2, 6))
    assert periods(guard, 0.000, 0, zero) == 1
    assert periods(guard, 0.002, 1, zero) == 1
    assert periods(guard, 0.002, 1, zero) == 0
    assert periods(guard, 0.001, 0, zero) == 0
    assert periods(guard, 0.004, 2, np.full((2, 6), np.nan)) == 0
    assert periods(guard, 0.012, 6, zero) == 5
    assert periods(guard, 1.012, 506, zero) == 10


def test_a_restarted_sensor_is_followed() -> None:
    guard = StreamGuard(0.002)
    periods(guard, 5.0, 1000, np.zeros((2, 6)))
    assert periods(guard, 5.5, 0, np.zeros((2, 6))) > 0
    assert periods(guard, 5.502, 1, np.zeros((2, 6))) == 1


def test_a_sample_carries_its_time_and_its_flags() -> None:
    guard = StreamGuard(0.002)
    guard.accept(1.0, 0, np.zeros((2, 6)))
    sample = guard.accept(1.006, 3, np.ones((2, 6)), (True, False))
    assert sample is not None
    assert sample.elapsed == pytest.approx(0.006)
    assert sample.saturated == (True, False)
    assert sample.stamp == guard.stamp == 1.006


def test_a_timer_counts_without_a_break() -> None:
    timer = Timer()
    assert [timer.update(is_true, 0.5) for is_true in (True, True, False, True)] == [
        0.5,
        1.0,
        0.0,
        0.5,
    ]
    assert timer.lasted == 0.5


def test_an_average_starts_with_its_first_sample_and_follows_a_step_with_its_lag() -> None:
    average = LowPass(0.1)
    assert average.update(2.0, 0.01) == 2.0
    for _ in range(10):
        average.update(3.0, 0.01)
    assert average.value == pytest.approx(3.0 - math.exp(-1.0))


def test_an_average_does_not_depend_on_the_rate_of_its_samples() -> None:
    fine, coarse = LowPass(0.1, 0.0), LowPass(0.1, 0.0)
    for _ in range(10):
        fine.update(1.0, 0.002)
    assert coarse.update(1.0, 0.02) == pytest.approx(fine.value)


SCALE = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])
SETTINGS = BiasSettings()


def noise(count: int = 100, std: float = 0.04, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    offset = rng.uniform(-0.08, 0.08, (2, 6)) * SCALE
    samples: np.ndarray = offset + std * SCALE * rng.normal(0.0, 1.0, (count, 2, 6))
    return samples


def stepped(samples: np.ndarray, step: float, channels: slice = slice(0, 3)) -> np.ndarray:
    coarse = samples.copy()
    coarse[:, :, channels] = step * np.round(samples[:, :, channels] / step)
    return coarse


def refused(samples: np.ndarray, rate: float = 500.0) -> UnfitSensor:
    with pytest.raises(UnfitSensor) as caught:
        check_bias(samples, rate, SETTINGS)
    return caught.value


@pytest.mark.parametrize("rate", [*RATES, 500.0])
@pytest.mark.parametrize("std", [1e-4, 0.04, 0.2])
@pytest.mark.parametrize("seed", range(20))
def test_noisy_sensors_of_every_rate_that_a_grip_takes_pass(
    rate: float, std: float, seed: int
) -> None:
    check_bias(noise(round(0.2 * rate), std, seed), rate, SETTINGS)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("step", [0.02, 0.1])
def test_steps_within_the_sensors_accuracy_pass(step: float, seed: int) -> None:
    check_bias(
        stepped(stepped(noise(seed=seed, std=0.06), step), 0.01 * step, slice(3, 6)),
        500.0,
        SETTINGS,
    )


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("step", [0.3, 0.5, 1.0])
def test_forces_in_coarse_steps_are_refused_whether_noise_crosses_a_step_or_not(
    step: float, seed: int
) -> None:
    error = refused(stepped(noise(seed=seed), step))
    assert "finger's force" in str(error)
    assert ("in steps of" in str(error)) == (error.measured > SETTINGS.step)
    assert error.measured in (0.0, pytest.approx(step))


def test_an_error_has_measured_value_expected_value_and_remedy() -> None:
    samples = noise()
    samples[:, 1, 2] = np.where(np.arange(100) % 7, 0.0, 0.5)
    error = refused(samples)
    assert str(error) == (
        "the right finger's force z changes in steps of 0.5 N, at most 0.2 N is expected: set its resolution"
    )
    assert (error.measured, error.expected) == (pytest.approx(0.5), 0.2)
    samples = noise()
    samples[:, 0, 4] = np.where(np.arange(100) % 7, 0.0, 5e-3)
    assert (
        "the left finger's torque y changes in steps of 5 mN·m, at most 2 mN·m is expected"
        in str(refused(samples))
    )


@pytest.mark.parametrize("axis", range(3))
def test_a_force_that_shows_no_noise_beside_noisy_channels_is_refused(axis: int) -> None:
    samples = noise()
    samples[:, 0, axis] = 0.3
    words = f"the left finger's force {'xyz'[axis]} did not change in 100 samples, its other channels did"
    assert words in str(refused(samples))


def test_torques_that_a_sensor_does_not_measure_pass() -> None:
    samples = noise()
    samples[:, :, 3:] = 0.0
    check_bias(samples, 500.0, SETTINGS)


@pytest.mark.parametrize(("held", "share", "fresh"), [(2, 50, 250), (10, 90, 50)])
@pytest.mark.parametrize("side", [0, 1])
def test_copies_are_refused_with_the_rate_that_is_behind_them(
    held: int, share: int, fresh: int, side: int
) -> None:
    samples = noise(200)
    samples[:, side] = np.repeat(samples[::held, side], held, axis=0)[:200]
    error = refused(samples)
    assert f"finger repeats {share} % of its samples, at most 10 % are expected" in str(error)
    assert f"measures at about {fresh} Hz and delivers 500 Hz" in str(error)
    assert error.measured == pytest.approx(share / 100, abs=0.02)


def test_a_sensor_that_loses_a_sample_now_and_then_and_one_without_any_noise_pass() -> None:
    samples = noise(200)
    samples[50::25] = samples[49:-1:25]
    check_bias(samples, 500.0, SETTINGS)
    check_bias(np.zeros((100, 2, 6)), 500.0, SETTINGS)


def test_the_simulated_the_mock_and_the_emulated_fingers_pass() -> None:
    from pomona.executive.cell.connect import load_cell

    cell = load_cell(find_cell("sim"), seed=3)
    taken: list[np.ndarray] = []
    subscription = cell.device(ForceSensor).subscribe(
        lambda sample: taken.append(sample.wrenches.copy())
    )
    cell.clock.advance(0.3)
    subscription.close()
    cell.close()
    check_bias(np.array(taken), 500.0, SETTINGS)
    clock = MockClock()
    fingers, said = MockForceSensor(clock), list[np.ndarray]()
    fingers.subscribe(lambda sample: said.append(sample.wrenches.copy()))
    clock.advance(0.3)
    check_bias(np.array(said), 500.0, SETTINGS)
    folder = find_cell("sim").parent / "emulated_fingers"
    measured = []
    for seed, side in enumerate(("left", "right")):
        pad, calibration = (
            SunTouchEmulator(lambda: np.zeros(6), seed),
            FingerCalibration.load(folder / f"{side}.json"),
        )
        rng = np.random.default_rng(seed)
        volts = np.array(
            [decode(encode(pad.pad.rest + rng.normal(0.0, 4e-4, 25))).volts for _ in range(100)]
        )
        measured.append(calibration.wrench(volts - volts.mean(axis=0)))
    check_bias(np.stack(measured, axis=1), 500.0, SETTINGS)


def test_a_grip_with_an_unfit_sensor_fails_before_the_fingers_close() -> None:
    controller = GripController(GripSettings())
    controller.width = 0.09
    speeds = [
        controller.step(0.002 * i, i, sample) for i, sample in enumerate(stepped(noise(400), 0.5))
    ]
    assert controller.phase is GripPhase.FAILED
    assert controller.problem is not None
    assert controller.problem.code == "SENSOR_FAULT"
    assert controller.problem.data["expected"] in (SETTINGS.step, 1e-9)
    assert not any(speeds)


NOISE = np.array([1, 1, 1, 0.005, 0.005, 0.005])
Change = Callable[[np.ndarray, np.ndarray], None]


def carrying(
    noise: float = 0.04, load: float = 2.0, seconds: float = 3.2, **settings: float
) -> tuple:
    """A controller that carries a fruit between noisy fingers: itself, the generator, the true wrenches, the count."""
    rng, controller = np.random.default_rng(0), GripController(GripSettings(**settings))
    controller.width = 0.08
    wrenches = np.zeros((2, 6))
    count, touched, pressing = round(seconds * 500), 0, 2.0
    for i in range(count):
        touched = touched or (i + 20 if controller.phase is GripPhase.CLOSING else 0)
        wrenches[:, 2] = -pressing if 0 < touched < i else 0.0
        wrenches[:, 0] = 0.5 * load if 0 < touched + 200 < i and touched else 0.0
        pressing = (
            min(pressing + 1000.0 * -controller.speed * 0.002, 8.0)
            if 0 < touched + 1 < i and touched
            else 2.0
        )
        controller.step(0.002 * i, i, wrenches + noise * NOISE * rng.normal(0.0, 1.0, (2, 6)))
    assert controller.phase is GripPhase.HOLDING
    assert controller.is_carried
    return controller, rng, wrenches, count


def lie(change: Change, noise: float = 0.04, most: int = 100) -> tuple[GripController, int]:
    """Continue with changed samples; return their number at SENSOR_FAULT, or -1."""
    controller, rng, wrenches, count = carrying(noise)
    before = wrenches + noise * NOISE * rng.normal(0.0, 1.0, (2, 6))
    for i in range(count, count + most):
        sample = wrenches + noise * NOISE * rng.normal(0.0, 1.0, (2, 6))
        change(sample, before)
        controller.step(0.002 * i, i, sample)
        if controller.problem is not None and controller.problem.code == "SENSOR_FAULT":
            return controller, i - count + 1
    return controller, -1


def stuck(side: slice) -> Change:
    def change(sample: np.ndarray, before: np.ndarray) -> None:
        sample[side] = before[side]

    return change


def shifted(index: tuple[object, int], by: float) -> Change:
    def change(sample: np.ndarray, _before: np.ndarray) -> None:
        sample[index] += by

    return change


def clipped(sample: np.ndarray, _before: np.ndarray) -> None:
    sample[0, 2] = max(sample[0, 2], -1.0)


def zero(sample: np.ndarray, _before: np.ndarray) -> None:
    sample[:] = 0.0


@pytest.mark.parametrize("noise", [0.04, 0.2])
@pytest.mark.parametrize(
    "change",
    [stuck(slice(0, 1)), stuck(slice(1, 2)), stuck(slice(0, 2)), zero, clipped],
    ids=["left stuck", "right stuck", "both stuck", "both zero", "left clipped"],
)
def test_samples_that_say_nothing_are_found_within_fifty_milliseconds(
    change: Change, noise: float
) -> None:
    controller, samples = lie(change, noise)
    assert 0 < samples <= 25
    assert controller.phase is GripPhase.HOLDING
    assert controller.problem is not None
    assert "the grip is kept" in controller.problem.message
    assert controller.is_frozen


@pytest.mark.parametrize(("noise", "by"), [(0.04, 1.2), (0.2, 2.2)])
@pytest.mark.parametrize(
    ("index", "sign"),
    [((0, 2), -1), ((1, 2), 1), ((slice(None), 2), -1), ((0, 0), 1), ((1, 1), -1)],
    ids=[
        "left presses more",
        "right presses less",
        "both press more",
        "left pulled",
        "right pulled aside",
    ],
)
def test_an_offset_that_jumps_is_found_where_it_is_beyond_noise(
    index: tuple[object, int], sign: int, noise: float, by: float
) -> None:
    controller, samples = lie(shifted(index, sign * by), noise)
    assert 0 < samples <= 25
    assert controller.phase is GripPhase.HOLDING
    assert controller.is_frozen


def bouncing(side: int, share: float = 0.0, back: float = 1.35) -> Change:
    """The contact of a fruit that slides: a load goes for one sample, comes back too strong, and rests."""
    count = [0]

    def change(sample: np.ndarray, _before: np.ndarray) -> None:
        count[0] += 1
        sample[side] *= {1: share, 2: back}.get(count[0] % 6, 1.0)

    return change


@pytest.mark.parametrize("noise", [0.0, 0.04])
@pytest.mark.parametrize("side", [0, 1])
def test_contacts_of_a_fruit_that_slides_break_and_form_and_no_finger_is_accused(
    side: int, noise: float
) -> None:
    controller, samples = lie(bouncing(side), noise, most=500)
    assert samples == -1
    assert not controller.is_frozen


@pytest.mark.parametrize("side", [0, 1])
def test_a_fruit_that_swings_between_the_pads_after_a_contact_broke_accuses_no_finger(
    side: int,
) -> None:
    count = [0]

    def swing(sample: np.ndarray, _before: np.ndarray) -> None:
        count[0] += 1
        sample[side] *= {1: 0.0, 2: 1.35}.get(count[0] % 40, 1.0)
        sample[1 - side, 2] -= 1.2 if 8 < count[0] % 40 < 14 else 0.0

    assert lie(swing, most=400)[1] == -1


def swinging(size: float, period: int, lag: float) -> Change:
    """A fruit that swings between the pads: both normal forces change, one after the other."""
    count = [0]

    def change(sample: np.ndarray, _before: np.ndarray) -> None:
        count[0] += 1
        for side in (0, 1):
            sample[side, 2] -= size * np.sin(2.0 * np.pi * count[0] / period - side * lag)

    return change


def test_a_finger_that_swings_through_its_average_is_not_quiet() -> None:
    assert lie(swinging(1.0, 24, 2.6), most=200)[1] == -1


@pytest.mark.parametrize("side", [0, 1])
def test_a_finger_that_shows_half_of_its_load_from_now_on_is_found_within_fifty_milliseconds(
    side: int,
) -> None:
    def change(sample: np.ndarray, _before: np.ndarray) -> None:
        sample[side] *= 0.5

    controller, samples = lie(change)
    assert 0 < samples <= 25
    assert controller.problem is not None
    assert "presses on both fingers alike" in controller.problem.message


@pytest.mark.parametrize("noise", [0.0, 0.04, 0.2])
def test_sound_fingers_are_not_accused(noise: float) -> None:
    controller, samples = lie(lambda _sample, _before: None, noise, most=5000)
    assert samples == -1
    assert controller.problem is None


def test_coarse_steps_are_no_lie() -> None:
    """A sensor that resolves a tenth of a newton repeats its values for long."""
    rng, watch = np.random.default_rng(1), SensorWatch(GripSettings())
    samples = np.round(0.04 * rng.normal(0.0, 1.0, (5000, 2, 6)), 1)
    watch.calibrate(samples[:200])
    for i, wrenches in enumerate(samples[200:]):
        watch.check(GripSample(0.002 * i, 1, 0.002, wrenches), GripEstimate(), False, 0.0)
    assert watch.reason == ""


def test_a_finger_that_is_stuck_from_the_start_is_known_by_the_other_ones_noise() -> None:
    rng, controller = np.random.default_rng(0), GripController(GripSettings())
    controller.width = 0.08
    for i in range(200):
        wrenches = 0.04 * rng.normal(0.0, 1.0, (2, 6))
        wrenches[1] = 0.3
        controller.step(0.002 * i, i, wrenches)
    assert controller.phase is GripPhase.FAILED
    assert controller.problem is not None
    assert controller.problem.code == "SENSOR_FAULT"
    assert "right finger" in controller.problem.message


def test_a_motor_that_presses_while_the_fingers_feel_nothing_ends_the_closing() -> None:
    controller = GripController(GripSettings())
    controller.width, pressed = 0.08, 0.0
    for i in range(3000):
        controller.motor_force = pressed = max(2000.0 * (0.07 - controller.width), 0.0)
        controller.step(0.002 * i, i, np.zeros((2, 6)))
        controller.width += controller.speed * 0.002
        if controller.phase is GripPhase.FAILED:
            break
    assert controller.problem is not None
    assert controller.problem.code == "SENSOR_FAULT"
    assert "motor presses" in controller.problem.message
    assert pressed < 8.0


def motor_and_fingers(
    fingers: Callable[[float], float], motor: Callable[[float], float]
) -> tuple[SensorWatch, float]:
    """A watch after half a second of commands, and the time of its fault [s]; infinite without one."""
    watch, period = SensorWatch(GripSettings()), 0.02
    for n in range(25):
        watch.compare_with_motor(fingers(n * period), motor(n * period), period)
        if watch.reason:
            return watch, n * period
    return watch, np.inf


@pytest.mark.parametrize("force", [4.0, 7.0, 10.0])
def test_a_fruit_that_is_lost_at_once_is_no_fault_of_the_fingers(force: float) -> None:
    """The motor's force follows within a command; the average of 30 ms alone lasts longer."""
    lost = 0.2
    watch, _ = motor_and_fingers(
        lambda t: 0.0 if t >= lost else force, lambda t: 0.0 if t > lost else force
    )
    assert watch.reason == ""


@pytest.mark.parametrize("force", [4.0, 7.0, 14.0])
def test_fingers_that_read_nothing_while_the_motor_presses_on_are_found_within_two_commands(
    force: float,
) -> None:
    lost = 0.2
    watch, found = motor_and_fingers(lambda t: 0.0 if t >= lost else force, lambda _t: force)
    assert "motor presses" in watch.reason
    assert found - lost <= 0.08


def test_a_saturated_finger_is_reported_as_saturated() -> None:
    controller, rng, wrenches, count = carrying()
    for i in range(count, count + 60):
        sample = wrenches + 0.04 * NOISE * rng.normal(0.0, 1.0, (2, 6))
        sample[0] = -8.0
        controller.step(0.002 * i, i, sample, (True, False))
    assert controller.problem is not None
    assert controller.problem.code in ("SENSOR_SATURATED", "SENSOR_FAULT")
    assert controller.speed == 0.0
