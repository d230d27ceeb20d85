"""The driver `reacher` keeps the claims of arms, at the emulated arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from my_package.reacher import EmulatedReacher, Reacher
from pomona.drivers import ArmLimits
from pomona.drivers.conformance import ArmBench, BenchClock, Body, Wire, arm_claims

WIDE = np.full(7, 3.0)
LIMITS = ArmLimits(-WIDE, WIDE, velocity=WIDE, acceleration=5.0 * WIDE, jerk=50.0 * WIDE)


def bench() -> ArmBench:
    """The driver, and the truth at the other end of its wire."""
    clock = BenchClock()
    emulated = EmulatedReacher(clock, 7)
    body = Body(clock, emulated.q, lambda: emulated.q)
    emulated.says = body.told
    clock.each_step.append(body.advance)
    wire = Wire(lambda: emulated)
    arm = Reacher(wire.open(), clock, Path("robot.xml"), LIMITS, lead=0.15)
    arm.connect()
    without = ("cut",)  # a broken connection is not opened again
    return ArmBench(arm, clock, body, switches={"": wire}, without=without, rough=6.0)


test_claims = arm_claims(reacher=bench)
