"""The fault matrix, in small: `make faults` runs all of it."""

from __future__ import annotations

import subprocess
import sys

import pytest

from benchmarks.fault_executive import Leftovers, Operator, SteppedBack
from benchmarks.fault_table import read_table
from benchmarks.fault_world import Person
from pomona.applications.conveyor.devices import SimConveyor
from pomona.devices.laboratory_emulators.simulated_load import SimLoadSensor
from pomona.executive.cell.device import FaultSwitch
from pomona.tools.simulation.arm import SimArm
from pomona.tools.simulation.camera import SimCamera
from pomona.tools.simulation.fingers import SimFingers
from pomona.tools.simulation.gripper import SimGripper

TRIED = [
    "arm.frozen@following",
    "arm.stall@paused",
    "camera.depth_mirrored@moving",
    "camera.moved_x@preparing",
    "camera.old@holding",
    "camera.turned_y@preparing",
    "clock.steps_back@lifting",
    "executive.killed@lifting",
    "executive.commands_arm@closing",
    "executive.opens_fingers@lifting",
    "executive.opens_latched@holding",
    "fingers.both_press_more@lifting",
    "fingers.dead_right@holding",
    "fingers.not_a_number@lifting",
    "fingers.stuck@lifting",
    "fingers.swapped@holding",
    "fingers.zero@preparing",
    "fingers.zero@closing",
    "gripper.lost@paused",
    "operator.pauses_briefly@touching",
    "operator.stops@retreat_touching",
]

TRIED_IN_THE_CRATE = ["person.moves_crate@preparing", "wrist.stuck@hooking"]
"""Each from the beginning: a pick in the crate takes longer than both."""


def test_the_table_has_every_fault_of_every_simulated_device() -> None:
    devices: dict[str, type[FaultSwitch]] = {
        "arm": SimArm, "camera": SimCamera, "fingers": SimFingers, "gripper": SimGripper,
        "executive": Leftovers, "clock": SteppedBack, "operator": Operator,
        "wrist": SimLoadSensor, "person": Person, "conveyor": SimConveyor,
    }  # fmt: skip
    known = {(name, kind) for name, device in devices.items() for kind in device.known_faults}
    cases = [case for cell in ("sim", "conveyor", "sim_crate") for case in read_table(cell)]
    assert {(case.switch, case.kind) for case in cases if case.ends != "recovered"} == known
    assert len(cases) >= 900
    assert not [
        case.name
        for case in cases
        if case.ends not in ("success", "harmless") and case.within == float("inf")
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cell", "tried", "how"),
    [
        pytest.param("sim", TRIED, [], marks=pytest.mark.landmark),
        ("sim_crate", TRIED_IN_THE_CRATE, ["--seed", "4", "--alone"]),
    ],
)
def test_faults_end_as_their_rows_say(cell: str, tried: list[str], how: list[str]) -> None:
    command = [
        sys.executable,
        "-m",
        "benchmarks.fault_matrix",
        "--cell",
        cell,
        "--cases",
        *tried,
        "--jobs",
        "2",
        *how,
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 wrong, 0 false successes" in done.stdout, done.stdout
    assert all(name.replace("@", " ").split()[0] in done.stdout for name in tried)
