"""The gripper's driver against the emulated gripper, byte for byte, on a clock that the test moves."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from py_trees.common import Status

from pomona.devices.emulators.free_gripper import FreeGripper
from pomona.devices.emulators.wsg import WsgEmulator
from pomona.devices.wsg.codec import Command, Plain, Script, SystemState, encode
from pomona.devices.wsg.connect import connect
from pomona.devices.wsg.driver import WsgGripper
from pomona.devices.wsg.handshake import WsgOptions
from pomona.drivers.base.parallel_gripper import RECONNECT
from pomona.drivers.errors import DeviceFault, DeviceLost, MotionRefused, StopFailed
from pomona.drivers.interfaces import Gripper, GripperState, MotionState
from pomona.drivers.services import ConnectContext
from pomona.executive.cell.owner import Nonsense
from pomona.executive.clock import ManualClock
from pomona.executive.skill_testing import drive
from pomona.skills.grasp import Grasp
from tests.drivers.conformance.grippers import wsg
from tests.drivers.device_settings import read_settings

OFFSET = 0.035


class Wire:
    """Both ends of a wire; time passes only during reads."""

    def __init__(self) -> None:
        self.clock = ManualClock(100.0)
        self.fingers = FreeGripper(self.clock.now)
        self.device = WsgEmulator(self.fingers)
        self.cut = False
        self.opened = 0
        self.sent: list[bytes] = []
        self.noise = b""
        self._arrived = bytearray()

    def open(self) -> Wire:
        if self.cut:
            raise ConnectionRefusedError("nobody answers")
        self.opened += 1
        self._arrived.clear()
        self.device.connected(self._Peer(self))
        return self

    class _Peer:
        def __init__(self, wire: Wire) -> None:
            self.wire = wire

        def send(self, chunk: bytes) -> None:
            self.wire._arrived += chunk

    def send(self, chunk: bytes) -> None:
        if self.cut:
            raise BrokenPipeError("cut")
        self.sent.append(chunk)
        self.device.received(self.device._peer, chunk)  # type: ignore[arg-type]

    def receive(self, timeout: float) -> bytes:
        end = self.clock.now() + timeout
        while True:
            self.device.advance(self.clock.now())
            if self._arrived or self.noise:
                chunk, self.noise = self.noise + bytes(self._arrived), b""
                self._arrived.clear()
                return b"" if self.cut else chunk
            if self.clock.now() >= end:
                return b""
            self.clock.advance(0.001)

    def close(self) -> None:
        self.device._peer = None


@pytest.fixture
def wire() -> Wire:
    return Wire()


def connected(wire: Wire, **options: Any) -> WsgGripper:
    gripper = WsgGripper(wire.open, wire.clock, WsgOptions(finger_offset=OFFSET, **options))  # type: ignore[arg-type]
    gripper.connect()
    return gripper


def serve(gripper: WsgGripper, wire: Wire, seconds: float, renew: float | None = None) -> None:
    end = wire.clock.now() + seconds
    while wire.clock.now() < end:
        if renew is not None:
            gripper.set_speed(renew)
        before = wire.clock.now()
        gripper.step()
        if wire.clock.now() == before:
            wire.clock.advance(0.001)


def test_the_handshake_sets_and_reads_back_the_options(wire: Wire) -> None:
    gripper = connected(
        wire, acceleration=1.5, force_limit=20.0, soft_limits=(0.040, 0.100), speed_max=0.2
    )
    assert gripper.identity is not None
    assert (gripper.identity.acceleration, gripper.identity.force_limit) == (1.5, 20.0)
    assert gripper.identity.firmware == 0x2710
    assert (gripper.limits.width_min, gripper.limits.width_max, gripper.limits.speed_max) == (
        0.040,
        0.100,
        0.2,
    )
    assert gripper.link() == "ok"
    assert gripper.state().width == pytest.approx(0.065)


def test_a_move_arrives_and_the_width_is_the_opening_between_the_pads(wire: Wire) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.080, 0.1)
    serve(gripper, wire, 0.05)
    assert motion.state is MotionState.RUNNING
    assert 0.0 < motion.progress < 1.0
    assert not gripper.settled()
    serve(gripper, wire, 0.3)
    assert (motion.state, motion.settled, motion.progress) == (MotionState.DONE, True, 1.0)
    assert gripper.state().width == pytest.approx(0.080, abs=1e-6)
    assert wire.fingers.state().width == pytest.approx(0.045, abs=1e-6)


def test_a_stopped_move_stands_where_it_was_stopped(wire: Wire) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.1)
    motion.stop()
    serve(gripper, wire, 0.1)
    assert (motion.state, motion.settled) == (MotionState.STOPPED, True)
    assert 0.068 < gripper.state().width < 0.072


def test_a_second_move_ends_the_first(wire: Wire) -> None:
    gripper = connected(wire)
    first = gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.1)
    second = gripper.move(0.040, 0.2)
    serve(gripper, wire, 0.5)
    assert (first.state, second.state) == (MotionState.STOPPED, MotionState.DONE)
    assert gripper.state().width == pytest.approx(0.040, abs=1e-6)


def test_a_move_is_not_judged_by_an_earlier_one_while_a_stop_is_unanswered(wire: Wire) -> None:
    gripper = connected(wire)
    gripper.move(0.080, 0.2)
    serve(gripper, wire, 0.5)
    serve(gripper, wire, 0.1, renew=-0.01)
    wire.device.deaf.add(Command.STOP)
    motion = gripper.move(0.100, 0.2)
    serve(gripper, wire, 0.01)
    assert motion.state is MotionState.RUNNING
    wire.device.deaf.clear()
    wire.device._reply(Command.STOP)
    serve(gripper, wire, 0.5)
    assert motion.state is MotionState.DONE
    assert gripper.state().width == pytest.approx(0.100, abs=1e-6)


def test_a_blocked_move_fails_with_its_place(wire: Wire) -> None:
    gripper = connected(wire)
    wire.fingers.obstacle = 0.020
    motion = gripper.move(0.040, 0.1)
    serve(gripper, wire, 0.3)
    assert motion.state is MotionState.FAILED
    blocked = re.fullmatch(r"the fingers are blocked at (5[56]\.\d) mm", motion.problem)
    assert blocked is not None  # one update old


@pytest.mark.parametrize(
    ("width", "speed"), [(0.02, 0.1), (0.2, 0.1), (0.05, 0.0), (0.05, 0.5), (float("nan"), 0.1)]
)
def test_a_move_outside_the_limits_is_refused_and_nothing_is_sent(
    wire: Wire, width: float, speed: float
) -> None:
    gripper = connected(wire)
    before = len(wire.sent)
    with pytest.raises(MotionRefused, match="lies outside"):
        gripper.move(width, speed)
    assert len(wire.sent) == before


def test_a_streamed_speed_moves_the_fingers_while_it_is_renewed(wire: Wire) -> None:
    gripper = connected(wire)
    serve(gripper, wire, 0.5, renew=-0.010)
    assert gripper.state().width == pytest.approx(0.060, abs=3e-4)
    assert gripper.state().speed == pytest.approx(-0.010)
    assert gripper.settled()  # force control is no motion


def test_set_points_are_not_sent_faster_than_the_finger_script_takes_them(wire: Wire) -> None:
    gripper = connected(wire)
    wire.sent.clear()
    serve(gripper, wire, 1.0, renew=-0.001)
    assert 40 <= len(wire.sent) <= 56


def test_a_speed_that_is_not_renewed_becomes_zero_after_the_watchdog(wire: Wire) -> None:
    gripper = connected(wire)
    gripper.set_speed(-0.010)
    serve(gripper, wire, 0.5)
    assert wire.fingers.state().speed == 0.0
    assert 0.0639 - 3e-4 < gripper.state().width < 0.0641 + 3e-4


class SteppedClock:
    """The driver's clock, which a test sets back."""

    simulated = True

    def __init__(self, clock: ManualClock) -> None:
        self.clock, self.back = clock, 0.0

    def now(self) -> float:
        return self.clock.now() - self.back

    def advance(self, duration: float) -> None:
        self.clock.advance(duration)


def test_a_clock_that_steps_back_does_not_keep_a_streamed_speed(wire: Wire) -> None:
    clock = SteppedClock(wire.clock)
    gripper = WsgGripper(wire.open, clock, WsgOptions(finger_offset=OFFSET))  # type: ignore[arg-type]
    gripper.connect()
    serve(gripper, wire, 0.05, renew=-0.01)
    clock.back = 5.0
    began, zero = len(wire.sent), encode(Script(Command.SCRIPT_SPEED, 0.0, 0.0))
    serve(gripper, wire, 0.09)
    assert zero not in wire.sent[began:]
    serve(gripper, wire, 0.05)
    assert zero in wire.sent[began:]
    assert wire.fingers.state().speed == 0.0


def test_a_speed_ends_a_move(wire: Wire) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.1)
    gripper.set_speed(-0.01)
    serve(gripper, wire, 0.05, renew=-0.01)
    assert motion.state is MotionState.STOPPED
    assert wire.fingers.state().speed == pytest.approx(-0.01)


def test_without_the_finger_script_streaming_is_refused_in_words(wire: Wire) -> None:
    wire.device.has_script = False
    gripper = connected(wire)
    with pytest.raises(DeviceFault, match=r"load drivers/pomona/devices/wsg/velocity\.lua"):
        gripper.set_speed(-0.01)


def test_without_a_reference_moves_are_refused_until_homing_was_allowed(wire: Wire) -> None:
    wire.device.referenced = False
    with pytest.raises(MotionRefused, match="no reference"):
        connected(wire).move(0.05, 0.1)
    homed = connected(wire, home=True)
    motion = homed.move(0.05, 0.2)
    serve(homed, wire, 1.0)
    assert motion.state is MotionState.DONE


@pytest.mark.parametrize("cleared", [False, True])
def test_a_gripper_without_a_reference_moves_at_the_connection_only_when_an_operator_has_looked(
    wire: Wire, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cleared: bool
) -> None:
    wire.device.referenced = False
    monkeypatch.setattr(WsgGripper, "start", lambda _gripper: None)
    (tmp_path / "gripper.yaml").write_text("driver: wsg\ntcp: gripper\nhome: true\n")
    context = ConnectContext(
        tmp_path, wire.clock, 0, wires={"gripper:1000": wire.open}, cleared=cleared
    )
    before = wire.fingers.state().width
    gripper = connect(read_settings(connect, tmp_path / "gripper.yaml"), context)
    assert isinstance(gripper, WsgGripper)
    serve(gripper, wire, 0.1)
    assert gripper.state().referenced is cleared
    assert (wire.fingers.state().width != before) is cleared
    if not cleared:
        with pytest.raises(
            MotionRefused, match="check that it holds nothing, then start with --cleared"
        ):
            gripper.move(0.05, 0.1)


def test_a_pulled_cable_is_seen_within_50_ms_and_the_move_fails(wire: Wire) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.1)
    wire.device.silent = True
    pulled = wire.clock.now()
    while gripper.link() == "ok":
        gripper.step()
    assert wire.clock.now() - pulled <= 0.050
    assert motion.state is MotionState.FAILED
    assert "no answer for" in motion.problem
    for call in (gripper.state, gripper.check, lambda: gripper.set_speed(0.0), gripper.acknowledge):
        with pytest.raises(DeviceLost):
            call()
    with pytest.raises(MotionRefused, match="not ready"):
        gripper.move(0.05, 0.1)


def test_a_reconnection_repeats_the_handshake_and_resumes_nothing(wire: Wire) -> None:
    gripper = connected(wire, acceleration=1.5)
    first_handshake = list(wire.sent)
    motion = gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.1)
    wire.cut = True
    serve(gripper, wire, 0.2)
    wire.device.disconnected(wire.device._peer)  # type: ignore[arg-type]  # without a goodbye: the gripper makes a fast stop
    stood = wire.fingers.state().width
    wire.cut, wire.sent = False, []
    serve(gripper, wire, RECONNECT + 0.3)
    assert wire.opened == 2
    assert wire.sent == first_handshake
    assert motion.state is MotionState.FAILED
    assert wire.fingers.state().width == pytest.approx(stood)
    with pytest.raises(DeviceLost):
        gripper.check()  # stays latched …
    with pytest.raises(MotionRefused):
        gripper.move(0.05, 0.1)
    gripper.acknowledge()  # … until somebody acknowledges
    serve(gripper, wire, 0.1)
    gripper.check()
    again = gripper.move(0.05, 0.1)
    serve(gripper, wire, 0.5)
    assert again.state is MotionState.DONE


def test_a_fast_stop_is_latched_until_it_is_acknowledged(wire: Wire) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.1)
    wire.device.fast_stop()
    serve(gripper, wire, 0.03)
    assert motion.state is MotionState.FAILED
    with pytest.raises(DeviceFault, match="fast stop"):
        gripper.check()
    with pytest.raises(MotionRefused):
        gripper.move(0.05, 0.1)
    gripper.acknowledge()
    assert encode(Plain(Command.ACKNOWLEDGE)) in wire.sent
    serve(gripper, wire, 0.5)
    gripper.check()


def test_a_safe_stop_keeps_the_grip_refuses_opening_and_allows_closing(wire: Wire) -> None:
    gripper = connected(wire)
    serve(gripper, wire, 0.1, renew=0.02)
    gripper.safe_stop("test")
    serve(gripper, wire, 0.1, renew=0.02)
    assert wire.fingers.state().speed == 0.0
    serve(gripper, wire, 0.1, renew=-0.01)
    assert wire.fingers.state().speed == pytest.approx(-0.01)
    with pytest.raises(MotionRefused, match="latched in the safe state"):
        gripper.move(0.05, 0.1)
    gripper.acknowledge()
    gripper.move(0.05, 0.1)


def test_a_paused_move_goes_on_to_the_same_width(wire: Wire) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.1)
    gripper.pause()
    serve(gripper, wire, 0.2)
    stood = wire.fingers.state().width
    assert motion.state is MotionState.PAUSED
    assert gripper.settled()
    serve(gripper, wire, 0.2)
    assert wire.fingers.state().width == stood
    gripper.resume()
    serve(gripper, wire, 1.0)
    assert motion.state is MotionState.DONE
    assert gripper.state().width == pytest.approx(0.100, abs=1e-6)


def test_noise_on_the_wire_is_survived(wire: Wire) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.080, 0.1)
    for _ in range(30):
        wire.noise = b"\xaa\xaa\xaa\x21\x30\x00noise"
        serve(gripper, wire, 0.01)
    assert motion.state is MotionState.DONE
    gripper.check()


def test_a_frame_that_the_protocol_does_not_know_is_nonsense_with_its_bytes(wire: Wire) -> None:
    from pomona.devices.wsg.frame import WireFrame, encode_frame

    gripper = connected(wire)
    wire.noise = encode_frame(WireFrame(0x99, b"\x00\x00"))
    serve(gripper, wire, 0.005)
    with pytest.raises(Nonsense, match="0x99") as caught:
        gripper.check()
    assert caught.value.received == encode_frame(WireFrame(0x99, b"\x00\x00"))


def test_closing_sends_bye_so_that_the_gripper_makes_no_fast_stop(wire: Wire) -> None:
    gripper = connected(wire)
    gripper.close()
    assert wire.sent[-1] == encode(Plain(Command.DISCONNECT))


# ------------------------------------------------------------------------------------------------- when it goes wrong


def serve_until(
    gripper: WsgGripper, wire: Wire, done: Callable[[], bool], limit: float = 5.0
) -> float:
    """Seconds until it is so."""
    began = wire.clock.now()
    while not done():
        assert wire.clock.now() - began < limit
        serve(gripper, wire, 0.001)
    return wire.clock.now() - began


STOP = encode(Plain(Command.STOP))
FAULT_BITS = (
    SystemState.FAST_STOP,
    SystemState.TEMPERATURE,
    SystemState.POWER,
    SystemState.CURRENT,
    SystemState.FINGER_FAULT,
    SystemState.SCRIPT_FAILURE,
)


@pytest.mark.parametrize("bit", FAULT_BITS)
@pytest.mark.parametrize("moving", ["by a move", "by a stream", "not at all"])
def test_a_safe_stop_stops_a_gripper_that_reports_a_fault(
    wire: Wire, bit: SystemState, moving: str
) -> None:
    gripper = connected(wire)
    if moving == "by a move":
        gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.2, renew=0.02 if moving == "by a stream" else None)
    wire.device.faults = bit
    wire.sent.clear()
    serve(gripper, wire, 0.02)
    with pytest.raises(DeviceFault):
        gripper.check()
    gripper.safe_stop("fault")
    serve_until(gripper, wire, gripper.settled, 0.3)
    assert STOP in wire.sent
    stood = wire.fingers.state().width
    serve(gripper, wire, 0.5)
    assert wire.fingers.state() == GripperState(wire.clock.now(), stood, 0.0, False)


def test_a_move_that_fails_by_a_fault_is_stopped_before_anybody_asks(wire: Wire) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.2)
    wire.device.faults = SystemState.CURRENT
    serve(gripper, wire, 0.03)
    assert (motion.state, motion.problem) == (MotionState.FAILED, "gripper: draws too much current")
    assert wire.fingers.state().speed == 0.0


@pytest.mark.parametrize("speed", [0.05, -0.03])
def test_fingers_that_move_are_never_called_settled(wire: Wire, speed: float) -> None:
    gripper = connected(wire)
    serve(gripper, wire, 0.5)
    assert gripper.settled()
    wire.device.runaway, wire.device.refusing = speed, {Command.STOP, Command.FAST_STOP}
    serve(gripper, wire, 0.05)
    gripper.safe_stop("test")
    while 0.001 < wire.fingers.state().width < 0.067:
        assert not gripper.settled()
        serve(gripper, wire, 0.005)


def test_fingers_that_move_without_a_command_are_reported_within_100_ms_and_stopped(
    wire: Wire,
) -> None:
    gripper = connected(wire)
    serve(gripper, wire, 0.5)
    wire.device.runaway = 0.05
    assert serve_until(gripper, wire, lambda: gripper.link() != "ok") <= 0.1
    with pytest.raises(DeviceFault, match=r"opens without a command: 65\.\d → 68\.\d mm"):
        gripper.check()
    serve_until(
        gripper, wire, lambda: wire.device.runaway == 0.0, 0.3
    )  # no stop helped: a fast stop did
    assert isinstance(gripper._problem, StopFailed)
    serve_until(gripper, wire, gripper.settled, 0.3)


def test_fingers_that_open_on_a_closing_command_are_reported(wire: Wire) -> None:
    gripper = connected(wire)
    serve(gripper, wire, 0.5, renew=-0.01)
    wire.device.runaway = 0.04
    serve(gripper, wire, 0.15, renew=-0.01)
    assert "opens without a command" in gripper.link()
    assert not gripper.settled()


@pytest.mark.parametrize("command", [Command.STOP, Command.FAST_STOP])
def test_a_refused_stop_is_reported_as_such(wire: Wire, command: Command) -> None:
    gripper = connected(wire)
    gripper.move(0.100, 0.02)
    serve(gripper, wire, 0.2)
    wire.device.refusing = {Command.STOP, command}
    gripper.safe_stop("test")
    serve(gripper, wire, 0.05)
    with pytest.raises(StopFailed, match=f"refused {command.name}: ACCESS_DENIED"):
        gripper.check()
    assert gripper.settled() is (command is Command.STOP)  # the fast stop worked, or it did not


def test_problems_before_a_failed_stop_are_reported_too(wire: Wire) -> None:
    gripper = connected(wire)
    gripper.move(0.100, 0.02)
    serve(gripper, wire, 0.2)
    wire.device.faults, wire.device.refusing = SystemState.TEMPERATURE, {Command.STOP}
    serve(gripper, wire, 0.05)
    with pytest.raises(StopFailed, match="refused STOP: ACCESS_DENIED; before that it is too hot"):
        gripper.check()


def test_a_stop_that_is_not_answered_is_a_lost_gripper_that_is_not_settled(wire: Wire) -> None:
    gripper = connected(wire)
    gripper.move(0.100, 0.02)
    serve(gripper, wire, 0.2)
    wire.device.deaf = {Command.STOP}
    gripper.safe_stop("test")
    serve(gripper, wire, 0.25)
    with pytest.raises(DeviceLost, match="STOP was not answered within 100 ms"):
        gripper.check()
    while wire.fingers.state().speed > 0.0:
        assert not gripper.settled()
        serve(gripper, wire, 0.02)


def test_an_unanswered_stop_is_reported_although_updates_come_all_the_time(wire: Wire) -> None:
    gripper = connected(wire, period=0.001)
    wire.device.deaf = {Command.STOP}
    gripper.safe_stop("test")
    serve(gripper, wire, 0.25)
    with pytest.raises(DeviceLost, match="STOP was not answered"):
        gripper.check()


def test_a_move_that_never_ends_is_reported_at_its_deadline(wire: Wire) -> None:
    gripper = connected(wire)
    wire.device.busy = True
    motion = gripper.move(0.075, 0.1)  # 0.1 s of way, 0.05 s of braking
    took = serve_until(gripper, wire, lambda: motion.ended)
    assert 0.15 < took < 0.8
    assert motion.state is MotionState.FAILED
    with pytest.raises(
        DeviceFault, match=r"has not ended its move to 75\.0 mm within the expected time"
    ):
        gripper.check()


def test_a_paused_move_is_not_overdue(wire: Wire) -> None:
    gripper = connected(wire)
    gripper.move(0.100, 0.05)
    serve(gripper, wire, 0.1)
    gripper.pause()
    serve(gripper, wire, 10.0)
    gripper.check()


@pytest.mark.parametrize("held_up", [0.1, 0.25, 2.0])
def test_a_move_that_goes_on_and_ends_while_this_computer_stands_still_is_no_fault_of_the_gripper(
    wire: Wire, held_up: float
) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.077, 0.05)
    serve(gripper, wire, 0.05)
    for _ in range(round(1e3 * held_up)):  # the gripper lives on, and nobody listens
        wire.clock.advance(0.001)
        wire.device.advance(wire.clock.now())
    serve(gripper, wire, 0.3)
    gripper.check()
    assert motion.state is MotionState.DONE, motion.problem
    assert gripper.settled()


@pytest.mark.parametrize("command", [Command.WIDTH, Command.SPEED, Command.SYSTEM_STATE])
def test_an_update_that_ceases_to_come_is_reported(wire: Wire, command: Command) -> None:
    gripper = connected(wire)
    serve(gripper, wire, 0.1)
    wire.device.deaf = {command}
    assert serve_until(gripper, wire, lambda: gripper.link() != "ok") <= 0.15
    with pytest.raises(DeviceLost, match=f"has not sent its {command.name} for"):
        gripper.check()


@pytest.mark.parametrize(
    ("width", "words"), [(0.2, "outside its stroke"), (-0.1, "outside its stroke")]
)
def test_an_impossible_width_is_reported(wire: Wire, width: float, words: str) -> None:
    gripper = connected(wire)
    serve(gripper, wire, 0.1)
    wire.device.reported_width = width
    serve(gripper, wire, 0.03)
    with pytest.raises(DeviceFault, match=words):
        gripper.check()


def test_a_width_that_stays_the_same_for_a_whole_move_is_reported(wire: Wire) -> None:
    gripper = connected(wire)
    serve(gripper, wire, 0.1)
    wire.device.frozen = True
    motion = gripper.move(0.100, 0.1)
    serve(gripper, wire, 1.0)
    assert motion.state is MotionState.FAILED
    with pytest.raises(DeviceFault, match=r"measures 65\.0 mm at the end of a move to 100\.0 mm"):
        gripper.check()


def test_no_stream_moves_the_fingers_after_a_loss_until_it_is_acknowledged(wire: Wire) -> None:
    gripper = connected(wire)
    serve(gripper, wire, 0.2, renew=-0.01)
    wire.device.silent = True
    serve(gripper, wire, 0.2)
    wire.device.silent = False
    serve(gripper, wire, RECONNECT + 0.3)
    assert wire.opened == 2
    stood = wire.fingers.state().width
    for _ in range(20):
        with pytest.raises(DeviceLost, match="acknowledge the loss before it moves: no answer for"):
            gripper.set_speed(-0.01)
        serve(gripper, wire, 0.02)
    assert wire.fingers.state().width == stood
    gripper.acknowledge()
    serve(gripper, wire, 0.2, renew=-0.01)
    assert wire.fingers.state().width < stood


def test_a_move_that_outlives_the_wire_is_stopped_when_it_is_open_again(wire: Wire) -> None:
    gripper = connected(wire)
    motion = gripper.move(0.100, 0.02)  # 1.75 s
    serve(gripper, wire, 0.1)
    wire.device.silent = True
    serve(gripper, wire, 0.1)
    assert motion.state is MotionState.FAILED
    assert not gripper.settled()
    wire.device.silent = False
    serve_until(gripper, wire, lambda: wire.opened == 2)
    serve(gripper, wire, 0.1)
    assert wire.fingers.state().speed == 0.0
    assert motion.settled
    assert gripper.settled()


@pytest.mark.parametrize(("limit", "force"), [(None, 12.0), (None, 20.0), (6.0, 30.0)])
def test_a_grasp_presses_with_its_force_and_with_the_cell_file_s_limit_at_most(
    wire: Wire, limit: float | None, force: float
) -> None:
    wire.fingers.obstacle, wire.fingers.stiffness = 0.028, 6000.0
    gripper = connected(wire, force_limit=limit)
    strongest = 0.0

    def serve_it(_tick: int) -> None:
        nonlocal strongest
        serve(gripper, wire, 0.02)
        strongest = max(strongest, wire.fingers.force)

    inputs = {"force": force, "width": OFFSET + 0.005}
    ended = drive(Grasp(), inputs, {Gripper: gripper}, clock=wire.clock, each_tick=serve_it)
    assert ended.status is Status.SUCCESS
    most = min(force / 2.0, math.inf if limit is None else limit)
    assert 0.8 * most < strongest < 1.15 * most


def test_a_streamed_speed_presses_with_the_limit_of_the_force_at_most() -> None:
    bench = wsg(6.0)
    bench.put(bench.width - 4e-3)  # no move has told the fingers a force
    bench.renew = -0.02
    bench.serve(1.0)
    assert 4.0 < bench.hand.force < 6.6
