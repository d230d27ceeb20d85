"""Robotiq's engineers' own client accepts the emulated gripper on a pseudo terminal."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import pytest

from pomona.devices.emulators.free_gripper import FreeGripper
from pomona.devices.emulators.server import PtyPort, Server
from pomona.devices.laboratory_emulators.robotiq import RobotiqEmulator


@pytest.mark.realtime
@pytest.mark.filterwarnings("ignore")  # the client's own
def test_pyrobotiqgripper_activates_moves_and_reads(tmp_path: Path) -> None:
    client: Any = pytest.importorskip(
        "pyrobotiqgripper", reason="pyrobotiqgripper, of the extra dev, is not installed"
    )
    fingers = FreeGripper(time.monotonic, 0.068)
    gripper = RobotiqEmulator(fingers, activated=False)
    done = threading.Event()
    server = Server([PtyPort(gripper.rtu, tmp_path / "gripper")], [gripper], time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    try:
        hand = client.RobotiqGripper(com_port=str(tmp_path / "gripper"))
        hand.activate()
        assert hand.isActivated()
        hand.move(120, speed=255, force=0)
        assert abs(hand.position() - 120) <= 1
        fingers.obstacle = fingers.state().width - 0.005
        hand.move(230, speed=100, force=0)
        assert hand.objectDetection() == 2
        hand.disconnect()
    finally:
        done.set()
        thread.join(5.0)
