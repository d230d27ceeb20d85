"""Messages of rosbridge's JSON as CDR and back, against a server in this file; a server that dies loses the arm."""

from __future__ import annotations

import base64
import contextlib
import json
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from pomona.drivers import (
    Arm,
    CellFileError,
    DeviceLost,
    Gripper,
    MotionState,
    Trajectory,
    load_cell,
)
from pomona.executive.errors import UsageError
from pomona.tools.ros2.rosbridge import RosbridgePeer
from pomona.tools.ros2.types import coder, typestore

STATES, JOINTS = "sensor_msgs/msg/JointState", "sensor_msgs/JointState"
COMMANDS = "/joint_trajectory_controller/joint_trajectory"
STRING = "std_msgs/msg/String"
ROBOT = Path(__file__).parents[4] / "trees" / "robots" / "sia5f_wsg32.xml"


class Server:
    """A rosbridge: it notes what it receives, and sends to all who subscribed."""

    def __init__(self, port: int = 0) -> None:
        self.came: list[dict[str, Any]] = []
        self.changed = threading.Condition()
        self.clients: list[ServerConnection] = []
        self.server = serve(self.handle, "127.0.0.1", port, compression=None)
        self.port = self.server.socket.getsockname()[1]
        self.address = f"ws://127.0.0.1:{self.port}"
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self.thread.start()

    def handle(self, client: ServerConnection) -> None:
        try:
            for text in client:
                with self.changed:
                    self.came.append(json.loads(text))
                    if self.came[-1]["op"] == "subscribe" and client not in self.clients:
                        self.clients.append(client)
                    self.changed.notify_all()
        except ConnectionClosed:
            pass

    def wait(self, op: str) -> dict[str, Any]:
        with self.changed:
            assert self.changed.wait_for(lambda: any(one["op"] == op for one in self.came), 30.0)
            return next(one for one in self.came if one["op"] == op)

    def send(self, topic: str, message: dict[str, Any]) -> None:
        for client in self.clients:
            with contextlib.suppress(ConnectionClosed):
                client.send(json.dumps({"op": "publish", "topic": topic, "msg": message}))

    def die(self) -> None:
        self.server.shutdown()
        for client in self.clients:
            client.close()
        self.thread.join(10.0)


@pytest.fixture
def server() -> Any:
    server = Server()
    yield server
    server.die()


def test_a_message_of_json_comes_as_bytes_and_goes_out_as_json(server: Server) -> None:
    peer, came = RosbridgePeer(server.address), []
    arrived = threading.Event()
    try:
        peer.subscribe("/joint_states", STATES, lambda raw: (came.append(raw), arrived.set()))
        assert server.wait("subscribe")["type"] == JOINTS
        stamp = {"sec": 5, "nanosec": 7}
        server.send("/joint_states", {"name": ["a"], "position": "no list"})
        server.send(
            "/joint_states",
            {"header": {"stamp": stamp}, "name": ["a"], "position": [0.5], "velocity": [None]},
        )
        assert arrived.wait(30.0)
        message = typestore().deserialize_cdr(came[0], STATES)
        assert (message.name, message.position.tolist()) == (["a"], [0.5])
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (5, 7)
        assert np.isnan(message.velocity).all()
        peer.publish("/back", STATES, came[0], 0)
        assert server.wait("advertise") == {"op": "advertise", "topic": "/back", "type": JOINTS}
        sent = server.wait("publish")["msg"]
        assert (sent["name"], sent["position"], sent["header"]["stamp"]) == (["a"], [0.5], stamp)
    finally:
        peer.close()


def test_a_server_of_ros_1_gets_its_own_names_of_time_and_its_images_come_in_base64(
    server: Server,
) -> None:
    peer, came = RosbridgePeer(server.address), []
    arrived = threading.Semaphore(0)
    try:
        for topic, kind in (
            ("/image", "sensor_msgs/msg/Image"),
            ("/info", "sensor_msgs/msg/CameraInfo"),
        ):
            peer.subscribe(topic, kind, lambda raw: (came.append(raw), arrived.release()))
        server.wait("subscribe")
        header = {"seq": 3, "stamp": {"secs": 5, "nsecs": 7}, "frame_id": "c"}
        pixels = base64.b64encode(bytes([1, 2, 250])).decode()
        server.send(
            "/image", {"header": header, "height": 1, "width": 1, "step": 3, "data": pixels}
        )
        server.send("/info", {"header": header, "K": [1.0] * 9, "height": 1})
        assert arrived.acquire(timeout=30.0)
        assert arrived.acquire(timeout=30.0)
        image, info = (
            typestore().deserialize_cdr(raw, f"sensor_msgs/msg/{kind}")
            for raw, kind in zip(came, ("Image", "CameraInfo"), strict=True)
        )
        assert (image.data.tolist(), image.header.stamp.nanosec, info.k[4]) == ([1, 2, 250], 7, 1.0)
        peer.publish("/back", "sensor_msgs/msg/CameraInfo", came[1], 0)
        assert server.wait("publish")["msg"]["header"]["stamp"] == {"secs": 5, "nsecs": 7}
    finally:
        peer.close()


@pytest.mark.parametrize(
    "address", ["ws://127.0.0.1:1", "ws://127.0.0.1:99999", "ws://a b:9090", "ws://"]
)
def test_no_rosbridge_is_one_line_before_anything_moves(address: str) -> None:
    with pytest.raises(UsageError, match=f"no rosbridge at {address}: "):
        RosbridgePeer(address)


def test_after_a_lost_server_it_subscribes_again_and_sends_nothing_that_waited(
    server: Server,
) -> None:
    peer, arrived = RosbridgePeer(server.address), threading.Event()
    try:
        peer.subscribe("/word", STRING, lambda _raw: arrived.set())
        server.wait("subscribe")
        server.die()
        deadline = time.monotonic() + 30.0
        while peer._socket is not None and time.monotonic() < deadline:
            time.sleep(0.005)
        peer.publish("/back", STRING, coder(STRING).coded({"data": "old"}), 0)
        again = Server(server.port)
        try:
            again.wait("subscribe")
            again.send("/word", {"data": "new"})
            assert arrived.wait(30.0)
            assert not [one for one in again.came if one["op"] == "publish"]
        finally:
            again.die()
    finally:
        peer.close()


class RosbridgeCell:
    """A cell with an arm behind the server, which sends joint states until it dies."""

    def __init__(self, server: Server, folder: Path) -> None:
        self.server, self.over = server, threading.Event()
        (folder / "cell.yaml").write_text(
            f"name: x\nkind: real\ndevices:\n  arm: {{driver: ros2-arm, address: '{server.address}', robot: {ROBOT},\n"
            "    joints: s l e u r b t, lead: 700 ms, silence: 1 s,\n"
            "    supervision: {following_error: 0.5 rad, lag: 1 s, margin: 20 s}}\n"
        )
        self.thread = threading.Thread(target=self.control)
        self.thread.start()
        self.cell = load_cell(folder / "cell.yaml")
        self.arm: Any = self.cell.device(Arm)

    def control(self) -> None:
        while not self.over.wait(0.01):
            now = time.time()
            stamp = {"sec": int(now), "nanosec": int(now % 1.0 * 1e9)}
            position = [1e-6 * (now % 1.0)] * 7
            message = {"header": {"stamp": stamp}, "name": list("sleurbt"), "position": position}
            self.server.send("/joint_states", message)

    def close(self) -> None:
        self.cell.close()
        self.over.set()
        self.thread.join()


@pytest.fixture
def behind(server: Server, tmp_path: Path) -> Any:
    behind = RosbridgeCell(server, tmp_path)
    yield behind
    behind.close()


def test_an_arm_sends_its_path_over_rosbridge(behind: RosbridgeCell) -> None:
    s = np.linspace(0.0, 1.0, 101)[:, None]
    change = np.full(7, 0.05)
    rates = (30 * s**2 - 60 * s**3 + 30 * s**4), (60 * s - 180 * s**2 + 120 * s**3)
    path = change * (10 * s**3 - 15 * s**4 + 6 * s**5), *(change * rate for rate in rates)
    behind.arm.follow(Trajectory(s[:, 0], *path))
    sent = behind.server.wait("publish")
    assert (sent["topic"], sent["msg"]["joint_names"]) == (COMMANDS, list("sleurbt"))
    assert len(sent["msg"]["points"]) > 10


def test_an_arm_is_lost_when_its_server_dies(behind: RosbridgeCell) -> None:
    behind.cell.check()
    behind.server.die()
    deadline = time.monotonic() + 30.0
    while behind.arm.link() == "ok" and time.monotonic() < deadline:
        time.sleep(0.005)
    with pytest.raises(DeviceLost, match="no joints on /joint_states"):
        behind.cell.check()


class FingersCell:
    """A gripper behind an action server: its fingers go to the newest goal at once, until the server dies."""

    def __init__(self, server: Server, folder: Path, settings: str, ros_1: bool = False) -> None:
        self.server, self.over, self.ros_1 = server, threading.Event(), ros_1
        (folder / "cell.yaml").write_text(
            f"name: x\nkind: real\ndevices:\n  gripper: {{driver: ros2-gripper, address: '{server.address}',\n"
            f"    joint: finger, scale: 2, opening: 0 mm..80 mm, action: /hand/gripper_cmd, {settings}}}\n"
        )
        self.thread = threading.Thread(target=self.control)
        self.thread.start()
        self.cell = load_cell(folder / "cell.yaml")
        self.gripper: Any = self.cell.device(Gripper)

    def goals(self) -> list[dict[str, Any]]:
        with self.server.changed:
            if self.ros_1:
                return [one["msg"]["goal"] for one in self.server.came if one["op"] == "publish"]
            return [one["args"] for one in self.server.came if one["op"] == "send_action_goal"]

    def control(self) -> None:
        names = ("secs", "nsecs") if self.ros_1 else ("sec", "nanosec")
        while not self.over.wait(0.005):
            now, goals = time.time(), self.goals()
            stamp = dict(zip(names, (int(now), int(now % 1.0 * 1e9)), strict=True))
            position = goals[-1]["command"]["position"] if goals else 0.03
            message = {
                "header": {"stamp": stamp},
                "name": ["finger"],
                "position": [position + 1e-7 * (now % 1.0)],
            }
            self.server.send("/joint_states", message)

    def close(self) -> None:
        self.cell.close()
        self.over.set()
        self.thread.join()


PATIENT = "silence: 1 s, supervision: {lag: 2 s}"


@pytest.mark.parametrize("ros_1", [False, True])
def test_a_gripper_is_moved_by_goals_of_its_action(
    server: Server, tmp_path: Path, ros_1: bool
) -> None:
    behind = FingersCell(server, tmp_path, PATIENT, ros_1)
    try:
        move, deadline = behind.gripper.move(0.05, 0.05), time.monotonic() + 30.0
        while not move.settled and time.monotonic() < deadline:
            time.sleep(0.005)
        assert (move.state, move.problem) == (MotionState.DONE, "")
        goals = behind.goals()
        assert goals[-1]["command"] == {
            "position": pytest.approx(0.025, abs=1e-3),
            "max_effort": 20.0,
        }
        widths = [2.0 * goal["command"]["position"] for goal in goals]
        assert widths == sorted(
            widths, reverse=True
        )  # it closes, and no goal is farther than the measured opening
        if ros_1:
            (offered,) = [one for one in server.came if one["op"] == "advertise"]
            assert (offered["topic"], offered["type"]) == (
                "/hand/gripper_cmd/goal",
                "control_msgs/GripperCommandActionGoal",
            )
        else:
            assert (
                server.wait("send_action_goal")["action_type"]
                == "control_msgs/action/GripperCommand"
            )
    finally:
        behind.close()


def test_an_action_without_rosbridge_is_refused_with_its_place(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text(
        "name: x\nkind: real\ndevices:\n  gripper:\n    driver: ros2-gripper\n    joint: finger\n"
        "    opening: 0 mm..80 mm\n    action: /hand/gripper_cmd\n"
    )
    with pytest.raises(CellFileError, match=r"(?s):8:13: .*over rosbridge alone"):
        load_cell(tmp_path / "cell.yaml")


@pytest.mark.realtime
def test_a_server_that_dies_is_noticed_within_200_ms(server: Server, tmp_path: Path) -> None:
    behind = FingersCell(server, tmp_path, "supervision: {lag: 2 s}")
    try:
        time.sleep(0.5)
        assert behind.gripper.link() == "ok"
        died = time.monotonic()
        for client in server.clients:
            client.socket.close()
        while behind.gripper.link() == "ok" and time.monotonic() < died + 5.0:
            time.sleep(0.001)
        noticed = time.monotonic() - died
        print(f"noticed after {1e3 * noticed:.0f} ms")
        assert noticed < 0.2
    finally:
        behind.close()
