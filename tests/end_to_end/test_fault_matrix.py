"""The fault matrix, in small: `make faults` runs all of it."""

import pytest

from benchmarks.fault_matrix import read_table, run_case

CASES = {(case.device, case.kind, case.phase.name): case for case in read_table()}
TRIED = [
    ("arm", "frozen", "following"),
    ("gripper", "lost", "paused"),
    ("camera", "old", "holding"),
    ("fingers", "not_a_number", "lifting"),
    ("fingers", "zero", "closing"),
]


def test_the_table_has_every_fault_of_every_simulated_device() -> None:
    from drivers.sim.arm import SimArm
    from drivers.sim.camera import SimCamera
    from drivers.sim.fingers import SimFingers
    from drivers.sim.gripper import SimGripper

    devices = {"arm": SimArm, "camera": SimCamera, "fingers": SimFingers, "gripper": SimGripper}
    known = {(name, kind) for name, device in devices.items() for kind in device.known_faults}
    assert {(device, kind) for device, kind, _phase in CASES} == known
    assert len(CASES) >= 250


@pytest.mark.slow
@pytest.mark.parametrize("tried", TRIED, ids="-".join)
def test_a_fault_ends_as_its_row_says(tried: tuple[str, str, str]) -> None:
    assert run_case(CASES[tried]).wrong == []
