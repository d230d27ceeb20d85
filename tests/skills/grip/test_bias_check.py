"""Sensors that are too coarse, too constant or repeat themselves are refused with their bias; sound ones pass."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.devices.emulators.suntouch import SunTouchEmulator
from pomona.devices.suntouch.calibration import FingerCalibration
from pomona.devices.suntouch.codec import decode, encode
from pomona.drivers.interfaces import ForceSensor
from pomona.drivers.mock import MockClock, MockForceSensor
from pomona.executive.files import find_cell
from pomona.skills.grip.bias_check import check_bias
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.errors import UnfitSensor
from pomona.skills.grip.grip import GripPhase
from pomona.skills.grip.settings import RATES, BiasSettings, GripSettings

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
def test_noisy_sensors_of_every_rate_that_a_grip_takes_pass(rate: float, std: float, seed: int) -> None:
    check_bias(noise(round(0.2 * rate), std, seed), rate, SETTINGS)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("step", [0.02, 0.1])
def test_steps_within_the_sensors_accuracy_pass(step: float, seed: int) -> None:
    check_bias(stepped(stepped(noise(seed=seed, std=0.06), step), 0.01 * step, slice(3, 6)), 500.0, SETTINGS)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("step", [0.3, 0.5, 1.0])
def test_forces_in_coarse_steps_are_refused_whether_noise_crosses_a_step_or_not(step: float, seed: int) -> None:
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
    assert "the left finger's torque y changes in steps of 5 mN·m, at most 2 mN·m is expected" in str(refused(samples))


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
def test_copies_are_refused_with_the_rate_that_is_behind_them(held: int, share: int, fresh: int, side: int) -> None:
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
    subscription = cell.device(ForceSensor).subscribe(lambda sample: taken.append(sample.wrenches.copy()))
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
        pad, calibration = SunTouchEmulator(lambda: np.zeros(6), seed), FingerCalibration.load(folder / f"{side}.json")
        rng = np.random.default_rng(seed)
        volts = np.array([decode(encode(pad.pad.rest + rng.normal(0.0, 4e-4, 25))).volts for _ in range(100)])
        measured.append(calibration.wrench(volts - volts.mean(axis=0)))
    check_bias(np.stack(measured, axis=1), 500.0, SETTINGS)


def test_a_grip_with_an_unfit_sensor_fails_before_the_fingers_close() -> None:
    controller = GripController(GripSettings())
    controller.width = 0.09
    speeds = [controller.step(0.002 * i, i, sample) for i, sample in enumerate(stepped(noise(400), 0.5))]
    assert controller.phase is GripPhase.FAILED
    assert controller.problem is not None
    assert controller.problem.code == "SENSOR_FAULT"
    assert controller.problem.data["expected"] in (SETTINGS.step, 1e-9)
    assert not any(speeds)
