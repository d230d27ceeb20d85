"""Claims that every device of a kind keeps, judged by what the device truly does; a driver's test runs them.

    from pomona.drivers.conformance import GripperBench, gripper_claims

    def bench() -> GripperBench:            # a driver, and the truth at the other end of its wire
        ...

    test_claims = gripper_claims(clamp=bench)

Each claim gets new benches, does something, and compares the fingers' true opening, joints, bytes or times with what the
driver said. What it finds is one sentence that begins with the claim. A driver that cannot keep a claim says so in its
class, with the page of its protocol that explains it (`Device.declared`), and `pomona check` repeats it for each cell.
Four claims of a device that moves cannot be declared away: a stop is delivered, settled is measured, a motion that
nobody ordered is noticed, and the force is bounded.
"""

from pomona.drivers.conformance.arm import ARM, ArmBench, Body, arm_claims
from pomona.drivers.conformance.bench import Bench, BenchClock, Wire
from pomona.drivers.conformance.camera import CAMERA, CameraBench, Wall, camera_claims
from pomona.drivers.conformance.claims import Claim, Claims, Finding, judged
from pomona.drivers.conformance.force_sensor import (
    FORCE_SENSOR,
    ForceBench,
    Press,
    force_sensor_claims,
)
from pomona.drivers.conformance.gripper import (
    GRIPPER,
    GripperBench,
    Hand,
    gripper_claims,
)
from pomona.drivers.conformance.signals import SIGNALS, Plc, SignalsBench, signals_claims

__all__ = [
    "ARM",
    "CAMERA",
    "FORCE_SENSOR",
    "GRIPPER",
    "SIGNALS",
    "ArmBench",
    "Bench",
    "BenchClock",
    "Body",
    "CameraBench",
    "Claim",
    "Claims",
    "Finding",
    "ForceBench",
    "GripperBench",
    "Hand",
    "Plc",
    "Press",
    "SignalsBench",
    "Wall",
    "Wire",
    "arm_claims",
    "camera_claims",
    "force_sensor_claims",
    "gripper_claims",
    "judged",
    "signals_claims",
]
