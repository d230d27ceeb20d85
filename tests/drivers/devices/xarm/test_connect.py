"""Settings of a cell file, and an arm over real connections."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.emulators.server import Server, TcpPort
from pomona.devices.laboratory_emulators.xarm import PORTS as EMULATED, XArmEmulator
from pomona.devices.xarm import outside
from pomona.devices.xarm.connect import connect
from pomona.devices.xarm.driver import XArm
from pomona.drivers import CellFileError, ConnectContext, MotionState
from pomona.executive import SystemClock
from tests.drivers.device_settings import read_settings
from tests.drivers.devices.motoman.test_driver import swing

ROBOT = Path(__file__).resolve().parents[4] / "trees" / "robots" / "xarm6_hand_e.xml"
HOST = "127.0.0.95"  # ports of the controller are fixed: an address of its own
START = np.array([0.1, -0.6, -0.7, 0.3, 1.2, 0.7])


@contextlib.contextmanager
def served(controller: XArmEmulator, host: str = HOST) -> Iterator[None]:
    """The controller at its own ports, on real time."""
    try:
        ports = [
            TcpPort(getattr(controller, name), host, port, clients=4)
            for name, port in EMULATED.items()
        ]
    except PermissionError:
        pytest.skip("this account may not listen at port 502")
    done = threading.Event()
    server = Server(ports, [controller], time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join(5.0)


def open_arm(folder: Path, text: str) -> XArm:
    path = folder / "cell.yaml"
    path.write_text(f"driver: xarm\n{text}\n")
    return connect.connect(read_settings(connect, path), ConnectContext(path, SystemClock(), 0))


@pytest.mark.realtime
def test_it_moves_over_tcp_and_is_stopped_from_outside(tmp_path: Path) -> None:
    controller = XArmEmulator(FreeJoints(START), np.full(6, 3.14))
    with served(controller):
        arm = open_arm(tmp_path, f"address: {HOST}\nmodel: xarm6\nrobot: {ROBOT}\nsilence: 900 ms")
        change = np.full(6, 0.05)
        motion = arm.follow(swing(arm.state().q, change, duration=0.5))
        end = time.monotonic() + 10.0
        while not motion.settled and time.monotonic() < end:
            SystemClock().advance(0.005)
        assert (motion.state, motion.problem) == (MotionState.DONE, "")
        assert controller._joints.measured()[0] == pytest.approx(START + change, abs=2e-3)
        assert arm.outside_stop is not None
        place, arguments = arm.outside_stop
        assert place == f"{outside.__name__}:stop"
        outside.stop(*arguments)
        assert controller.state == 4
        arm.close()
    with pytest.raises(ConnectionRefusedError):
        outside.stop(*arguments)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            f"address: 127.0.0.96\nmodel: xarm6\nrobot: {ROBOT}",
            r"(?s):2:10: .*cannot be reached.*502, 30003",
        ),
        (f"address: h\nmodel: xarm8\nrobot: {ROBOT}", "did you mean 'xarm"),
        ("address: h\nmodel: xarm6\nrobot: nothing.xml", "does not exist"),
        (
            f"address: h\nmodel: xarm6\nrobot: {ROBOT.with_name('sia5f_wsg32.xml')}",
            "needs 6 positive numbers",
        ),
        (f"address: h\nmodel: xarm7\nrobot: {ROBOT}", "joints"),
        (
            f"address: h\nmodel: lite6\nrobot: {ROBOT}",
            r"(?s):4:8: .*no description of a lite6: .*'model: xarm6'",
        ),
        (
            f"address: h\nmodel: '850'\nrobot: {ROBOT.with_name('ur5e_hand_e.xml')}",
            "no description of a 850",
        ),
        (
            f"address: h\nmodel: xarm6\nrobot: {ROBOT.with_name('ur5e_hand_e.xml')}",
            "0, 425, 392, 0, 0 mm apart, not 0",
        ),
    ],
)
def test_a_wrong_setting_is_refused_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(CellFileError, match=words):
        open_arm(tmp_path, text)


@pytest.mark.realtime
def test_another_robot_is_refused_at_the_setting_of_its_model(tmp_path: Path) -> None:
    refused = pytest.raises(CellFileError, match=r"(?s):3:8: .*is a lite6, not the xarm6")
    with served(XArmEmulator(FreeJoints(START), np.full(6, 3.14), 9), "127.0.0.97"), refused:
        open_arm(tmp_path, f"address: 127.0.0.97\nmodel: xarm6\nrobot: {ROBOT}")


def test_the_limits_tell_how_late_a_stop_begins(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(f"driver: xarm\naddress: h\nmodel: xarm6\nrobot: {ROBOT}\nservo_lag: 60 ms\n")
    assert read_settings(connect, path).values.limits.reaction == 0.06
