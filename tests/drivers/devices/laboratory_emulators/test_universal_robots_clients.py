"""The vendor's own clients accept the emulated controller, in a process of its own: they hold Python's lock."""

from __future__ import annotations

import contextlib
import importlib
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest

START = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]


@contextlib.contextmanager
def emulated(host: str, *options: str) -> Iterator[str]:
    command = [
        sys.executable,
        "-m",
        "pomona.devices.emulators.command_emulate",
        "universal-robots",
        "--host",
        host,
    ]
    with subprocess.Popen([*command, *options], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            for _ in range(5):
                assert process.stdout.readline(), "the emulator did not start"
            yield host
        finally:
            process.terminate()


def near(q: list[float], to: list[float], by: float = 2e-3) -> bool:
    return max(abs(a - b) for a, b in zip(q, to, strict=True)) < by


@pytest.mark.realtime
def test_ur_rtde_reads_moves_and_asks() -> None:
    rtde_receive: Any = pytest.importorskip(
        "rtde_receive", reason="ur_rtde, of the extra dev, is not installed"
    )
    rtde_control: Any = importlib.import_module("rtde_control")
    dashboard_client: Any = importlib.import_module("dashboard_client")
    with emulated("127.0.0.90") as host:
        receive = rtde_receive.RTDEReceiveInterface(host)
        assert near(receive.getActualQ(), START)
        assert (receive.getRobotMode(), receive.getSafetyMode()) == (7, 1)
        board = dashboard_client.DashboardClient(host)
        board.connect()
        assert board.isInRemoteControl()
        assert board.getRobotModel() == "UR5"
        assert "5.23" in board.polyscopeVersion()
        control = rtde_control.RTDEControlInterface(host)  # uploads its script of 50 kB
        goal = [q + 0.1 for q in START]
        assert control.moveJ(goal, 1.0, 2.0)
        assert near(receive.getActualQ(), goal)
        for i in range(100):
            began = control.initPeriod()
            assert control.servoJ([q + 0.0005 * i for q in goal], 0.5, 0.5, 0.002, 0.1, 300)
            control.waitPeriod(began)
        time.sleep(0.3)
        assert near(receive.getActualQ(), [q + 0.05 for q in goal], 0.01)
        control.servoStop()
        assert control.speedJ([0.2] * 6, 2.0, 0.2)
        control.speedStop()
        board.stop()
        time.sleep(0.1)
        assert "false" in str(board.running()).lower()
        control.disconnect()
        receive.disconnect()
        board.disconnect()


@pytest.mark.realtime
def test_ur_s_own_rtde_client_reads_and_writes_registers() -> None:
    rtde: Any = pytest.importorskip(
        "rtde.rtde",
        reason="UR's RTDE client is not installed; it is on GitHub only (RTDE_Python_Client_Library)",
    )
    with emulated("127.0.0.91") as host:
        client = rtde.RTDE(host, 30004)
        client.connect()
        assert client.get_controller_version()[:2] == (5, 23)
        assert client.send_output_setup(
            ["timestamp", "actual_q", "safety_mode", "robot_mode"], frequency=125
        )
        inputs = client.send_input_setup(["input_int_register_24", "input_double_register_24"])
        assert inputs
        assert client.send_start()
        inputs.input_int_register_24, inputs.input_double_register_24 = 3, 0.5
        assert client.send(inputs)
        stamps = [client.receive() for _ in range(20)]
        assert all(stamp is not None and near(stamp.actual_q, START) for stamp in stamps)
        assert stamps[-1].timestamp > stamps[0].timestamp
        assert (stamps[-1].safety_mode, stamps[-1].robot_mode) == (1, 7)
        assert client.send_pause()
        client.disconnect()
