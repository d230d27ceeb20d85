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
from pomona.devices.laboratory_emulators.universal_robots import UrEmulator
from pomona.devices.universal_robots import outside
from pomona.devices.universal_robots.connect import connect
from pomona.devices.universal_robots.driver import UrArm
from pomona.devices.universal_robots.options import PORTS
from pomona.drivers import CellFileError, ConnectContext, DeviceLost, MotionState
from pomona.executive import SystemClock
from tests.drivers.device_settings import read_settings
from tests.drivers.devices.motoman.test_driver import swing

ROBOT = Path(__file__).resolve().parents[4] / "trees" / "robots" / "ur5e_wsg32.xml"
HOST = "127.0.0.87"  # ports of a UR are fixed: an address of its own
START = np.array([0.1, -1.5, 1.4, -1.3, -1.5, 0.7])


@contextlib.contextmanager
def served(controller: UrEmulator, host: str = HOST) -> Iterator[None]:
    """The controller at its own ports, on real time."""
    ports = [
        TcpPort(controller.rtde, host, PORTS["rtde"], clients=4),
        TcpPort(controller.dashboard, host, PORTS["dashboard"], clients=4),
        *(TcpPort(controller.script, host, port, clients=4) for port in (30001, 30002, 30003)),
    ]
    done = threading.Event()
    server = Server(ports, [controller], time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join(5.0)


def open_arm(folder: Path, text: str) -> UrArm:
    path = folder / "cell.yaml"
    path.write_text(f"driver: universal-robots\n{text}\n")
    return connect.connect(read_settings(connect, path), ConnectContext(path, SystemClock(), 0))


@pytest.mark.realtime
def test_it_moves_over_tcp_and_is_stopped_from_outside(tmp_path: Path) -> None:
    controller = UrEmulator(FreeJoints(START), np.full(6, 3.14))
    with served(controller):
        arm = open_arm(
            tmp_path,
            f"address: {HOST}\nmodel: ur5e\nrobot: {ROBOT}\nsilence: 900 ms\nlead: 500 ms\nrate: 250 Hz",
        )
        change = np.full(6, 0.05)
        motion = arm.follow(swing(arm.state().q, change, duration=0.5))
        end = time.monotonic() + 10.0
        while not motion.settled and time.monotonic() < end:
            SystemClock().advance(0.005)
        assert (motion.state, motion.problem) == (MotionState.DONE, "")
        assert controller._joints.measured()[0] == pytest.approx(START + change, abs=2e-3)
        assert controller.program == "pomona"
        assert arm.outside_stop is not None
        place, arguments = arm.outside_stop
        assert place == f"{outside.__name__}:stop"
        outside.stop(*arguments)
        assert controller.program is None
        arm.close()
    with pytest.raises(DeviceLost, match="dashboard server cannot be reached"):
        outside.stop(*arguments)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            f"address: 127.0.0.88\nmodel: ur5e\nrobot: {ROBOT}",
            r"(?s):2:10: .*cannot be reached.*30004, 30002, 29999",
        ),
        (
            f"address: h:99\nmodel: ur5e\nrobot: {ROBOT}",
            r":2:10: .*'h:99' is not a host: .*ports are fixed",
        ),
        (f"address: h\nmodel: ur6e\nrobot: {ROBOT}", "did you mean 'ur"),
        ("address: h\nmodel: ur5e\nrobot: nothing.xml", "does not exist"),
        (
            f"address: h\nmodel: ur5e\nrobot: {ROBOT.with_name('sia5f_wsg32.xml')}",
            "needs 6 positive numbers",
        ),
        (
            f"address: h\nmodel: ur10e\nrobot: {ROBOT}",
            r":4:8: .*no description of a ur10e: .*as in a ur5e, not 0, 613",
        ),
        (
            f"address: h\nmodel: ur16e\nrobot: {ROBOT}",
            r":4:8: .*; give that of a ur16e, or 'model: ur5e'",
        ),
        (
            f"address: h\nmodel: ur5e\nrobot: {ROBOT.with_name('xarm6_hand_e.xml')}",
            "0, 289, 78, 0, 76 mm apart, not 0",
        ),
        (f"address: '[::1]'\nmodel: ur5e\nrobot: {ROBOT}", r":2:10: .*is not a host"),
    ],
)
def test_a_wrong_setting_is_refused_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(CellFileError, match=words):
        open_arm(tmp_path, text)


@pytest.mark.realtime
def test_another_robot_is_refused_at_the_setting_of_its_model(tmp_path: Path) -> None:
    refused = pytest.raises(CellFileError, match=r"(?s):3:8: .*is a ur10e, not the ur5e")
    with served(UrEmulator(FreeJoints(START), np.full(6, 3.14), "UR10"), "127.0.0.89"), refused:
        open_arm(tmp_path, f"address: 127.0.0.89\nmodel: ur5e\nrobot: {ROBOT}")


def test_the_limits_tell_how_late_a_stop_begins(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(f"driver: universal-robots\naddress: h\nmodel: ur5e\nrobot: {ROBOT}\n")
    assert read_settings(connect, path).values.limits.reaction == pytest.approx(
        0.02 + 0.02 + UrArm.lag
    )
