"""The simulated cell behind emulated devices in wall time; slower than real time, for busy computers."""

import json
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pomona.drivers.errors import CellFileError
from pomona.drivers.interfaces import Arm, Camera, ForceSensor, Gripper
from pomona.executive.cell.cell_file import judge_cell_file
from pomona.executive.cell.connect import load_cell
from pomona.executive.values.findings import Findings

CELL = Path(__file__).resolve().parents[4] / "trees" / "cells" / "emulated.yaml"
PACE = "0.2"
PATIENT = {
    "fingers_silence": "300 ms", "gripper_silence": "300 ms", "arm_silence": "300 ms", "arm_status": "600 ms",
    "arm_stall": "1 s", "camera_silence": "2 s",
}  # fmt: skip
"""A busy computer emulates with pauses, which real devices do not make."""


def free_ports(folder: Path) -> dict[str, str]:
    """Return free addresses."""
    while True:
        servers = [socket.create_server(("127.0.0.1", 0)) for _ in range(3)]
        arm, gripper, camera = (server.getsockname()[1] for server in servers)
        for server in servers:
            server.close()
        if arm + 1 not in (gripper, camera) and arm < 65000:
            addresses = {"arm": arm, "gripper": gripper, "camera": camera}
            wires = {name: f"127.0.0.1:{port}" for name, port in addresses.items()}
            return wires | {"wires": str(folder), "time": "wall"} | PATIENT


@pytest.mark.realtime
def test_every_device_answers_through_its_own_wire(tmp_path: Path) -> None:
    cell = load_cell(CELL, overrides=free_ports(tmp_path) | {"pace": PACE})
    try:
        assert set(cell.links().values()) == {"ok"}
        arm, gripper, fingers, camera = (
            cell.device(kind) for kind in (Arm, Gripper, ForceSensor, Camera)
        )
        assert cell.workspace is not None
        assert arm.state().q == pytest.approx(cell.workspace.poses["observe"], abs=2e-3)
        assert gripper.limits.width_min == pytest.approx(0.035)
        sample = fingers.latest()
        assert sample is not None
        assert np.abs(sample.wrenches[:, :3]).max() < 0.6
        frame = camera.latest()
        assert frame is not None
        assert frame.q == pytest.approx(arm.state().q, abs=2e-3)
        assert frame.colour.shape == (480, 640, 3)
        motion = gripper.move(gripper.state().width - 0.01, 0.1)
        end = cell.clock.now() + 3.0
        while not motion.settled and cell.clock.now() < end:
            cell.clock.advance(0.02)
            cell.check()
        assert motion.state.value == "done"
        truth = cell.truth()
        assert truth is not None
        assert not truth["lifted"]
    finally:
        cell.close()


def test_options_that_the_emulated_world_cannot_have_are_refused_before_it_starts(
    tmp_path: Path,
) -> None:
    with pytest.raises(CellFileError, match="cannot be used with these options") as caught:
        load_cell(CELL, overrides=free_ports(tmp_path) | {"fruit": "apple_9"})
    assert "apple_9" in caught.value.message
    assert caught.value.line > 0


def test_fingers_in_front_of_a_simulated_cell_without_a_force_sensor_are_refused_by_the_check(
    tmp_path: Path,
) -> None:
    cells = CELL.parent
    simulated = (
        (cells / "sim_ur5e_hand_e.yaml")
        .read_text()
        .replace("include: sim", f"include: {cells}/sim")
    )
    simulated = simulated.replace("../robots", str(cells.parent / "robots"))
    simulated = re.sub(r"  (fingers|hands): .*\n", "", simulated)
    (tmp_path / "sim.yaml").write_text(simulated)
    twin = cells / "twin.yaml"
    text = (cells / "emulated_ur5e_hand_e_fingers.yaml").read_text()
    text = text.replace(
        "include: emulated_ur5e_hand_e.yaml#world",
        f"include: emulated_ur5e_hand_e.yaml#world\n  cell: {tmp_path}/sim.yaml",
    )
    findings = Findings()
    judge_cell_file(twin, findings, {}, {str(twin): text})
    found = [finding.message for finding in findings.sorted()]
    assert found == ["world.fingers: sim.yaml has no ForceSensor, which these wires would lead to"]


@pytest.mark.realtime
def test_the_whole_pick_goes_through_the_wires(tmp_path: Path) -> None:
    settings = [
        f"--set={key}={value}" for key, value in (free_ports(tmp_path) | {"pace": PACE}).items()
    ]
    command = [
        sys.executable,
        "-m",
        "pomona.executive.cli",
        "run",
        "pick_apple",
        "--cell",
        str(CELL),
        "--json",
        "--quiet",
    ]
    record = ["--record", str(tmp_path / "runs")]
    result = subprocess.run(
        [*command, *record, *settings], capture_output=True, text=True, timeout=600
    )
    report = json.loads(result.stdout.splitlines()[-1])
    assert (report["outcome"], report["reason"]) == ("success", None)
    assert report["truth"]["lifted"] is True
