"""Events with everything in them that a record can hold, and small records to list, find and take apart."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType
from scipy.spatial.transform import Rotation

from pomona.executive.encode import encoded
from pomona.executive.reasons import Reason
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.message import message_of
from pomona.executive.recording.recorder import Recorder, new_writer
from pomona.executive.running.events import (
    AttemptEnded,
    Event,
    LinkChanged,
    NodeChanged,
    OperatorActed,
    PortWritten,
    Published,
    RunEnded,
    RunStarted,
    SafeStopped,
    StateChanged,
)
from pomona.executive.views import (
    BodiesView,
    ImageView,
    Line3,
    Mesh3,
    Pinhole,
    Points3,
    PosesView,
    SceneView,
    SeriesView,
)

TRIANGLE = Mesh3(np.eye(3), np.array([[0, 1, 2]], np.int32), "forearm")
REASON = Reason("a/Plan", "NO_PATH", "there is no path", {"tries": 3})


@dataclass(frozen=True)
class Candidate:
    T_base_grasp: np.ndarray[Any, Any]


@dataclass(frozen=True)
class Measured:
    T_base_camera: np.ndarray[Any, Any]
    T_camera_object: np.ndarray[Any, Any]
    T_mount_camera: np.ndarray[Any, Any]
    candidates: tuple[Candidate, ...]


def pose(x: float, turn: float = 0.0) -> np.ndarray[Any, Any]:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("z", turn).as_matrix()
    T[0, 3] = x
    return T


def started(**changes: Any) -> RunStarted:
    about: dict[str, Any] = {
        "run": "one", "tree": "pick", "tree_path": "pick.yaml", "tree_text": "pomona: 1\n", "tree_hash": "abc",
        "cell": "sim", "cell_kind": "simulated", "cell_path": "sim.yaml", "cell_text": "name: sim\n", "seed": 3,
        "parameters": {"height": 0.15}, "nodes": (), "versions": {"git": "0123abc", "pomona": "1"}, "wall_time": 1e9,
        "period": 0.02, "settings": {"fruit": "apple_5"}, "tree_files": {"look.yaml": "pomona: 1\ntree: look\n"},
    }  # fmt: skip
    return RunStarted(0.0, 0, **(about | changes))


def everything() -> list[Event]:
    image = np.full((48, 64, 3), (200, 40, 30), np.uint8)
    depth = np.full((48, 64), 0.7504, np.float32)
    depth[0, 0] = np.nan
    view = ImageView(image, depth=depth, pinhole=Pinhole(60.0, 61.0, 31.5, 23.5, pose(0.3)))
    value = Measured(
        pose(0.5, 0.2), pose(0.4, -0.1), pose(1.0), (Candidate(pose(0.1)), Candidate(pose(0.2)))
    )
    scene = SceneView(
        (Line3(np.eye(3), "planned path"),),
        (Points3(np.eye(3), "left to try"),),
        (TRIANGLE,),
        "path",
    )
    slip = SeriesView(np.array([0.5, 0.6]), {"slip speed [m/s]": np.array([0.1, np.nan])})
    return [
        started(),
        StateChanged(0.0, 0, "running", "started"),
        Published(0.1, 5, "", "robot", BodiesView((TRIANGLE,))),
        Published(0.1, 5, "", "robot", PosesView(np.array([[0.1, 0.2, 0.3, 0, 0, 0, 1.0]]), np.zeros(3))),
        Published(0.2, 6, "a/Detect", "detection", view),
        PortWritten(0.3, 7, "/perceive/detection", value, "a/Detect", "an apple"),
        Published(0.4, 8, "a/Plan", "path", scene),
        Published(0.5, 9, "a/Grip", "grip", slip),
        NodeChanged(0.6, 10, "a/Plan", "FAILURE", "no path", 1, REASON),
        AttemptEnded(0.6, 10, "a", 1, 3, False, REASON),
        LinkChanged(0.7, 11, "arm", "no answer for 0.5 s"),
        OperatorActed(0.7, 11, "anna", "stop"),
        SafeStopped(0.8, 12, "stopped"),
        RunEnded(0.8, 12, "failure", REASON, 12, 0.8, 1.0, {"T_base_fruit": pose(0.9), "lifted": False}),
    ]  # fmt: skip


def record(folder: Path, events: list[Event]) -> Path:
    recorder = Recorder(folder)
    for event in events:
        recorder.on_event(event)
    recorder.read(
        0.8, 12, {"arm": {"stamp_s": np.array([0.1, 0.2]), "q_1_rad": np.array([0.0, 0.5])}}
    )
    recorder.close()
    assert recorder.problem == ""
    return folder / EVENTS_FILE


def contents(path: Path) -> list[tuple[str, str, dict[str, Any], dict[str, Any]]]:
    """Topic, schema's name, schema, content, as any reader of MCAP files sees them."""
    with path.open("rb") as stream:
        return [
            (channel.topic, schema.name, json.loads(schema.data), json.loads(message.data))
            for schema, channel, message in make_reader(stream).iter_messages()
            if schema is not None
        ]


FAILED: tuple[Event, ...] = (
    started(run="failed", settings={"fruit": "apple_5"}),
    NodeChanged(0.5, 25, "a/Plan", "FAILURE", "no path", 1, REASON),
    AttemptEnded(0.5, 25, "a", 1, 2, False, REASON),
    NodeChanged(0.9, 45, "a/Plan", "FAILURE", "no path", 2, REASON),
    RunEnded(1.0, 50, "failure", REASON, 50, 1.0, 2.0, {"lifted": False}, {"count": 2}),
)
SUCCEEDED: tuple[Event, ...] = (started(), RunEnded(1.5, 75, "success", None, 75, 1.5, 0.2, None))


def write(folder: Path, events: tuple[Event, ...]) -> Path:
    folder.mkdir(parents=True)
    recorder = Recorder(folder)
    for event in events:
        recorder.on_event(event)
    recorder.close()
    return folder


def foreign(folder: Path, *events: bytes) -> Path:
    """Write a record with correct checksums and arbitrary events."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / EVENTS_FILE).open("wb") as stream:
        writer = new_writer(stream, CompressionType.NONE)
        writer.start(profile="pomona", library="pomona")
        channel = writer.register_channel("/events", "json", 0)
        for event in events:
            writer.add_message(channel, 0, event, 0)
        writer.finish()
    return folder


def nested(depth: int) -> bytes:
    """A failure with causes within causes."""
    opening = b'{"node_path":"a","code":"X","message":"","data":{},"causes":['
    return (
        b'{"event":"NodeChanged","t":0,"tick":0,"path":"a","status":"FAILURE","feedback":"","starts":1,"reason":'
        + opening * depth
        + b"]}" * depth
        + b"}"
    )


_STARTED = encoded(
    message_of(started(nodes=({"path": "a", "parent": None, "name": "a", "type": "sequence"},)))
)
HOSTILE: dict[str, bytes] = {
    "deep": nested(4000),
    "rather_deep": nested(95),
    "not_a_number": b'{"event":"NodeChanged","t":NaN,"tick":0,"path":"a","status":"","feedback":"","starts":Infinity}',
    "huge_number": b'{"event":"Computed","t":1e999,"tick":0,"node":"a","function":"f","wall":'
    + b"9" * 5000
    + b"}",
    "other_types": _STARTED.replace(b'"seed":3', b'"seed":{"a":[1]}').replace(
        b'"tree":"pick"', b'"tree":["pick"]'
    ),
    "huge_seed": _STARTED.replace(b'"seed":3', b'"seed":' + b"9" * 30),
    "half_character": _STARTED.replace(b'"tree":"pick"', b'"tree":"\\ud800"'),
    "no_parent": _STARTED.replace(b'"parent":null', b'"parent":7'),
    "two_lines": b'{"event":"NodeChanged","path":"a",\n"status":"x"}',
    "a_list": b'{"event":"RunEnded"',
    "an_image": b'{"event":"Published","t":0,"tick":0,"node":"a","topic":"b","value":{"type":"ImageView","lines":7}}',
    "bytes": b'{"event":"RunStarted"\xff\xfe\x00',
}
"""Malformed events, by their defect."""
