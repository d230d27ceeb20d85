"""The driver `reacher` at the emulated arm, on a clock that the test moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from my_package.reacher import EmulatedReacher, Reacher
from pomona.drivers.errors import DeviceLost, MotionRefused
from pomona.drivers.interfaces import Arm, ArmLimits, MotionState, Trajectory
from pomona.executive.clock import ManualClock

WIDE = np.full(7, 3.0)
LIMITS = ArmLimits(-WIDE, WIDE, velocity=WIDE, acceleration=5.0 * WIDE, jerk=50.0 * WIDE)
Pair = tuple[Reacher, EmulatedReacher]


@pytest.fixture
def pair() -> Pair:
    clock = ManualClock()
    wire = EmulatedReacher(clock, 7)
    arm = Reacher(wire, clock, Path("robot.xml"), LIMITS, lead=0.15)
    arm.connect()
    serve(arm, 50)
    return arm, wire


def serve(arm: Reacher, steps: int) -> None:
    for _ in range(steps):  # of 4 ms
        arm.step()


def sweep(angle: float = 0.5, duration: float = 1.5) -> Trajectory:
    """A path of the first joint, from rest to rest."""
    x = np.linspace(0.0, 1.0, 151)
    first = np.eye(7)[0] * angle
    q = (10.0 * x**3 - 15.0 * x**4 + 6.0 * x**5)[:, None] * first
    qd = (30.0 * x**2 * (1.0 - x) ** 2)[:, None] * first / duration
    qdd = (60.0 * x * (1.0 - x) * (1.0 - 2.0 * x))[:, None] * first / duration**2
    return Trajectory(x * duration, q, qd, qdd)


def test_it_follows_a_path_to_its_end(pair: Pair) -> None:
    arm, wire = pair
    motion = arm.follow(sweep())
    serve(arm, 600)
    assert isinstance(arm, Arm)
    assert (motion.state, motion.settled) == (MotionState.DONE, True)
    assert wire.q[0] == pytest.approx(0.5, abs=1e-4)
    arm.check()


def test_a_safe_stop_brakes_on_the_path_and_refuses_another(pair: Pair) -> None:
    arm, wire = pair
    motion = arm.follow(sweep())
    serve(arm, 150)
    arm.safe_stop("test")
    serve(arm, 250)
    assert (motion.state, arm.settled()) == (MotionState.STOPPED, True)
    assert 0.05 < wire.q[0] < 0.45
    with pytest.raises(MotionRefused, match="latched"):
        arm.follow(sweep())


def test_silence_is_a_loss_until_it_is_acknowledged(pair: Pair) -> None:
    arm, wire = pair
    wire.silent = True
    serve(arm, 50)
    with pytest.raises(DeviceLost, match="no answer for"):
        arm.check()
    wire.silent = False
    serve(arm, 50)
    with pytest.raises(MotionRefused, match="not ready"):
        arm.follow(sweep())
    arm.acknowledge()
    arm.check()
