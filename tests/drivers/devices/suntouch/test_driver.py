"""The fingers' driver against emulated fingers on a clock that the test moves, and once on real pseudo terminals."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from pomona.devices.emulators.server import PtyPort, Server
from pomona.devices.emulators.suntouch import SunTouchEmulator
from pomona.devices.suntouch.calibration import FingerCalibration
from pomona.devices.suntouch.driver import RECONNECT, NoBias, SunTouchFingers
from pomona.devices.suntouch.finger import Finger
from pomona.drivers.errors import DeviceFault, DeviceLost
from pomona.drivers.hold_watch import HandMemory, HandRecord
from pomona.drivers.interfaces import Gripper, WrenchSample
from pomona.drivers.serial_link import SerialLink
from pomona.drivers.streams import Belief
from pomona.executive.clock import ManualClock, SystemClock
from pomona.tools.mock import MockClock, MockGripper

CALIBRATION = FingerCalibration(
    "test",
    np.zeros(25),
    np.ones((1, 25)),
    np.array([-1.0]),
    np.array([1.0]),
    ((np.array([[0.0], [0.0], [-1.0], [0.0], [0.0], [0.0]]), np.zeros(6)),),
    -np.ones(6),
    np.ones(6),
    0.0,
)
"""Gives minus the sum of the voltages as normal force."""


class Line:
    """A finger at the end of a line; an answer takes half a millisecond."""

    def __init__(self, clock: ManualClock, seed: int) -> None:
        self.wrench = np.zeros(6)
        self.device = SunTouchEmulator(lambda: self.wrench, seed)
        self.clock, self.cut, self.opened = clock, False, 0
        self._arrived = bytearray()

    def open(self) -> Line:
        if self.cut:
            raise FileNotFoundError("no such port")
        self.opened += 1
        self._arrived.clear()
        return self

    class _Peer:
        def __init__(self, line: Line) -> None:
            self.line = line

        def send(self, chunk: bytes) -> None:
            self.line._arrived += chunk

    def send(self, chunk: bytes) -> None:
        if self.cut:
            raise BrokenPipeError("cut")
        self.device.received(self._Peer(self), chunk)

    def receive(self, timeout: float) -> bytes:
        if not self._arrived:
            self.clock.advance(timeout)
            return b""
        self.clock.advance(0.0005)
        chunk = bytes(self._arrived)
        self._arrived.clear()
        return chunk

    def close(self) -> None:
        pass


class Rig:
    def __init__(self) -> None:
        self.clock = ManualClock(10.0)
        self.left, self.right = Line(self.clock, 0), Line(self.clock, 1)
        self.stopped = 0
        self.belief = Belief()
        self.fingers = self.make()
        self.samples: list[WrenchSample] = []

    def make(
        self, gripper: Gripper | None = None, memory: HandMemory | None = None
    ) -> SunTouchFingers:
        """The driver of the next process, on the same fingers."""
        calibrations = (
            CALIBRATION,
            replace(CALIBRATION, finger="other", error_n=0.1, mean=np.full(25, 1e-6)),
        )
        left, right = (
            Finger(line.open, calibration, self.clock)
            for line, calibration in zip((self.left, self.right), calibrations, strict=True)
        )
        return SunTouchFingers(
            left,
            right,
            self.clock,
            on_lost=self.stop,
            belief=self.belief,
            gripper=gripper,
            memory=memory,
        )

    def stop(self) -> None:
        self.stopped += 1

    def run(self, seconds: float) -> None:
        end = self.clock.now() + seconds
        while self.clock.now() < end:
            self.fingers.step()


@pytest.fixture
def rig() -> Rig:
    rig = Rig()
    rig.fingers.connect()
    rig.fingers.subscribe(rig.samples.append)
    return rig


def test_samples_come_500_times_a_second_in_order_and_without_gaps(rig: Rig) -> None:
    rig.run(1.0)
    assert len(rig.samples) == pytest.approx(500, abs=2)
    assert np.all(np.diff([sample.sequence for sample in rig.samples]) == 1)
    assert np.diff([sample.stamp for sample in rig.samples]) == pytest.approx(0.002, abs=1e-9)
    assert rig.fingers.latest() is rig.samples[-1]


def test_the_bias_is_taken_at_the_connection_and_a_press_is_felt_on_its_finger(rig: Rig) -> None:
    rig.run(0.05)
    assert rig.samples[-1].wrenches == pytest.approx(0.0, abs=0.02)
    rig.right.wrench = np.array([0.0, 0.0, -0.2, 0.0, 0.0, 0.0])
    rig.run(0.05)
    assert rig.samples[-1].wrenches[0] == pytest.approx(0.0, abs=0.02)
    assert rig.samples[-1].wrenches[1, 2] < -0.1


def test_a_new_bias_can_be_taken_while_streaming(rig: Rig) -> None:
    rig.right.wrench = np.array([0.0, 0.0, -0.2, 0.0, 0.0, 0.0])
    rig.fingers.bias()
    assert not rig.fingers.biased
    rig.run(0.3)
    assert rig.fingers.biased
    assert rig.samples[-1].wrenches == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("lost", [1, 25, 49, 50])
def test_lost_bytes_cost_one_sample_and_shift_nothing(rig: Rig, lost: int) -> None:
    rig.run(0.02)
    rig.left.device.drop_bytes = lost
    rig.run(0.1)
    assert all(np.abs(sample.wrenches).max() < 0.02 for sample in rig.samples)
    gaps = np.diff([sample.sequence for sample in rig.samples])
    assert 1 < gaps.max() <= 4
    assert (gaps > 1).sum() == 1


def test_bytes_too_many_are_thrown_away(rig: Rig) -> None:
    rig.run(0.02)
    rig.left._arrived += b"\x01\x02\x03"
    rig.run(0.1)
    assert all(np.abs(sample.wrenches).max() < 0.02 for sample in rig.samples)
    assert rig.fingers.fingers[0].resynchronised == 1


def test_a_thread_that_oversleeps_a_moment_catches_up(rig: Rig) -> None:
    rig.run(0.02)
    rig.clock.advance(0.0045)
    rig.run(0.1)
    assert np.all(np.diff([sample.sequence for sample in rig.samples]) == 1)
    assert rig.fingers.lost_samples == 0
    stamps = [sample.stamp for sample in rig.samples]
    assert np.all(np.diff(stamps) > 0.0)
    assert np.diff(stamps)[-20:] == pytest.approx(0.002, abs=1e-9)


def test_a_thread_that_oversleeps_for_longer_leaves_a_gap_in_the_sequence(rig: Rig) -> None:
    rig.run(0.02)
    rig.clock.advance(0.0205)
    rig.run(0.1)
    sequence = [sample.sequence for sample in rig.samples]
    assert max(np.diff(sequence)) == pytest.approx(10, abs=1)
    assert rig.fingers.lost_samples == max(np.diff(sequence)) - 1


def test_a_spike_is_left_out(rig: Rig) -> None:
    rig.run(0.02)
    rig.left.device.spike = 0.3
    rig.run(0.02)
    assert all(np.abs(sample.wrenches).max() < 0.02 for sample in rig.samples)
    assert rig.fingers.fingers[0].spikes.rejected == 1
    assert rig.fingers.lost_samples == 1


def test_a_pulled_cable_is_seen_within_50_ms_and_stops_the_gripper(rig: Rig) -> None:
    rig.run(0.1)
    rig.right.device.silent = True
    pulled = rig.clock.now()
    while rig.fingers.link() == "ok":
        rig.fingers.step()
    assert rig.clock.now() - pulled <= 0.050
    assert rig.stopped == 1
    with pytest.raises(DeviceLost, match="no sample for"):
        rig.fingers.check()
    with pytest.raises(DeviceLost, match="still lost"):
        rig.fingers.acknowledge()


def test_a_lost_line_is_opened_again_keeps_its_bias_and_stays_latched(rig: Rig) -> None:
    bias = rig.fingers.fingers[0].bias.copy()
    rig.left.cut = True
    rig.run(0.1)
    rig.left.cut = False
    rig.left.wrench = np.array([0.0, 0.0, -3.0, 0.0, 0.0, 0.0])  # the fruit is still held
    rig.run(RECONNECT + 0.3)
    assert rig.left.opened == 2
    assert np.array_equal(rig.fingers.fingers[0].bias, bias)
    with pytest.raises(DeviceLost):
        rig.fingers.check()
    rig.fingers.acknowledge()
    rig.fingers.check()
    assert rig.samples[-1].wrenches[0, 2] < -0.5


def test_a_listener_that_fails_stops_the_gripper_and_is_reported(rig: Rig) -> None:
    def fail(sample: WrenchSample) -> None:
        raise ArithmeticError("control law")

    rig.fingers.subscribe(fail)
    rig.run(0.01)
    assert rig.stopped == 1
    with pytest.raises(DeviceFault, match="control law"):
        rig.fingers.check()
    assert len(rig.samples) >= 3  # the others are still served


def test_a_closed_subscription_gets_no_more_samples(rig: Rig) -> None:
    samples: list[WrenchSample] = []
    subscription = rig.fingers.subscribe(samples.append)
    rig.run(0.01)
    subscription.close()
    subscription.close()
    count = len(samples)
    rig.run(0.01)
    assert len(samples) == count > 0


def test_a_finger_that_never_answers_is_reported_by_its_side() -> None:
    rig = Rig()
    rig.right.device.silent = True
    with pytest.raises(DeviceLost, match="the right finger: fingers: no reading within 1 s"):
        rig.fingers.connect()


@pytest.fixture
def terminals() -> Iterator[tuple[str, str]]:
    devices = [SunTouchEmulator(lambda: np.zeros(6), seed) for seed in (0, 1)]
    ports = [PtyPort(device) for device in devices]
    done = threading.Event()
    server = Server(ports, devices, time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    yield ports[0].address, ports[1].address
    done.set()
    thread.join(2.0)


@pytest.mark.realtime
def test_it_streams_over_real_pseudo_terminals(terminals: tuple[str, str]) -> None:
    clock = SystemClock()
    left, right = (
        Finger(lambda port=port: SerialLink(port, 1_000_000), CALIBRATION, clock)
        for port in terminals
    )
    fingers = SunTouchFingers(left, right, clock, rate=100.0)  # slow: other tests share the machine
    fingers.connect()
    enough, samples = threading.Event(), []

    def listen(sample: WrenchSample) -> None:
        samples.append(sample)
        if len(samples) == 20:
            enough.set()

    fingers.subscribe(listen)
    fingers.start()
    assert enough.wait(5.0)
    fingers.close()
    assert all(np.abs(sample.wrenches).max() < 0.05 for sample in samples)
    with pytest.raises(DeviceLost, match="closed"):
        fingers.check()


# ------------------------------------------------------------------------------------------- fingers that lie


def told(rig: Rig, limit: float = 0.05) -> str:
    """Return the problem within a time [s]."""
    end = rig.clock.now() + limit
    while rig.fingers.link() == "ok" and rig.clock.now() < end:
        rig.fingers.step()
    with pytest.raises(DeviceFault) as caught:
        rig.fingers.check()
    assert rig.stopped == 1
    return caught.value.message


def test_a_finger_whose_every_sample_is_a_spike_is_a_fault_within_50_ms(rig: Rig) -> None:
    rig.run(0.1)
    rig.left.device.restless = 0.2
    assert (
        told(rig)
        == "the left finger reports only spikes: a taxel jumps by more than 0.05 V each time"
    )


def test_a_stuck_finger_is_a_fault_within_50_ms(rig: Rig) -> None:
    rig.run(0.1)
    rig.right.device.stuck = True
    assert told(rig) == "the right finger has reported the same to the last bit for 30 ms"


def test_a_finger_at_zero_volt_is_a_fault_within_50_ms_and_gives_no_force(rig: Rig) -> None:
    rig.run(0.1)
    rig.right.device.dead = True
    assert told(rig) == "the right finger has every taxel at the end of its range"
    assert all(np.abs(sample.wrenches).max() < 0.02 for sample in rig.samples)


@pytest.mark.parametrize("value", [np.nan, 1e30])
def test_a_calibration_that_gives_no_force_is_a_fault_at_once(rig: Rig, value: float) -> None:
    rig.run(0.1)
    rig.fingers.fingers[1].calibration = replace(
        CALIBRATION, out_low=np.full(6, value), out_high=np.full(6, value)
    )
    assert told(rig, 0.005).startswith(
        f"the right finger reports {'nan instead of a force' if np.isnan(value) else '1e+30 N'}"
    )


def test_a_fault_of_the_fingers_is_over_when_they_can_be_believed_and_somebody_acknowledges(
    rig: Rig,
) -> None:
    rig.left.device.stuck = True
    rig.run(0.1)
    with pytest.raises(DeviceFault, match="still: the left finger"):
        rig.fingers.acknowledge()
    rig.left.device.stuck = False
    rig.run(0.1)
    with pytest.raises(DeviceFault):
        rig.fingers.check()
    rig.fingers.acknowledge()
    rig.fingers.check()


# ------------------------------------------------------------------------------- a bias, or the last one


def held(force: float = 1.4) -> np.ndarray:
    return np.array([0.0, 0.0, -force, 0.0, 0.0, 0.0])


def pressing(fingers: SunTouchFingers) -> float:
    for _ in range(20):
        fingers.step()
    sample = fingers.latest()
    assert sample is not None
    return float((-sample.wrenches[:, 2]).min())


class Hand:
    """A rig with a gripper, and the state kept from one process to the next."""

    def __init__(self, width: float, record: HandRecord | None = None) -> None:
        self.rig, self.memory = Rig(), HandMemory(None, record)
        self.gripper = MockGripper(MockClock(), width)

    def press(self, force: float) -> None:
        self.rig.left.wrench = self.rig.right.wrench = held(force)

    def connect(self) -> SunTouchFingers:
        fingers = self.rig.make(self.gripper, self.memory)
        fingers.connect()
        return fingers


@pytest.mark.parametrize("force", [1.4, 5.0, 9.0])
def test_a_fruit_that_is_held_while_the_fingers_connect_is_felt_and_not_tared_away(
    force: float,
) -> None:
    hand = Hand(0.103)
    hand.connect()
    hand.memory.keep_hand("something is between the fingers", 0.073)
    hand.gripper.width = 0.073
    hand.press(force)
    assert pressing(hand.connect()) > 0.5
    record = hand.memory.record
    assert record is not None
    assert record.held  # it still may be there for the connection after this one


def test_fingers_that_moved_since_they_were_last_known_are_not_tared() -> None:
    hand = Hand(0.103)
    hand.connect()  # killed while the fingers close: the record says empty at 103 mm
    hand.gripper.width = 0.073
    hand.press(1.4)
    assert pressing(hand.connect()) > 0.5


def test_fingers_that_press_by_the_last_bias_are_not_tared_although_the_record_calls_them_empty() -> (
    None
):
    hand = Hand(0.103)
    hand.connect()
    hand.memory.keep_hand("", 0.073)
    hand.gripper.width = 0.073
    hand.press(1.4)
    assert pressing(hand.connect()) > 0.5


@pytest.mark.parametrize("width", [0.035, 0.103])
def test_fingers_at_an_end_of_their_travel_are_tared_and_so_are_those_known_to_be_empty(
    width: float,
) -> None:
    hand = Hand(width)
    hand.press(0.3)  # a sensor that has drifted
    assert pressing(hand.connect()) == pytest.approx(0.0, abs=0.05)
    hand.memory.keep_hand("", 0.08)
    hand.gripper.width = 0.08
    hand.press(0.4)
    assert pressing(hand.connect()) == pytest.approx(0.0, abs=0.05)
    assert hand.memory.record == HandRecord(
        "", 0.08, hand.memory.record.bias if hand.memory.record else {}
    )


@pytest.mark.parametrize("record", [None, HandRecord("", 0.09), HandRecord("something", 0.073)])
def test_fingers_without_a_known_bias_that_may_hold_something_are_refused_with_the_remedy(
    record: HandRecord | None,
) -> None:
    hand = Hand(0.073, record)
    with pytest.raises(
        NoBias, match=r"fingers: no bias can be taken.*stand at 73\.0 mm.*open the gripper fully"
    ) as refused:
        hand.connect()
    assert refused.value.held.startswith("the fingers stand at 73.0 mm")
    assert hand.memory.record == record


def test_a_last_bias_that_does_not_fit_the_fingers_any_more_is_used_for_nothing() -> None:
    hand = Hand(0.103)
    hand.connect()
    hand.memory.keep_hand("", 0.073)
    hand.gripper.width = 0.073
    for line in (hand.rig.left, hand.rig.right):
        line.device.pad.rest = line.device.pad.rest + 1.0  # another skin: 25 V more in sum
    hand.rig.belief = Belief(strongest=5.0)
    with pytest.raises(
        NoBias, match="each finger presses with inf N or more, measured from the last bias"
    ):
        hand.connect()
    hand.gripper.width = 0.103
    assert pressing(hand.connect()) == pytest.approx(0.0, abs=0.05)


def test_a_bias_asked_for_while_something_may_be_held_is_refused(rig: Rig) -> None:
    hand = Hand(0.103)
    fingers = hand.connect()
    hand.gripper.width = 0.08
    with pytest.raises(NoBias):
        fingers.bias()
    hand.gripper.width = 0.103
    fingers.bias()
    assert not fingers.biased


def test_a_finger_that_is_dead_while_it_connects_is_a_fault_and_no_endless_wait() -> None:
    rig = Rig()
    rig.left.device.dead = True
    with pytest.raises(
        DeviceFault, match="the left finger has every taxel at the end of its range"
    ):
        rig.fingers.connect()
