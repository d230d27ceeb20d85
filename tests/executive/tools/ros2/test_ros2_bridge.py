"""A run on ROS 2: topics, services and the action, from another peer that reads the raw bytes.

Everything stays on this machine: two peers, over TCP on the loopback address.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documented_topics import row_of, rows
from recorded_events import everything, started

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("zenoh", reason="the extra ros2 is not installed")

import zenoh
from rosbags.typesys import Stores, get_typestore

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.running.events import NodeChanged, RunEnded
from pomona.tools.dashboard.control_lock import ControlLock
from pomona.tools.exchange.live import Live
from pomona.tools.ros2.bridge import ABORTED, ACT, CANCELED, EXECUTING, SUCCEEDED, Ros2Bridge
from pomona.tools.ros2.peer import WAITING, Ros2Peer, type_hash
from pomona.tools.ros2.types import coder, service_types, typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
"""Types of ROS 2 as rosbags ships them: nothing of ours."""
TOKEN = "the token"


class Listening:
    """A peer that knows only Zenoh, key expressions and rosbags' types."""

    def __init__(self, port: int) -> None:
        config = zenoh.Config()
        connect, listen = f'["tcp/127.0.0.1:{port}"]', '["tcp/127.0.0.1:0"]'
        settings = {"mode": '"peer"', "connect/endpoints": connect, "listen/endpoints": listen}
        for key, value in {**settings, "scouting/multicast/enabled": "false"}.items():
            config.insert_json5(key, value)
        self.session = zenoh.open(config)
        self.got: dict[str, list[tuple[str, bytes, bytes]]] = {}
        self._arrived = threading.Condition()
        self._subscriber = self.session.declare_subscriber("0/**", self._take)

    def _take(self, sample: Any) -> None:
        _domain, *name, kind, digest = str(sample.key_expr).split("/")
        package, group, _dds, last = kind.split("::")
        assert digest.startswith("RIHS01_")
        with self._arrived:
            found = self.got.setdefault("/" + "/".join(name), [])
            found.append(
                (
                    f"{package}/{group}/{last[:-1]}",
                    sample.payload.to_bytes(),
                    sample.attachment.to_bytes(),
                )
            )
            self._arrived.notify_all()

    def wait(self, done: Callable[[], bool], seconds: float = 60.0) -> None:
        with self._arrived:
            assert self._arrived.wait_for(done, seconds), sorted(self.got)

    def messages(self, topic: str, count: int = 1) -> list[Any]:
        self.wait(lambda: len(self.got.get(topic, [])) >= count)
        store = STORE if self.got[topic][0][0] in STORE.fielddefs else typestore()
        return [store.deserialize_cdr(raw, kind) for kind, raw, _attachment in self.got[topic]]


class Robot:
    """A recorder of the actions of control."""

    def __init__(self) -> None:
        self.told: list[tuple[object, ...]] = []
        self.latched: str | None = None
        self.state = type("State", (), {"ended": False})()

    def note(self, who: str, action: str) -> None:
        self.told.append((action, who))

    def safe_stop(self, reason: str, who: str) -> None:
        self.latched = reason
        self.told.append(("safe_stop", who))

    def __getattr__(self, action: str) -> Any:
        return lambda *what: self.told.append((action, *what))


def free_port() -> int:
    import socket

    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Setting:
    def __init__(self) -> None:
        port = free_port()
        self.peer = Ros2Peer(f"127.0.0.1:{port}")
        self.control, self.robot = ControlLock(), Robot()
        self.forms: list[dict[str, Any]] = []
        self.bridge = Ros2Bridge(self.peer, self.control, lambda token: token == TOKEN, self.start)
        self.live = Live(self.bridge)
        self.listening = Listening(port)
        self.client = Ros2Peer(f"127.0.0.1:{port}", node="client")
        for _ in range(3000):  # until both know one another
            self.peer.publish("/ping", "std_msgs/msg/String", b"\0\1\0\0\1\0\0\0\0", 0)
            if "/ping" in self.listening.got:
                break
            time.sleep(0.02)

    def start(self, form: dict[str, Any]) -> str:
        if form["tree"] == "wrong":
            raise UsageError("no tree 'wrong'")
        if form["tree"] == "broken":
            raise OSError("the disk is gone")
        self.forms.append(form)
        self.control.serve(self.robot)  # type: ignore[arg-type]
        return str(form["tree"])

    def ask(
        self, action: str, who: str = "anna", token: str = TOKEN, detail: str = ""
    ) -> tuple[bool, str]:
        answer = self.client.call(
            f"/pomona/{action}", ACT, {"token": token, "who": who, "detail": detail}
        )
        return answer.success, answer.message

    def close(self) -> None:
        self.live.close()
        self.client.close()
        self.listening.session.close()


@pytest.fixture
def setting() -> Iterator[Setting]:
    setting = Setting()
    yield setting
    setting.close()


def test_an_independent_reader_gets_types_and_values_of_everything(setting: Setting) -> None:
    for event in everything():
        setting.live.on_event(event)
    setting.live.read(
        0.8, 12, {"arm": {"stamp_s": np.array([0.1, 0.2]), "q_1_rad": np.array([0.0, 0.5])}}
    )
    heard = setting.listening
    joints = heard.messages("/joint_states", 2)
    assert [joint.position.tolist() for joint in joints] == [[0.0], [0.5]]
    view = next(e.value for e in everything() if getattr(e, "topic", "") == "detection")
    (image,) = heard.messages("/camera/detection/image_raw")
    assert (image.encoding, image.header.frame_id, image.header.stamp.sec) == (
        "rgb8",
        "camera/detection",
        10**9,
    )
    assert np.array_equal(image.data.reshape(48, 64, 3), view.image)
    (depth,) = heard.messages("/camera/detection/depth/image_raw")
    assert depth.encoding == "32FC1"
    metres = depth.data.view(np.float32).reshape(48, 64)
    assert np.array_equal(metres[1:], view.depth[1:])
    assert metres[0, 0] == 0.0  # it was not a number
    (info,) = heard.messages("/camera/detection/camera_info")
    assert info.k[0] == 60.0
    for topic, kind in (
        ("/tf", "tf2_msgs/msg/TFMessage"),
        ("/pomona/points/path/left_to_try", "sensor_msgs/msg/PointCloud2"),
        ("/pomona/path/path/planned_path", "nav_msgs/msg/Path"),
        ("/pomona/path/executed", "nav_msgs/msg/Path"),
        ("/pomona/tree", "pomona_msgs/msg/TreeStatus"),
        ("/pomona/snapshots", "py_trees_ros_interfaces/msg/BehaviourTree"),
        ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
        ("/rosout", "rcl_interfaces/msg/Log"),
    ):
        assert heard.messages(topic)
        assert heard.got[topic][0][0] == kind
    live = {
        "/camera/detection/image_raw": "/camera/NAME/depth/image_raw"
    }  # not in bags, so in no row
    for topic, ((kind, _raw, _attachment), *_more) in heard.got.items():
        assert topic == "/ping" or kind in rows()[live.get(topic) or row_of(topic)], topic
    numbers = [
        int.from_bytes(attachment[:8], "little") for _kind, _raw, attachment in heard.got["/tf"]
    ]
    assert numbers == list(range(1, len(numbers) + 1))


def test_others_see_the_node_its_topics_and_services(setting: Setting) -> None:
    setting.live.on_event(started())
    setting.listening.messages("/pomona/events")
    tokens = [
        str(reply.ok.key_expr)
        for reply in setting.listening.session.liveliness().get("@ros2_lv/**")
    ]
    ours = [token for token in tokens if token.split("/")[8] == "pomona"]
    kinds = {token.split("/")[5] for token in ours}
    assert kinds == {"NN", "MP", "SS"}
    said = [token.split("/")[9:12] for token in ours if "/MP/" in token]
    assert [
        "%pomona%events",
        "std_msgs::msg::dds_::String_",
        STORE.hash_rihs01("std_msgs/msg/String"),
    ] in said
    assert type_hash("sensor_msgs/msg/Image") == STORE.hash_rihs01("sensor_msgs/msg/Image")


def test_hashes_are_those_that_rmw_zenoh_publishes() -> None:
    """The two that its design document has as examples: of a message and of a service."""
    add = "example_interfaces/srv/AddTwoInts"
    typestore().register(service_types(add, "int64 a\nint64 b\n", "int64 sum\n"))
    assert (
        type_hash(add) == "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
    )
    assert type_hash("std_msgs/msg/String") == (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )


def test_acting_needs_the_token_and_control_and_anybody_with_the_token_stops(
    setting: Setting,
) -> None:
    setting.control.serve(setting.robot)  # type: ignore[arg-type]
    assert setting.ask("pause", token="guessed") == (
        False, "actions need the token that Pomona printed on this machine at the start"
    )  # fmt: skip
    assert setting.ask("pause") == (False, "no operator holds control; take it first")
    assert setting.ask("take")[0]
    assert setting.ask("pause")[0]
    assert setting.ask("resume", detail="3")[0]  # the number of the pause, as /pomona/tree has it
    assert setting.ask("step")[0]
    assert setting.ask("resume", who="bert") == (False, "anna holds control; take it first")
    assert setting.ask("safe_stop", who="bert") == (True, "safe state: safe stop by bert")
    assert not setting.ask("safe_stop", who="eve", token="")[0]
    assert setting.robot.told == [
        ("take", "anna"), ("pause", "anna"), ("resume", 3, "anna"), ("step", 0, "anna"), ("safe_stop", "bert")
    ]  # fmt: skip


def goal(setting: Setting, number: int, **fields: Any) -> Any:
    asked = {
        "goal_id": {"uuid": bytes([number] * 16)},
        "goal": {"token": TOKEN, "who": "anna", **fields},
    }
    kind = "pomona_msgs/action/RunTree_SendGoal"
    return setting.client.call("/pomona/run_tree/_action/send_goal", kind, asked)


def result(setting: Setting, number: int) -> Any:
    asked = {"goal_id": {"uuid": bytes([number] * 16)}}
    kind = "pomona_msgs/action/RunTree_GetResult"
    return setting.client.call("/pomona/run_tree/_action/get_result", kind, asked)


def test_an_action_runs_a_tree_with_parameters_feedback_result_and_cancel(setting: Setting) -> None:
    assert not goal(setting, 1, tree="pick", token="guessed").accepted
    assert not goal(setting, 1, tree="wrong").accepted
    assert goal(setting, 1, tree="pick", seed=7, names=["fruit"], values=["apple_5"]).accepted
    (form,) = setting.forms
    assert (form["tree"], form["seed"], form["settings"]) == ("pick", 7, {"fruit": "apple_5"})
    assert not goal(setting, 2, tree="pick").accepted  # one at a time
    answers: list[Any] = []
    waiting = threading.Thread(target=lambda: answers.append(result(setting, 1)))
    waiting.start()
    setting.live.on_event(started())
    setting.live.on_event(NodeChanged(0.5, 25, "a/Plan", "RUNNING", "3 tries", 1))
    setting.live.on_event(RunEnded(1.5, 75, "success", None, 75, 1.5, 0.2, None))
    waiting.join(5.0)
    assert (answers[0].status, answers[0].result.outcome, answers[0].result.time) == (
        SUCCEEDED,
        "success",
        1.5,
    )
    (told,) = setting.listening.messages("/pomona/run_tree/_action/feedback")
    assert (told.feedback.node, told.feedback.feedback, told.goal_id.uuid.tolist()) == (
        "a/Plan",
        "3 tries",
        [1] * 16,
    )
    states = setting.listening.messages("/pomona/run_tree/_action/status", 2)
    assert [state.status_list[0].status for state in states] == [EXECUTING, SUCCEEDED]

    assert goal(setting, 3, tree="pick").accepted
    asked = {"goal_info": {"goal_id": {"uuid": bytes([3] * 16)}}}
    cancel = setting.client.call(
        "/pomona/run_tree/_action/cancel_goal", "action_msgs/srv/CancelGoal", asked
    )
    assert (cancel.return_code, len(cancel.goals_canceling)) == (0, 1)
    assert setting.robot.told[-1] == ("stop", "anna")
    setting.live.on_event(
        RunEnded(0.5, 25, "success", None, 25, 0.5, 0.2, None)
    )  # late words of the run before
    setting.live.on_event(started())
    setting.live.on_event(RunEnded(0.5, 25, "stopped", None, 25, 0.5, 0.2, None))
    assert result(setting, 3).status == CANCELED
    assert goal(setting, 4, tree="pick").accepted
    setting.control.prepare("pick")
    setting.control.clear("the cell cannot be reached")
    assert (result(setting, 4).status, result(setting, 4).result.reason) == (
        ABORTED,
        "the cell cannot be reached",
    )


def test_a_refused_goal_takes_control_from_no_operator(setting: Setting) -> None:
    assert setting.ask("take", "bert")[0]
    uneven = {"names": ["fruit", "place"], "values": ["apple_5"]}
    twice = {"names": ["fruit", "fruit"], "values": ["apple_1", "apple_2"]}
    for wrong in (
        {"tree": "wrong"},
        {"tree": "broken"},
        {"tree": "pick", **uneven},
        {"tree": "pick", **twice},
    ):
        assert not goal(setting, 1, **wrong).accepted
    assert setting.control.holder.who == "bert"
    said = [log.msg for log in setting.listening.messages("/rosout", 4)]
    assert "each name needs its value: there are 2 names and 1 values" in said[2]
    assert "a name comes twice: fruit, fruit" in said[3]
    assert (setting.forms, result(setting, 1).status) == ([], 0)
    assert goal(setting, 1, tree="pick").accepted
    assert setting.control.holder.who == "anna"


def test_a_goal_is_cancelled_while_its_run_is_prepared_and_stopped_by_others_it_is_aborted(
    setting: Setting,
) -> None:
    starting = []

    def start(form: dict[str, Any]) -> str:
        starting.append(setting.control.prepare("pick"))
        return "pick"

    setting.bridge._start = start
    assert goal(setting, 1, tree="pick").accepted
    asked = {"goal_info": {"goal_id": {"uuid": bytes([1] * 16)}}}
    cancel = "/pomona/run_tree/_action/cancel_goal"
    assert setting.client.call(cancel, "action_msgs/srv/CancelGoal", asked).return_code == 0
    assert starting[0].cancelled == "cancelled by anna"
    setting.control.clear("cancelled by anna")
    assert (result(setting, 1).status, result(setting, 1).result.outcome) == (CANCELED, "stopped")
    assert (
        setting.client.call(cancel, "action_msgs/srv/CancelGoal", asked).return_code == 3
    )  # it is over

    assert goal(setting, 2, tree="pick").accepted
    assert setting.ask("take", "bert")[0]
    asked = {"goal_info": {"goal_id": {"uuid": bytes([2] * 16)}}}
    assert (
        setting.client.call(cancel, "action_msgs/srv/CancelGoal", asked).return_code == 1
    )  # bert has control
    setting.live.on_event(started())
    setting.live.on_event(RunEnded(0.5, 25, "stopped", None, 25, 0.5, 0.2, None))
    assert (result(setting, 2).status, result(setting, 2).result.outcome) == (ABORTED, "stopped")


def test_names_of_operators_are_as_long_and_as_plain_as_on_the_page(setting: Setting) -> None:
    assert setting.ask("take", "\x1b[31m" + "x" * 100_000)[0]
    assert setting.control.holder.who == "[31m" + "x" * 56
    assert setting.ask("take", "\n\x1b") == (False, "the operator's name is missing")


def test_a_flood_of_requests_is_refused_at_once_and_a_safe_stop_is_taken_beside_it(
    setting: Setting,
) -> None:
    hold, key = threading.Event(), f"0/slow/pomona_msgs::srv::dds_::Act_/{type_hash(ACT)}"

    def slow(_asked: Any, reply: Any) -> None:
        assert hold.wait(60.0)
        reply({"success": True})

    def wrong(_asked: Any, _reply: Any) -> None:
        raise OSError("nobody thought of this")

    setting.peer.serve("/slow", ACT, slow)
    setting.peer.serve("/wrong", ACT, wrong)
    coded, attachment = bytes(coder(f"{ACT}_Request").coded({})), bytes(17)
    session = setting.listening.session
    flood = [
        session.get(key, payload=coded, attachment=attachment, timeout=60.0)
        for _ in range(WAITING + 30)
    ]
    assert setting.ask("safe_stop")[0]
    with pytest.raises(TimeoutError):
        setting.client.call("/wrong", ACT, {})
    (last,) = session.get(key, payload=coded, attachment=attachment, timeout=60.0)
    assert (
        last.ok is None
    )  # requests come in their order, so the flood is in before the first one is answered
    hold.set()
    answers = [reply.ok is not None for replies in flood for reply in replies]
    assert (answers.count(True), answers.count(False)) == (WAITING, 30)


def test_an_invalid_request_gets_an_error_and_harms_nothing(setting: Setting) -> None:
    key = f"0/pomona/safe_stop/pomona_msgs::srv::dds_::Act_/{type_hash(ACT)}"
    for payload in (b"", b"\0\1\0\0\xff\xff\xff\xff", bytes(1000)):
        replies = list(
            setting.listening.session.get(key, payload=payload, attachment=b"x", timeout=2.0)
        )
        assert all(reply.ok is None for reply in replies)
    assert setting.ask("take")[0]


def test_bound_elsewhere_no_viewer_acts_and_an_unusable_address_is_refused() -> None:
    class Elsewhere:
        local = False

        def serve(self, *_arguments: Any) -> None: ...

    bridge = Ros2Bridge(Elsewhere(), ControlLock(), lambda _token: True)  # type: ignore[arg-type]
    asked = type("Asked", (), {"token": TOKEN, "who": "anna", "detail": ""})()
    assert not bridge._act("safe_stop", asked)["success"]
    for address in ("7447", "127.0.0.1:port", ":7447", "127.0.0.1:0"):
        with pytest.raises(UsageError, match="is no address"):
            Ros2Peer(address)


def test_an_address_without_a_ros_2_peer_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import socket

    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree.yaml").write_text("pomona: 1\ntree: rest\nroot:\n  wait: 100 ms\n")
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()  # and never says a word
        address = f"127.0.0.1:{other.getsockname()[1]}"
        assert main(["run", "tree.yaml", "--dry", "--quiet", "--ros2", address]) == 2
        assert f"no ROS 2 at {address}: " in capsys.readouterr().err


def test_a_peer_that_joined_a_router_finds_it_again() -> None:
    port = free_port()
    router, got = Ros2Peer(f"127.0.0.1:{port}"), threading.Event()
    client = Ros2Peer(f"127.0.0.1:{port}", insist=True)
    router.close()
    again = Ros2Peer(f"127.0.0.1:{port}")
    try:
        client.subscribe("/ping", "std_msgs/msg/String", lambda _raw: got.set())
        for _ in range(600):
            again.publish("/ping", "std_msgs/msg/String", b"\0\1\0\0\1\0\0\0\0", 0)
            if got.wait(0.05):
                break
        assert got.is_set()
    finally:
        client.close()
        again.close()


def test_a_run_speaks_ros_2_when_it_is_asked_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree.yaml").write_text("pomona: 1\ntree: rest\nroot:\n  wait: 100 ms\n")
    assert main(["run", "tree.yaml", "--dry", "--ros2", f"127.0.0.1:{free_port()}"]) == 0
    assert "requests of nodes need the page" in capsys.readouterr().out
    assert main(["run", "tree.yaml", "--dry", "--quiet", "--ros2", "nowhere"]) == 2
    assert "HOST:PORT" in capsys.readouterr().err


@pytest.mark.parametrize("version", ["TypeHashNotSupported", "RIHS01_0"])
def test_a_peer_of_humble_hears_messages_of_every_version_and_is_heard_by_nodes_without_hashes(
    version: str,
) -> None:
    port, key = free_port(), "0/{}/std_msgs::msg::dds_::String_/{}"
    peer = Ros2Peer(f"127.0.0.1:{port}", distribution="humble")
    other = Ros2Peer(f"127.0.0.1:{port}", node="humble")
    came, heard = threading.Event(), threading.Event()
    try:
        peer.subscribe("/to_us", "std_msgs/msg/String", lambda _raw: came.set())
        there = other._session.declare_publisher(key.format("to_us", version))
        held = other._session.declare_subscriber(
            key.format("from_us", "TypeHashNotSupported"), lambda _: heard.set()
        )
        for _ in range(600):
            there.put(b"\0\1\0\0\1\0\0\0\0")
            peer.publish("/from_us", "std_msgs/msg/String", b"\0\1\0\0\1\0\0\0\0", 0)
            if came.wait(0.05) and heard.wait(0.05):
                break
        assert came.is_set()
        assert heard.is_set()
        held.undeclare()
    finally:
        other.close()
        peer.close()
