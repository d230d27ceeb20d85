import threading
import time
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.emulators.motoman import FreeJoints, MotomanEmulator
from pomona.devices.emulators.server import Server, TcpPort
from pomona.devices.motoman.connect import connect
from pomona.devices.motoman.driver import MotomanArm
from pomona.drivers.errors import CellFileError, UnusableRobotFile
from pomona.drivers.interfaces import MotionState, Trajectory
from pomona.drivers.robot_file import read_limits
from pomona.drivers.services import ConnectContext
from pomona.executive.clock import SystemClock
from tests.drivers.device_settings import read_settings

ROBOT = Path(__file__).resolve().parents[4] / "trees" / "robots" / "sia5f_wsg32.xml"


def open_arm(folder: Path, text: str) -> MotomanArm:
    path = folder / "cell.yaml"
    path.write_text(f"driver: motoman\n{text}\n")
    return connect.connect(read_settings(connect, path), ConnectContext(path, SystemClock(), 0))


def neighbours() -> tuple[int, int]:
    """Two free ports in a row."""
    import socket

    while True:
        with socket.create_server(("127.0.0.1", 0)) as first:
            port = int(first.getsockname()[1])
            try:
                socket.create_server(("127.0.0.1", port + 1)).close()
            except OSError:
                continue
            return port, port + 1


@pytest.mark.realtime
def test_it_moves_over_tcp_with_the_limits_of_the_description(tmp_path: Path) -> None:
    start = np.full(7, 0.1)
    controller = MotomanEmulator(FreeJoints(start), np.full(7, 3.0), ">")
    motion_port, state_port = neighbours()
    ports = [
        TcpPort(controller.motion, port=motion_port),
        TcpPort(controller.state, port=state_port, clients=4),
    ]
    done = threading.Event()
    server = Server(ports, [controller], time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    settings = f"address: '127.0.0.1:{motion_port}'\ncontroller: fs100\nrobot: {ROBOT}\nsilence: 900 ms\nlead: 600 ms"
    arm = open_arm(tmp_path, settings)
    assert arm.limits.upper[1] == pytest.approx(np.radians(110.0))
    s = np.linspace(0.0, 1.0, 31)[:, None]
    change = np.full(7, 0.02)
    q, qd = (
        start + change * (10 * s**3 - 15 * s**4 + 6 * s**5),
        change * (30 * s**2 - 60 * s**3 + 30 * s**4) / 0.3,
    )
    motion = arm.follow(
        Trajectory(s[:, 0] * 0.3, q, qd, change * (60 * s - 180 * s**2 + 120 * s**3) / 0.09)
    )
    end = time.monotonic() + 10.0
    while not motion.settled and time.monotonic() < end:
        SystemClock().advance(0.005)
    arm.close()
    done.set()
    thread.join(2.0)
    assert (motion.state, motion.problem) == (MotionState.DONE, "")
    assert controller._joints.measured()[0] == pytest.approx(start + change, abs=1e-5)


def test_the_reaction_is_a_third_of_the_lead_and_a_period_of_points(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(
        f"driver: motoman\naddress: h\ncontroller: fs100\nrobot: {ROBOT}\nlead: 300 ms\n"
    )
    assert read_settings(connect, path).values.limits.reaction == pytest.approx(0.12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            f"address: '127.0.0.1:9'\ncontroller: fs100\nrobot: {ROBOT}",
            r"(?s):2:10: .*cannot be reached.*MotoROS",
        ),
        (f"address: h\ncontroller: fs1000\nrobot: {ROBOT}", "did you mean 'fs100'"),
        (
            f"address: h\ncontroller: fs100\nrobot: {ROBOT}\njoints: S L U R B T E E",
            "must name each of",
        ),
        (
            f"address: h\ncontroller: fs100\nrobot: {ROBOT}\njoints: S L E E R B T",
            "must name each of S L E U R B T",
        ),
        ("address: h\ncontroller: fs100\nrobot: nothing.xml", "does not exist"),
    ],
)
def test_a_wrong_setting_is_refused_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(CellFileError, match=words):
        open_arm(tmp_path, text)


@pytest.mark.parametrize(
    ("velocity", "span", "words"),
    [
        ("nan", "-1 1", "'arm_velocity' needs 1 positive numbers up to 50"),
        ("inf", "-1 1", "'arm_velocity' needs"), ("200", "-1 1", "'arm_velocity' needs"),
        ("0", "-1 1", "'arm_velocity' needs"),
        ("2", "nan nan", "the joint 'a' needs a range"), ("2", "-inf inf", "the joint 'a' needs a range"),
        ("2", "-1e6 1e6", "the joint 'a' needs a range"), ("2", "0 0", "the joint 'a' needs a range"),
        ("2", "-1 1", ""),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore")  # MuJoCo's own of a NaN
def test_limits_with_which_nothing_would_ever_be_too_fast_or_too_far_are_refused(
    tmp_path: Path, velocity: str, span: str, words: str
) -> None:
    rates = "".join(f"<numeric name='arm_{name}' data='{data}'/>" for name, data in
                    {"velocity": velocity, "acceleration": "8", "jerk": "80"}.items())  # fmt: skip
    joint = f"<joint name='a' type='hinge' range='{span}'/><geom size='0.1'/>"
    body = f"<worldbody><body>{joint}</body></worldbody><actuator><position joint='a'/></actuator>"
    robot = tmp_path / "robot.xml"
    robot.write_text(f"<mujoco><compiler angle='radian'/><custom>{rates}</custom>{body}</mujoco>")
    if not words:
        assert read_limits(robot).velocity == pytest.approx([2.0])
        return
    with pytest.raises(UnusableRobotFile, match=words):
        read_limits(robot)


def test_a_description_without_limits_is_refused(tmp_path: Path) -> None:
    joint = "<joint name='a' type='hinge' range='-1 1'/><geom size='0.1'/>"
    body = f"<worldbody><body>{joint}</body></worldbody><actuator><position joint='a'/></actuator>"
    (tmp_path / "robot.xml").write_text(f"<mujoco>{body}</mujoco>")
    with pytest.raises(UnusableRobotFile, match="lacks the numeric 'arm_velocity'"):
        read_limits(tmp_path / "robot.xml", 1)
    with pytest.raises(UnusableRobotFile, match="has 1 actuated joints"):
        read_limits(tmp_path / "robot.xml", 7)
    (tmp_path / "robot.xml").write_text("<mujoco>")
    with pytest.raises(UnusableRobotFile, match=r"robot\.xml: "):
        read_limits(tmp_path / "robot.xml", 7)
