"""Messages of a record, or of a run that is being recorded, as ROS 2 messages.

One translation for bags and for the live bridge: messages of a record in (topic, content), ROS 2 messages out.
pomona/tools/ros2/interop.md lists every topic with its type and units.
"""

from __future__ import annotations

import base64
import re
import uuid
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from pomona.executive.encode import encoded
from pomona.executive.errors import PomonaError
from pomona.executive.recording.folder import DEVICES, EVENTS
from pomona.executive.recording.well_known import DEPTH, IMAGES, INTERVENTIONS, SERIES_TOPIC

SECOND = 1_000_000_000

STATUS_PERIOD = (
    SECOND // 10
)  # shortest period of the tree's status [ns]: it changes many times in a tick
# period of the executed path [ns], and most points published of it
TRACE_PERIOD = SECOND
TRACE_POINTS = 1000
LEVELS = {2: 20, 3: 30, 4: 40}  # log levels, Foxglove's to ROS 2's: info, warning, error

_KIND = {
    "sequence": 2,
    "fallback": 3,
    "parallel": 4,
}  # py_trees_ros_interfaces/Behaviour: status and type


class NoRosTimeError(PomonaError):
    """A moment that ROS 2 cannot hold."""

    def __init__(self, seconds: int) -> None:
        self.seconds = seconds  # since 1970
        super().__init__(
            f"{seconds} s since 1970 are no time of ROS 2, which ends in January 2038: was the clock set?"
        )


class RosMessage(NamedTuple):
    """One message of ROS 2: its fields as plain values, its time in nanoseconds since 1970."""

    topic: str
    type: str
    stamp: int
    fields: Mapping[str, Any]


class ToRos2:
    """Translates one run, message by message, in their order."""

    def __init__(self) -> None:
        self._began = 0
        self._tree = _TreeStatus()
        self._trace: list[tuple[int, list[float]]] = []
        self._traced = -TRACE_PERIOD

    def messages(self, topic: str, content: Mapping[str, Any], stamp: int) -> Iterator[RosMessage]:
        """Yield the ROS 2 messages for one message of a record.

        Args:
            topic, content: of the record's message.
            stamp: time on the run's clock [ns].
        """
        if topic == EVENTS:
            yield from self._event(content, stamp)
            return
        for prefix, translate in _BY_TOPIC.items():
            if topic == prefix or (prefix.endswith("/") and topic.startswith(prefix)):
                at = self._began + stamp
                for name, kind, time, fields in translate(topic.removeprefix(prefix), content, at):
                    yield RosMessage(name, kind, time, fields)
                return

    def rest(self, stamp: int) -> Iterator[RosMessage]:
        """Messages that were held back by their period."""
        yield from self._tree.messages(self._began + stamp, now=True)
        yield from self._path(self._began + stamp)

    def _event(self, event: Mapping[str, Any], stamp: int) -> Iterator[RosMessage]:
        if event["event"] == "RunStarted":
            self._began = round(float(event.get("wall_time") or 0.0) * 1e9) - stamp
        at = self._began + stamp
        yield RosMessage(
            "/pomona/events", "std_msgs/msg/String", at, {"data": encoded(event).decode()}
        )
        yield from self._tree.take(event, at)
        match event["event"]:
            case "LinkChanged":
                yield diagnostics(at, {event["device"]: event["state"]})
            case "SafeStopped":
                yield diagnostics(at, {"run": f"safe stop: {event['reason']}"})
            case "Published" if (
                isinstance(event["value"], Mapping) and event["value"].get("type") == "PosesView"
            ):
                yield from self._moved(event["value"]["trace"], at)
            case "Published" if (
                isinstance(event["value"], Mapping) and event["value"].get("type") == "SceneView"
            ):
                yield from _lines(event["topic"], event["value"]["lines"], at)
            case "RunEnded":
                yield from self.rest(stamp)

    def _moved(self, trace: Any, at: int) -> Iterator[RosMessage]:
        point = [float(x) for x in trace]
        self._trace.append((at, point))
        yield RosMessage(
            "/pomona/tcp",
            "geometry_msgs/msg/PointStamped",
            at,
            {"header": header(at, "base"), "point": xyz(point)},
        )
        if at - self._traced >= TRACE_PERIOD:
            yield from self._path(at)

    def _path(self, at: int) -> Iterator[RosMessage]:
        if not self._trace:
            return
        self._traced = at
        stride = -(-len(self._trace) // TRACE_POINTS)
        told = self._trace[::stride] + (
            [] if (len(self._trace) - 1) % stride == 0 else self._trace[-1:]
        )
        yield _path("/pomona/path/executed", told, at)


# ---------------------------------------------------------------------------------------------- small parts


def time_of(stamp: int) -> dict[str, int]:
    """builtin_interfaces/Time. Raises NoRosTimeError: its 31 bits of seconds do not hold this moment."""
    seconds, nanoseconds = divmod(stamp, SECOND)
    if not 0 <= seconds < 2**31:
        raise NoRosTimeError(seconds)
    return {"sec": seconds, "nanosec": nanoseconds}


def header(stamp: int, frame: str) -> dict[str, Any]:
    """std_msgs/Header."""
    return {"stamp": time_of(stamp), "frame_id": frame}


def xyz(values: Any) -> dict[str, float]:
    """Return a point or vector."""
    x, y, z = (float(value) for value in values)
    return {"x": x, "y": y, "z": z}


def ros_name(name: str) -> str:
    """Return a name in ROS 2's form for topics: letters, digits, underscores, slashes, no part begins with a digit."""
    parts = (
        re.sub(r"[^A-Za-z0-9]+", "_", part).strip("_") or "x" for part in name.strip("/").split("/")
    )
    return "/".join(f"_{part}" if part[0].isdigit() else part for part in parts)


UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def _path(topic: str, points: list[tuple[int, list[float]]], at: int) -> RosMessage:
    poses = [
        {"header": header(time, "base"), "pose": {"position": xyz(point), "orientation": UPRIGHT}}
        for time, point in points
    ]
    return RosMessage(
        topic, "nav_msgs/msg/Path", at, {"header": header(at, "base"), "poses": poses}
    )


def _lines(topic: str, lines: Any, at: int) -> Iterator[RosMessage]:
    for line in lines:
        points = [
            [float("nan") if x is None else float(x) for x in point] for point in line["points"]
        ]
        label = ros_name(line["label"] or line["style"])
        yield _path(
            f"/pomona/path/{ros_name(topic)}/{label}", [(at, point) for point in points], at
        )


def diagnostics(at: int, states: Mapping[str, str]) -> RosMessage:
    """Return the devices' state by name: 'ok', or the problem."""
    status = [
        {
            "level": 0 if state == "ok" else 2,
            "name": f"pomona: {name}",
            "message": state,
            "hardware_id": name,
        }
        for name, state in states.items()
    ]
    fields = {"header": header(at, ""), "status": status}
    return RosMessage("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", at, fields)


class _TreeStatus:
    """The status of every node, as a message of our own and as py_trees_ros's."""

    def __init__(self) -> None:
        self._about: dict[str, Any] = {
            "run": "",
            "tree": "",
            "state": "",
            "because": "",
            "pause": 0,
            "tick": 0,
        }
        self._nodes: dict[str, dict[str, Any]] = {}
        self._children: dict[str, list[str]] = {}
        self._told = -STATUS_PERIOD
        self._changed = False

    def take(self, event: Mapping[str, Any], at: int) -> Iterator[RosMessage]:
        self._about["tick"] = int(event["tick"])
        match event["event"]:
            case "RunStarted":
                self._begin(event)
            case "StateChanged":
                self._about |= {key: event[key] for key in ("state", "because")} | {
                    "pause": event.get("pause", 0)
                }
            case "NodeChanged":
                self._change(event)
            case "RunEnded":
                pass
            case _:  # an event without a change of the tree; an earlier change may be due now
                yield from self.messages(at)
                return
        self._changed = True
        yield from self.messages(at, now=event["event"] != "NodeChanged")

    def messages(self, at: int, now: bool = False) -> Iterator[RosMessage]:
        """Yield both messages, when something has changed and their period is over, or `now`."""
        if not self._changed or (at - self._told < STATUS_PERIOD and not now):
            return
        self._changed = False
        self._told = at
        ours = {"header": header(at, ""), **self._about, "nodes": list(self._nodes.values())}
        yield RosMessage("/pomona/tree", "pomona_msgs/msg/TreeStatus", at, ours)
        behaviours = [self._behaviour(path, node) for path, node in self._nodes.items()]
        theirs = {"tick": self._about["tick"], "stamp": time_of(at), "behaviours": behaviours}
        yield RosMessage(
            "/pomona/snapshots", "py_trees_ros_interfaces/msg/BehaviourTree", at, theirs
        )

    def _begin(self, event: Mapping[str, Any]) -> None:
        self._about |= {"run": event["run"], "tree": event["tree"], "state": "", "because": ""}
        self._nodes = {}
        self._children = {}
        for node in event["nodes"]:
            path = node["path"]
            parent = node["parent"] or ""
            known = {
                "path": path,
                "parent": parent,
                "name": node.get("name", path),
                "type": node.get("type", ""),
            }
            self._nodes[path] = known | {"status": "INVALID"}
            self._children.setdefault(parent, []).append(path)

    def _change(self, event: Mapping[str, Any]) -> None:
        node = self._nodes.setdefault(event["path"], {"path": event["path"], "name": event["path"]})
        reason = event["reason"] or {"code": "", "message": ""}
        node |= {
            "status": event["status"],
            "feedback": event["feedback"],
            "starts": event["starts"],
            "code": reason["code"],
            "reason": reason["message"],
        }

    def _behaviour(self, path: str, node: Mapping[str, Any]) -> dict[str, Any]:
        children = self._children.get(path, [])
        running = next(
            (child for child in children if self._nodes[child]["status"] == "RUNNING"), None
        )
        kind = _KIND.get(node.get("type", ""), 1 if not children else 7 if len(children) > 1 else 6)
        return {
            "name": node["name"],
            "class_name": node.get("type", ""),
            "own_id": self._id(path),
            "parent_id": self._id(node.get("parent", "")),
            "child_ids": [self._id(child) for child in children],
            "current_child_id": self._id(running or ""),
            "type": kind,
            "blackbox_level": 4,
            "status": {"INVALID": 1, "RUNNING": 2, "SUCCESS": 3, "FAILURE": 4}.get(
                node["status"], 1
            ),
            "message": node.get("feedback", ""),
            "is_active": node["status"] != "INVALID",
        }

    @staticmethod
    def _id(path: str) -> dict[str, Any]:
        """Return the id of a path, equal in every run; the empty path has the zero id."""
        return {
            "uuid": uuid.uuid5(uuid.NAMESPACE_URL, f"pomona:{path}").bytes if path else bytes(16)
        }


# ------------------------------------------------------------------------------- what other tools draw of a run

Translated = Iterator[
    tuple[str, str, int, Mapping[str, Any]]
]  # topic, type, stamp [ns since 1970], fields


def _transforms(_name: str, content: Mapping[str, Any], at: int) -> Translated:
    moved = [
        {
            "header": header(at, item["parent_frame_id"]),
            "child_frame_id": item["child_frame_id"],
            "transform": {"translation": item["translation"], "rotation": item["rotation"]},
        }
        for item in content["transforms"]
    ]
    yield "/tf", "tf2_msgs/msg/TFMessage", at, {"transforms": moved}


def _image(name: str, content: Mapping[str, Any], at: int) -> Translated:
    """The JPEG, unchanged."""
    fields = {
        "header": header(at, content["frame_id"]),
        "format": content["format"],
        "data": base64.b64decode(content["data"]),
    }
    yield (
        f"/camera/{ros_name(name)}/image/compressed",
        "sensor_msgs/msg/CompressedImage",
        at,
        fields,
    )


def _depth(name: str, content: Mapping[str, Any], at: int) -> Translated:
    """Millimetres as they were recorded."""
    from pomona.executive.recording.read import decode_image  # OpenCV

    depth = decode_image(content["data"])
    yield depth_message(name, content["frame_id"], depth, at)


def _calibration(name: str, content: Mapping[str, Any], at: int) -> Translated:
    fields = {
        "header": header(at, content["frame_id"]),
        "height": content["height"],
        "width": content["width"],
        "distortion_model": content["distortion_model"] or "plumb_bob",
        "d": content["D"] or [0.0] * 5,
        "k": content["K"],
        "r": content["R"],
        "p": content["P"],
    }
    yield f"/camera/{ros_name(name)}/camera_info", "sensor_msgs/msg/CameraInfo", at, fields


def _pose(name: str, content: Mapping[str, Any], at: int) -> Translated:
    head = header(at, content["frame_id"])
    topic = f"/pomona/poses/{ros_name(name)}"
    if "pose" in content:
        yield topic, "geometry_msgs/msg/PoseStamped", at, {"header": head, "pose": content["pose"]}
    else:
        yield topic, "geometry_msgs/msg/PoseArray", at, {"header": head, "poses": content["poses"]}


def _points(name: str, content: Mapping[str, Any], at: int) -> Translated:
    """Foxglove's cloud of float32 x, y, z has the same bytes as ROS 2's."""
    data = base64.b64decode(content["data"])
    stride = content["point_stride"]
    fields = {
        "header": header(at, content["frame_id"]),
        "height": 1,
        "width": len(data) // stride,
        "fields": [
            {
                "name": field["name"],
                "offset": field["offset"],
                "datatype": field["type"],
                "count": 1,
            }
            for field in content["fields"]
        ],
        "point_step": stride,
        "row_step": len(data),
        "data": data,
        "is_dense": True,
    }
    yield f"/pomona/points/{ros_name(name)}", "sensor_msgs/msg/PointCloud2", at, fields


def _scene(name: str, content: Mapping[str, Any], at: int) -> Translated:
    markers = []
    for entity in content["entities"]:
        for number, (kind, scale, piece) in enumerate(
            [
                *((4, {"x": 0.003}, line) for line in entity["lines"]),
                *((11, {"x": 1.0, "y": 1.0, "z": 1.0}, t) for t in entity["triangles"]),
            ]
        ):
            corners = piece["points"]
            if len(piece["indices"]):
                corners = [corners[k] for k in np.asarray(piece["indices"]).tolist()]
            markers.append(
                {
                    "header": header(at, entity["frame_id"]),
                    "ns": entity["id"],
                    "id": number,
                    "type": kind,
                    "pose": piece["pose"],
                    "scale": scale,
                    "color": piece["color"],
                    "points": corners,
                    "frame_locked": entity["frame_locked"],
                }
            )
    yield (
        f"/pomona/scene/{ros_name(name)}",
        "visualization_msgs/msg/MarkerArray",
        at,
        {"markers": markers},
    )


def _log(_name: str, content: Mapping[str, Any], at: int) -> Translated:
    fields = {
        "stamp": time_of(at),
        "level": LEVELS.get(content["level"], 20),
        "name": f"pomona.{content['name']}",
        "msg": content["message"],
    }
    yield "/rosout", "rcl_interfaces/msg/Log", at, fields


def _intervention(_name: str, content: Mapping[str, Any], at: int) -> Translated:
    yield "/pomona/interventions", "std_msgs/msg/String", at, {"data": encoded(content).decode()}


def _sample(name: str, content: Mapping[str, Any], at: int) -> Translated:
    values = {key: value for key, value in content.items() if key != "t" and value is not None}
    fields = {
        "header": header(at, ""),
        "t": content["t"],
        "names": list(values),
        "values": np.array(list(values.values()), float),
    }
    yield f"/pomona/series/{ros_name(name)}", "pomona_msgs/msg/Sample", at, fields


def _reading(name: str, content: Mapping[str, Any], at: int) -> Translated:
    """Every sample of a device at its own time: the newest was taken when the message was written."""
    stamps = np.atleast_1d(np.asarray(content["stamp_s"], float))
    times = [at - round(float(stamps[-1] - stamp) * 1e9) for stamp in stamps]
    columns = {
        key: np.atleast_1d(np.array(values, float))
        for key, values in content.items()
        if key not in ("t", "tick", "stamp_s")
    }
    joints = {
        key: f"{name}_joint_{key[2:-4]}" if key.startswith("q_") else f"{name}_width"
        for key in columns
        if key.startswith("q_") or key == "width_m"
    }
    if joints:
        names = list(joints.values())
        rows = np.stack([columns[key] for key in joints], axis=1)
        rates = [
            columns[key] for key in columns if key.startswith("qd_")
        ]  # records of earlier versions have none
        velocities = np.stack(rates, axis=1) if rates else np.empty((len(times), 0))
        for at_sample, row, velocity in zip(times, rows, velocities, strict=True):
            fields = {
                "header": header(at_sample, ""),
                "name": names,
                "position": row,
                "velocity": velocity,
            }
            yield "/joint_states", "sensor_msgs/msg/JointState", at_sample, fields
    yield from _wrenches(name, columns, times)


def _wrenches(device: str, columns: Mapping[str, Any], times: list[int]) -> Translated:
    fingers = dict.fromkeys(
        key.rsplit("_force_x_N", 1)[0] for key in columns if key.endswith("_force_x_N")
    )
    for finger in fingers:
        topic = f"/{ros_name(device)}/{finger}/wrench"
        frame = f"{device}/{finger}"
        rows = np.stack([columns[f"{finger}_{part}"] for part in _WRENCH], axis=1).tolist()
        for at, (fx, fy, fz, tx, ty, tz) in zip(times, rows, strict=True):
            wrench = {"force": {"x": fx, "y": fy, "z": fz}, "torque": {"x": tx, "y": ty, "z": tz}}
            yield (
                topic,
                "geometry_msgs/msg/WrenchStamped",
                at,
                {"header": header(at, frame), "wrench": wrench},
            )


_WRENCH = ("force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm")

_BY_TOPIC: Mapping[str, Callable[[str, Mapping[str, Any], int], Translated]] = {
    "/tf": _transforms,
    IMAGES: _image,
    DEPTH: _depth,
    "/calibration/": _calibration,
    "/poses/": _pose,
    "/points/": _points,
    "/scene/": _scene,
    "/log": _log,
    INTERVENTIONS: _intervention,
    SERIES_TOPIC: _sample,
    DEVICES: _reading,
}


def depth_message(
    name: str, frame: str, depth: Any, at: int
) -> tuple[str, str, int, Mapping[str, Any]]:
    """Return depth: uint16 in millimetres (16UC1) or float32 in metres (32FC1), 0 where there is none (REP 118)."""
    coding = "16UC1" if depth.dtype == np.uint16 else "32FC1"
    return f"/camera/{ros_name(name)}/depth/image_raw", *raw_image(frame, depth, coding, at)


def colour_message(
    name: str, frame: str, image: Any, at: int
) -> tuple[str, str, int, Mapping[str, Any]]:
    """Return an image, unchanged: RGB, uint8."""
    return f"/camera/{ros_name(name)}/image_raw", *raw_image(frame, image, "rgb8", at)


def raw_image(frame: str, pixels: Any, coding: str, at: int) -> tuple[str, int, Mapping[str, Any]]:
    """sensor_msgs/Image of pixels."""
    pixels = np.ascontiguousarray(pixels)
    fields = {
        "header": header(at, frame),
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": coding,
        "step": pixels.strides[0],
        "data": pixels.reshape(-1).view(np.uint8),
    }
    return "sensor_msgs/msg/Image", at, fields
