"""Accepted samples of a device, and the reports about the others."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault
from pomona.drivers.interfaces import WrenchSample
from pomona.drivers.streams import (
    EARLY_FRAME,
    FEW,
    FEW_FRAMES,
    SILENCE,
    Belief,
    FrameGuard,
    WrenchStream,
)
from pomona.executive.clock import ManualClock

PERIOD = 0.002


class Sensor:
    """A live sensor with noise; `change` makes something else of each sample."""

    def __init__(self) -> None:
        self.clock = ManualClock(50.0)
        self.lost = 0
        self.stream = WrenchStream(self.clock, on_lost=self.lose)
        self.received: list[WrenchSample] = []
        self.stream.subscribe(self.received.append)
        self.rng = np.random.default_rng(1)
        self.sequence = 0

    def lose(self) -> None:
        self.lost += 1

    def sample(self, late: float = 0.0) -> WrenchSample:
        self.sequence += 1
        wrenches = self.rng.normal(0.0, 0.05, (2, 6))
        return WrenchSample(self.clock.now() - late, self.sequence, wrenches)

    def run(
        self, seconds: float, change: Callable[[WrenchSample], WrenchSample] = lambda sample: sample
    ) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.clock.advance(PERIOD)
            self.stream.deliver(change(self.sample()))

    def told(self) -> str:
        problem = self.stream.problem("fingers")
        return "" if problem is None else problem.message


@pytest.fixture
def sensor() -> Sensor:
    sensor = Sensor()
    sensor.run(0.1)
    assert len(sensor.received) == 50
    return sensor


def with_value(finger: int, value: float) -> Callable[[WrenchSample], WrenchSample]:
    def change(sample: WrenchSample) -> WrenchSample:
        wrenches = sample.wrenches.copy()
        wrenches[finger, 2] = value
        return replace(sample, wrenches=wrenches)

    return change


def shifted(seconds: float) -> Callable[[WrenchSample], WrenchSample]:
    return lambda sample: WrenchSample(sample.stamp + seconds, sample.sequence, sample.wrenches)


@pytest.mark.parametrize("finger", [0, 1])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -201.0])
def test_an_impossible_force_is_a_fault_at_once_and_reaches_no_skill(
    sensor: Sensor, finger: int, value: float
) -> None:
    sensor.run(PERIOD, with_value(finger, value))
    assert sensor.told().startswith(f"the {('left', 'right')[finger]} finger reports {value:g} ")
    assert len(sensor.received) == 50
    assert sensor.lost == 1


@pytest.mark.parametrize("shift", [-0.5, -30.0, 0.1, 10.0, np.nan, -np.inf])
def test_stamps_that_cannot_be_are_a_fault_within_50_ms(sensor: Sensor, shift: float) -> None:
    sensor.run(0.050, shifted(shift))
    assert "stamps its samples" in sensor.told() or "s old" in sensor.told()
    assert len(sensor.received) == 50


def test_a_sample_that_is_repeated_is_a_fault_within_50_ms(sensor: Sensor) -> None:
    last = sensor.received[-1]
    sensor.run(0.050, lambda _: last)
    assert sensor.told() == "repeats its sample 50"
    assert len(sensor.received) == 50


def test_samples_out_of_order_are_left_out(sensor: Sensor) -> None:
    late = sensor.sample(late=0.01)
    sensor.run(PERIOD)
    sensor.stream.deliver(WrenchSample(late.stamp, late.sequence, late.wrenches))
    assert len(sensor.received) == 51
    assert sensor.stream.left_out == 1
    assert sensor.told() == ""


def test_a_stall_of_the_computer_causes_no_fault(sensor: Sensor) -> None:
    sensor.clock.advance(0.5)
    for age in (0.4, 0.3, 0.2):  # what waited meanwhile is old
        sensor.stream.deliver(sensor.sample(late=age))
    sensor.run(0.1)
    assert sensor.told() == ""
    assert sensor.stream.left_out == 3


@pytest.mark.parametrize("fingers", [[0], [1], [0, 1]])
@pytest.mark.parametrize("zero", [True, False])
def test_a_finger_that_repeats_its_sample_is_stuck(
    sensor: Sensor, fingers: list[int], zero: bool
) -> None:
    stuck = np.zeros((2, 6)) if zero else sensor.received[-1].wrenches.copy()

    def hold(sample: WrenchSample) -> WrenchSample:
        wrenches = sample.wrenches.copy()
        wrenches[fingers] = stuck[fingers]
        return replace(sample, wrenches=wrenches)

    sensor.run(Belief().stuck - 2 * PERIOD, hold)
    assert sensor.told() == ""
    sensor.run(3 * PERIOD, hold)
    who = (
        "both fingers have"
        if len(fingers) == 2
        else f"the {('left', 'right')[fingers[0]]} finger has"
    )
    assert (
        sensor.told()
        == f"{who} reported {'zero' if zero else 'the same to the last bit'} for 30 ms"
    )


def test_how_far_samples_are_believed_is_a_setting() -> None:
    clock = ManualClock()
    stream = WrenchStream(clock, belief=Belief(stuck=0.1, strongest=20.0))
    for number in range(round(0.09 / PERIOD)):
        clock.advance(PERIOD)
        stream.deliver(WrenchSample(clock.now(), number, np.full((2, 6), 15.0)))
    assert stream.problem("fingers") is None
    clock.advance(PERIOD)
    stream.deliver(WrenchSample(clock.now(), 1000, np.full((2, 6), 21.0)))
    assert "the left finger reports 21 N" in str(stream.problem("fingers"))


def test_a_reason_of_the_drivers_own_is_a_fault_when_nothing_else_comes(sensor: Sensor) -> None:
    for _ in range(round(SILENCE / PERIOD) + 1):
        sensor.clock.advance(PERIOD)
        sensor.stream.leave_out("reports only spikes")
    assert sensor.told() == "reports only spikes"


def test_single_samples_that_are_left_out_are_no_fault(sensor: Sensor) -> None:
    for _ in range(200):
        sensor.run(2 * PERIOD)
        for _ in range(FEW - 1):
            sensor.clock.advance(PERIOD)
            sensor.stream.leave_out("a spike")
    assert sensor.told() == ""


def test_a_fault_stays_until_it_is_acknowledged_and_is_over(sensor: Sensor) -> None:
    sensor.run(PERIOD, with_value(0, np.nan))
    with pytest.raises(DeviceFault, match="still: the left finger reports nan"):
        sensor.stream.acknowledge("fingers")
    sensor.run(0.1)
    assert "nan" in sensor.told()
    assert (
        len(sensor.received) == 100
    )  # good samples are handed on: whoever holds a fruit needs them
    sensor.stream.acknowledge("fingers")
    assert sensor.told() == ""
    assert sensor.lost == 1


def test_a_listener_that_fails_is_a_fault_with_its_cause_and_the_others_are_served(
    sensor: Sensor,
) -> None:
    error = ArithmeticError("control law")

    def fail(_: WrenchSample) -> None:
        raise error

    sensor.stream.subscribe(fail)
    sensor.run(0.02)
    problem = sensor.stream.problem("fingers")
    assert problem is not None
    assert problem.__cause__ is error
    assert problem.message == "a listener failed: ArithmeticError('control law')"
    assert len(sensor.received) == 60
    assert sensor.lost == 1


def test_a_closed_subscription_hears_nothing(sensor: Sensor) -> None:
    received: list[WrenchSample] = []
    subscription = sensor.stream.subscribe(received.append)
    sensor.run(0.01)
    subscription.close()
    subscription.close()
    sensor.run(0.01)
    assert len(received) == 5


def test_a_stream_that_comes_and_goes_is_a_fault_though_each_gap_is_short(sensor: Sensor) -> None:
    for _ in range(3):
        sensor.clock.advance(0.03)
        sensor.run(0.02)
    assert sensor.told() == ""
    sensor.clock.advance(0.03)
    sensor.run(0.02)
    assert sensor.told() == "comes and goes: no sample in 128 of the last 240 ms"
    assert sensor.lost == 1
    sensor.run(0.1)
    sensor.stream.acknowledge("fingers")
    assert sensor.told() == ""


def test_rare_reads_make_no_gaps() -> None:
    sensor = Sensor()
    sensor.stream._listeners[0].close()
    for _ in range(20):
        sensor.clock.advance(0.03)
        sensor.stream.deliver(sensor.sample())
    assert sensor.told() == ""


def test_a_short_gap_now_and_then_is_the_computers(sensor: Sensor) -> None:
    for _ in range(20):
        sensor.clock.advance(0.03)
        sensor.run(0.12)
    assert sensor.told() == ""


# ------------------------------------------------------------------------------------------------ frames


class Eyes:
    """A camera's guard, on a clock that the test sets, with a silence of 0.5 s."""

    def __init__(self) -> None:
        self.clock = ManualClock(20.0)
        self.guard = FrameGuard(self.clock, 0.5)
        self.number = 0

    def judge(self, late: float = 0.03, step: int = 1, **pixels: bytes) -> bool:
        self.number += step
        self.clock.advance(1e-3)
        return self.guard.judge(self.clock.now() - late, self.number, **pixels)

    def told(self) -> str:
        try:
            self.guard.check("camera")
        except DeviceFault as fault:
            return fault.message
        return ""


@pytest.mark.parametrize(
    ("late", "step", "flaw"),
    [
        (0.49, 1, ""),
        (0.51, 1, "delivers frames that are 0.51 s old"),
        (-EARLY_FRAME + 1e-6, 1, ""),
        (-EARLY_FRAME - 1e-3, 1, "in the future"),
        (math.nan, 1, "stamps its frames with no time"),
        (math.inf, 1, "stamps its frames with no time"),
        (0.03, 0, "repeats its frame 1"),
        (0.03, -1, "delivers its frames out of order"),
    ],
)
def test_a_frame_is_believed_when_it_is_new_and_its_time_is_possible(
    late: float, step: int, flaw: str
) -> None:
    eyes = Eyes()
    assert eyes.judge()
    eyes.clock.advance(1.0)
    assert eyes.judge(late, step) is (flaw == "")
    assert flaw in eyes.guard._flaw
    assert bool(eyes.guard._flaw) is bool(flaw)


@pytest.mark.parametrize(("later", "believed"), [(-1e-3, False), (0.0, False), (1e-3, True)])
def test_a_frame_was_taken_after_the_one_before(later: float, believed: bool) -> None:
    eyes = Eyes()
    assert eyes.guard.judge(19.9, 1)
    eyes.clock.advance(0.1)
    assert eyes.guard.judge(19.9 + later, 2) is believed
    assert believed or eyes.guard._flaw == "delivers its frames out of order"


def test_flawed_frames_are_a_fault_when_they_are_several_for_longer_than_the_silence() -> None:
    eyes = Eyes()
    assert eyes.judge()
    eyes.clock.advance(0.6)
    for count in range(1, FEW_FRAMES + 1):
        assert eyes.told() == ""
        assert not eyes.judge(step=0), count
    assert eyes.told() == "repeats its frame 1"
    assert eyes.judge()
    assert eyes.told() == ""
    for _ in range(3 * FEW_FRAMES):
        eyes.judge(step=0)
        eyes.clock.advance(0.01)
    assert eyes.told() == ""  # 0.5 s are not over
    eyes.clock.advance(0.5)
    assert eyes.told() == "repeats its frame 2"
    eyes.guard.restart()
    assert eyes.told() == ""
    eyes.number = 0
    assert eyes.judge()  # the numbers of a camera that was started anew begin again


def test_a_repeated_picture_and_a_repeated_depth_image_are_no_new_frame() -> None:
    eyes = Eyes()
    assert eyes.judge(colour=b"ab", depth=b"\1\2")
    eyes.clock.advance(0.249)
    assert not eyes.judge(colour=b"ab", depth=b"\1\2")
    assert eyes.guard._flaw == "shows the same picture for 0.25 s, to the last bit"
    assert eyes.judge(colour=b"ac", depth=b"\3\2")
    eyes.clock.advance(0.099)
    assert not eyes.judge(colour=b"ad", depth=b"\3\2")
    assert eyes.guard._flaw == "shows the same depth image for 0.1 s, to the last bit"
    assert eyes.judge(colour=b"ae", depth=b"\3\3")
    assert eyes.judge(colour=b"af", depth=b"\0\0")  # nothing was measured
    assert eyes.judge(colour=b"ag", depth=b"\0\0")
    assert eyes.judge()
    assert eyes.judge()  # without pixels there is nothing to compare
    assert eyes.judge(colour=b"ag", depth=b"\0\0")
