"""The driver `clamp` at the emulated gripper, on a clock that the test moves."""

from __future__ import annotations

import pytest

from my_package.clamp import Clamp, ClampOptions, EmulatedClamp
from pomona.drivers import DeviceLost, Gripper, MotionRefused, MotionState
from pomona.executive import ManualClock

Pair = tuple[Clamp, EmulatedClamp]


@pytest.fixture
def pair() -> Pair:
    clock = ManualClock()
    wire = EmulatedClamp(clock)
    gripper = Clamp(wire, clock, ClampOptions())
    gripper.connect()
    return gripper, wire


def serve(gripper: Clamp, steps: int) -> None:
    for _ in range(steps):  # of 4 ms
        gripper.step()


def test_a_move_goes_to_its_width(pair: Pair) -> None:
    gripper, wire = pair
    motion = gripper.move(0.03, 0.1)
    serve(gripper, 300)
    assert isinstance(gripper, Gripper)
    assert (motion.state, motion.settled) == (MotionState.DONE, True)
    assert wire.width == pytest.approx(0.03)
    gripper.check()


def test_an_object_stops_a_move_which_is_no_fault(pair: Pair) -> None:
    gripper, wire = pair
    wire.obstacle = 0.05
    motion = gripper.move(0.03, 0.1)
    serve(gripper, 300)
    assert motion.problem == "the fingers are blocked at 50.0 mm"
    gripper.check()


def test_a_safe_stop_ends_a_move_and_nothing_opens_after_it(pair: Pair) -> None:
    gripper, wire = pair
    gripper.move(0.03, 0.1)
    serve(gripper, 50)
    gripper.safe_stop("test")
    serve(gripper, 100)
    stood = wire.width
    gripper.set_speed(0.05)
    serve(gripper, 100)
    assert gripper.settled()
    assert wire.width == stood
    with pytest.raises(MotionRefused, match="latched"):
        gripper.move(0.03, 0.1)


def test_a_streamed_speed_ends_when_it_is_not_renewed(pair: Pair) -> None:
    gripper, wire = pair
    gripper.set_speed(-0.02)
    serve(gripper, 200)
    assert wire.width == pytest.approx(0.08 - 0.02 * 0.1, abs=5e-4)
    gripper.check()


def test_silence_is_a_loss_until_it_is_acknowledged(pair: Pair) -> None:
    gripper, wire = pair
    wire.silent = True
    serve(gripper, 50)
    with pytest.raises(DeviceLost, match="no answer for"):
        gripper.check()
    wire.silent = False
    serve(gripper, 50)
    with pytest.raises(DeviceLost, match="acknowledge the loss"):
        gripper.set_speed(-0.02)
    gripper.acknowledge()
    gripper.check()
