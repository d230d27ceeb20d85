"""A record as a bag: read by rosbags' reader, and by a decoder of other people that knows only the file."""

from __future__ import annotations

import base64
import re
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from documented_topics import definitions, row_of, rows
from recorded_events import contents, everything, record, write

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("mcap_ros2", reason="mcap-ros2-support is not installed")

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import DEVICES, EVENTS_FILE
from pomona.executive.recording.read import decode_image
from pomona.executive.values.installation import install_extra
from pomona.tools.ros2.definitions import ACTIONS, POMONA, SERVICES
from pomona.tools.ros2.rosbag2 import export_rosbag2
from pomona.tools.ros2.to_ros2 import RosMessage, ToRos2
from pomona.tools.ros2.types import coder, typestore

BEGAN = 10**18
"""Nanoseconds since 1970 when the recorded run began."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("record")
    path = record(folder, everything())
    export_rosbag2(folder, folder / "bag")
    return path, folder / "bag"


@pytest.fixture(scope="module")
def messages(made: tuple[Path, Path]) -> dict[str, list[Any]]:
    """Every message of the bag by its topic, as rosbags decodes it: the bag's times are the headers'."""
    found: dict[str, list[Any]] = {}
    with AnyReader([made[1]]) as reader:
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if hasattr(message, "header"):
                assert stamp == message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            found.setdefault(connection.topic, []).append(message)
        assert sum(map(len, found.values())) == reader.message_count
    return found


def recorded(made: tuple[Path, Path], topic: str) -> list[dict[str, Any]]:
    return [content for name, _schema, _json, content in contents(made[0]) if name == topic]


def same(one: Any, other: Any) -> bool:
    """Whether two decoders read the same, field by field."""
    if is_dataclass(one):
        told = [f.name for f in fields(one) if f.name.islower() and f.name != "__msgtype__"]
        return all(same(getattr(one, name), getattr(other, name)) for name in told)
    if isinstance(one, np.ndarray):
        return np.array_equal(
            one, np.frombuffer(other, one.dtype) if isinstance(other, bytes) else other
        )
    if isinstance(one, list):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other, strict=True))
    return bool(one == other)


def test_another_decoder_reads_the_same_from_the_file_alone(made: tuple[Path, Path]) -> None:
    count = 0
    with AnyReader([made[1]]) as reader, (made[1] / "bag.mcap").open("rb") as stream:
        theirs = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert theirs.get_header().profile == "ros2"
        ours = sorted(reader.messages(), key=lambda found: (found[1], found[0].topic))
        others = sorted(
            theirs.iter_decoded_messages(), key=lambda found: (found[2].log_time, found[1].topic)
        )
        for (connection, stamp, raw), (schema, channel, message, decoded) in zip(
            ours, others, strict=True
        ):
            assert (connection.topic, connection.msgtype, stamp) == (
                channel.topic,
                schema.name,
                message.log_time,
            )
            assert same(reader.deserialize(raw, connection.msgtype), decoded), connection.topic
            count += 1
    assert count > 30


def test_joints_have_their_own_times_and_values(messages: dict[str, list[Any]]) -> None:
    first, second = messages["/joint_states"]
    assert (first.name, second.name) == (["arm_joint_1"], ["arm_joint_1"])
    assert (first.position.tolist(), second.position.tolist()) == ([0.0], [0.5])
    assert (
        first.velocity.tolist() == second.velocity.tolist() == []
    )  # this record is of a version without
    assert second.header.stamp.sec * 10**9 + second.header.stamp.nanosec == BEGAN + 800_000_000
    assert second.header.stamp.nanosec - first.header.stamp.nanosec == 100_000_000


def test_images_are_the_recorded_bytes_and_depth_the_recorded_millimetres(
    made: tuple[Path, Path], messages: dict[str, list[Any]]
) -> None:
    (image,) = messages["/camera/detection/image/compressed"]
    (was,) = recorded(made, "/images/detection")
    assert image.data.tobytes() == base64.b64decode(was["data"])
    assert (image.format, image.header.frame_id) == ("jpeg", "camera/detection")
    (depth,) = messages["/camera/detection/depth/image_raw"]
    (was,) = recorded(made, "/depth/detection")
    assert (depth.encoding, depth.height, depth.width, depth.step) == ("16UC1", 48, 64, 128)
    assert np.array_equal(depth.data.view(np.uint16).reshape(48, 64), decode_image(was["data"]))
    (info,) = messages["/camera/detection/camera_info"]
    (was,) = recorded(made, "/calibration/detection")
    assert info.k.tolist() == was["K"]
    assert info.p.tolist() == was["P"]
    assert (info.width, info.height) == (64, 48)


def test_transforms_poses_clouds_and_scenes_are_the_recorded_values(
    made: tuple[Path, Path], messages: dict[str, list[Any]]
) -> None:
    for bag, was in zip(messages["/tf"], recorded(made, "/tf"), strict=True):
        for got, expected in zip(bag.transforms, was["transforms"], strict=True):
            assert (got.header.frame_id, got.child_frame_id) == (
                expected["parent_frame_id"],
                expected["child_frame_id"],
            )
            turn, place = got.transform.rotation, got.transform.translation
            assert {name: getattr(turn, name) for name in "xyzw"} == expected["rotation"]
            assert {name: getattr(place, name) for name in "xyz"} == expected["translation"]
    (pose,) = messages["/pomona/poses/detection/camera"]
    turn = pose.pose.orientation
    assert Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_euler("xyz")[2] == pytest.approx(
        0.2
    )
    (cloud,) = messages["/pomona/points/path/left_to_try"]
    assert np.array_equal(
        cloud.data.view(np.float32).reshape(-1, cloud.point_step // 4)[:, :3], np.eye(3)
    )
    (scene,) = messages["/pomona/scene/path"]
    assert [marker.type for marker in scene.markers] == [4, 11]
    (path,) = messages["/pomona/path/path/planned_path"]
    assert [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for p in path.poses] == [
        (1, 0, 0),
        (0, 1, 0),
        (0, 0, 1),
    ]
    assert [point.point.x for point in messages["/pomona/tcp"]] == [0.0]


def test_joints_have_the_recorded_velocities() -> None:
    values = {
        "q_1_rad": [0.0, 0.5],
        "q_2_rad": [1.0, 1.0],
        "qd_1_rad_per_s": [4.0, 5.0],
        "qd_2_rad_per_s": [0.0, 0.1],
    }
    told = ToRos2().messages(
        f"{DEVICES}arm", {"t": 1.0, "tick": 5, "stamp_s": [0.1, 0.2], **values}, 10**9
    )
    fields = [message.fields for message in told]
    assert [(list(f["position"]), list(f["velocity"])) for f in fields] == [
        ([0, 1], [4, 0]),
        ([0.5, 1], [5, 0.1]),
    ]
    assert fields[0]["name"] == ["arm_joint_1", "arm_joint_2"]


def test_the_tree_diagnostics_log_and_events_are_published(
    made: tuple[Path, Path], messages: dict[str, list[Any]]
) -> None:
    last = messages["/pomona/tree"][-1]
    (node,) = last.nodes
    assert (last.run, last.tree, last.state, last.tick) == ("one", "pick", "running", 12)
    assert (node.path, node.status, node.code, node.reason) == (
        "a/Plan",
        "FAILURE",
        "NO_PATH",
        "there is no path",
    )
    assert [b.status for b in messages["/pomona/snapshots"][-1].behaviours] == [4]
    assert [(d.status[0].name, d.status[0].level) for d in messages["/diagnostics"]] == [
        ("pomona: arm", 2),
        ("pomona: run", 2),
    ]
    assert [m.msg for m in messages["/rosout"]] == [m["message"] for m in recorded(made, "/log")]
    assert len(messages["/pomona/events"]) == len(recorded(made, "/events"))
    assert [(s.names, s.values.tolist()) for s in messages["/pomona/series/grip"]] == [
        (["slip_speed_m_per_s"], [0.1]),
        ([], []),
    ]


def test_every_topic_of_a_bag_has_the_type_that_the_docs_say(made: tuple[Path, Path]) -> None:
    with AnyReader([made[1]]) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
    assert [topic for topic, kind in kinds.items() if kind not in rows()[row_of(topic)]] == []
    kinds |= {message.topic: message.type for message in wrenches()}
    assert rows().keys() - {row_of(topic) for topic in kinds} == set()


def wrenches() -> list[RosMessage]:
    """Two samples of one finger, the second 2 ms after the first."""
    parts = ("force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm")
    values = {f"finger_2_{part}": np.array([k, 10.0 + k]) for k, part in enumerate(parts)}
    return list(
        ToRos2().messages(
            f"{DEVICES}fingers", {"t": 1.0, "tick": 5, "stamp_s": [0.1, 0.102], **values}, 10**9
        )
    )


def test_a_finger_s_wrench_has_newtons_and_newton_metres_in_its_pad_s_frame_at_their_times() -> (
    None
):
    assert {(m.topic, m.type) for m in wrenches()} == {
        ("/fingers/finger_2/wrench", "geometry_msgs/msg/WrenchStamped")
    }
    assert [m.stamp for m in wrenches()] == [998_000_000, 10**9]
    for before, message in zip((0.0, 10.0), wrenches(), strict=True):
        assert message.fields["header"]["frame_id"] == "fingers/finger_2"
        wrench = message.fields["wrench"]
        assert [wrench[kind][axis] - before for kind in ("force", "torque") for axis in "xyz"] == [
            0,
            1,
            2,
            3,
            4,
            5,
        ]


def test_our_messages_are_those_that_the_docs_define() -> None:
    action = "pomona_msgs/action/RunTree"
    ours = {
        **POMONA,
        **{name: "---\n".join(SERVICES[name]) for name in ("pomona_msgs/srv/Act",)},
        action: "---\n".join(
            ACTIONS[f"{action}_{part}"] for part in ("Goal", "Result", "Feedback")
        ),
    }
    assert definitions() == ours


def test_a_field_left_out_of_a_message_is_zero_and_an_unknown_one_is_refused() -> None:
    message = coder("sensor_msgs/msg/CameraInfo").message({"width": 3})
    assert (message.width, message.height, message.k.tolist(), message.header.frame_id) == (
        3,
        0,
        [0.0] * 9,
        "",
    )
    with pytest.raises(KeyError, match="widht"):
        coder("sensor_msgs/msg/CameraInfo").message({"widht": 3})
    assert "pomona_msgs/msg/TreeStatus" in typestore().fielddefs


def test_a_folder_that_is_there_is_left_alone_and_half_a_bag_is_left_nowhere(
    made: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = tmp_path / "bag"
    there.mkdir()
    (there / "mine").write_text("mine")
    assert main(["runs", "export", str(made[0].parent), str(there), "--to", "rosbag2"]) == 2
    assert "exists, and nothing" in capsys.readouterr().err
    assert [path.name for path in there.iterdir()] == ["mine"]

    damaged = write(tmp_path / "damaged", tuple(everything()))
    content = bytearray((damaged / EVENTS_FILE).read_bytes())
    content[len(content) // 2] ^= 0xFF
    (damaged / EVENTS_FILE).write_bytes(bytes(content))
    with pytest.raises(UsageError, match="damaged"):
        export_rosbag2(damaged, tmp_path / "other")
    with pytest.raises(UsageError, match=r"Not a directory|File exists"):
        export_rosbag2(made[0].parent, there / "mine" / "bag")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "damaged"]


def test_without_the_extra_it_names_the_command_to_install_it(
    made: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rosbags.rosbag2", None)
    with pytest.raises(UsageError, match=re.escape(install_extra("ros2"))):
        export_rosbag2(made[0].parent, tmp_path / "bag")
