"""The driver `clamp` keeps the claims of grippers, at the emulated gripper."""

from __future__ import annotations

from my_package.clamp import Clamp, ClampOptions, EmulatedClamp
from pomona.drivers.conformance import BenchClock, GripperBench, Wire, gripper_claims


def bench() -> GripperBench:
    """The driver, and the truth at the other end of its wire."""
    clock = BenchClock()
    hand = EmulatedClamp(clock)
    clock.each_step.append(hand.advance)
    wire = Wire(lambda: hand)
    gripper = Clamp(wire.open, clock, ClampOptions())
    gripper.connect()
    return GripperBench(gripper, clock, hand, wire)


test_claims = gripper_claims(clamp=bench)
