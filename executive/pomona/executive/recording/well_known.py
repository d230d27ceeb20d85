"""Events as messages of Foxglove's schemas, which other tools draw. A replay reads `/events` only.

Every frame except `base` has its own name: `T_base_object` of a value written under the key `measured` is the frame
`measured/object`, the camera of an image is `camera/<topic>`.
"""

from __future__ import annotations

import base64
import dataclasses
import logging
import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.images import to_jpeg, to_png
from pomona.executive.palette import MUTED, SCENE, rgb
from pomona.executive.reasons import Reason
from pomona.executive.recording.schemas import (
    CAMERA_CALIBRATION,
    COMPRESSED_IMAGE,
    FRAME_TRANSFORMS,
    INTERVENTION,
    LOG,
    POINT_CLOUD,
    POSE_IN_FRAME,
    POSES_IN_FRAME,
    SCENE_UPDATE,
    SERIES,
    Schema,
)
from pomona.executive.running.events import (
    AttemptEnded,
    ErrorRaised,
    Event,
    LinkChanged,
    Logged,
    NodeChanged,
    OperatorActed,
    PortWritten,
    Published,
    RunEnded,
    RunStarted,
    SafeStopped,
    StateChanged,
)
from pomona.executive.values.rotations import to_quaternion
from pomona.executive.views import (
    BodiesView,
    ImageView,
    Mesh3,
    Points3,
    PosesView,
    SceneView,
    SeriesView,
)

Message = tuple[str, Schema, dict[str, Any]]  # topic, schema and content of one message

SERIES_TOPIC = "/series/"
INTERVENTIONS = "/interventions"
INFO = 2
WARNING = 3
ERROR = 4
FLOAT32 = 7
IDENTITY = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}
_T = re.compile(r"T_([a-z0-9]+)_([a-z0-9_]+)")


def well_known(event: Event, stamp: int) -> Iterator[Message]:
    """Yield the messages of an event in well-known schemas; `stamp` is their time [ns]."""
    at = time_of(stamp)
    if isinstance(event, Published):
        if isinstance(event.value, SceneView):
            yield from _scene(event.topic, event.value, at)
        elif isinstance(event.value, ImageView):
            yield from _camera(event.topic, event.value, at)
        elif isinstance(event.value, BodiesView):
            entities = [
                _body(event.topic, k, body, at) for k, body in enumerate(event.value.bodies)
            ]
            yield f"/scene/{event.topic}", SCENE_UPDATE, {"deletions": [], "entities": entities}
        elif isinstance(event.value, PosesView):
            moved = [
                _moved(event.topic, k, pose, at)
                for k, pose in enumerate(event.value.poses.tolist())
            ]
            yield "/tf", FRAME_TRANSFORMS, {"transforms": moved}
    elif isinstance(event, PortWritten):
        yield from _poses(event.key.strip("/").rsplit("/", 1)[-1], event.value, at)
    elif isinstance(event, OperatorActed):
        names = ("t", "tick", "who", "action", "detail")
        yield INTERVENTIONS, INTERVENTION, {name: getattr(event, name) for name in names}
    elif isinstance(event, RunEnded) and event.truth:
        yield from _transforms(dict(_rooted("truth", event.truth)), at)
    said = _say(event)
    if said is not None:
        level, name, message = said
        yield (
            "/log",
            LOG,
            {
                "timestamp": at,
                "level": level,
                "message": message,
                "name": name,
                "file": "",
                "line": 0,
            },
        )


IMAGES = "/images/"  # topics of colour images; the image of an event precedes the event
DEPTH = "/depth/"  # topics of its depth, between the two


class Images:
    """Encodes colour as JPEG and depth as 16-bit PNG [mm], apart from their event."""

    def __init__(self) -> None:
        self._last: tuple[NDArray[np.uint8] | None, str] = (None, "")
        """The last colour image with its code: several skills draw on the same one."""

    def messages(self, topic: str, view: ImageView, stamp: int) -> Iterator[Message]:
        """Yield the messages of one view; `stamp` is their time [ns]."""
        frame = f"camera/{topic}"
        if view.image is not None:
            if view.image is not self._last[0]:
                self._last = view.image, _text(to_jpeg(view.image, 90))  # quality of JPEG
            yield f"{IMAGES}{topic}", COMPRESSED_IMAGE, _image(stamp, frame, self._last[1], "jpeg")
        if view.depth is not None:
            metres = np.where(np.isfinite(view.depth), view.depth, np.float32(0.0))
            millimetres = np.rint(np.clip(metres * np.float32(1e3), 0, 65535)).astype(np.uint16)
            # compression level of PNG: the fastest, since the recorder shares the processor with the run
            yield (
                f"{DEPTH}{topic}",
                COMPRESSED_IMAGE,
                _image(stamp, frame, _text(to_png(millimetres, 1)), "png"),
            )


def samples(topic: str, view: SeriesView) -> Iterator[Message]:
    """Yield one message for each sample, with names that are valid in a plot's path."""
    names = {name: plain_name(name) for name in view.values}
    columns = {names[name]: np.asarray(values, float) for name, values in view.values.items()}
    for i, t in enumerate(view.t):
        sample = {
            name: float(f"{values[i]:.6g}")
            for name, values in columns.items()
            if np.isfinite(values[i])
        }
        yield f"{SERIES_TOPIC}{topic}", SERIES, {"t": float(t), **sample}


def plain_name(name: str) -> str:
    """`grasp force [N]` -> grasp_force_N, `slip speed [m/s]` -> slip_speed_m_per_s."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name.replace("/", "_per_")).strip("_")


def time_of(stamp: int) -> dict[str, int]:
    """Return nanoseconds as a message's time."""
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    return {"sec": seconds, "nsec": nanoseconds}


# ------------------------------------------------------------------------------------------------- images


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _image(stamp: int, frame: str, data: str, form: str) -> dict[str, Any]:
    return {"timestamp": time_of(stamp), "frame_id": frame, "data": data, "format": form}


def _camera(topic: str, view: ImageView, at: Mapping[str, int]) -> Iterator[Message]:
    pinhole = view.pinhole
    if pinhole is None or view.image is None:
        return
    height, width = view.image.shape[:2]
    fx = pinhole.fx
    fy = pinhole.fy
    cx = pinhole.cx
    cy = pinhole.cy
    K = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    P = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    R = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    camera = {"timestamp": at, "frame_id": f"camera/{topic}", "width": width, "height": height}
    lens = {"distortion_model": "", "D": [], "K": K, "R": R, "P": P}
    yield f"/calibration/{topic}", CAMERA_CALIBRATION, camera | lens
    if pinhole.T_base_camera is not None:
        yield from _transforms({f"camera/{topic}": ("base", pinhole.T_base_camera)}, at)


# -------------------------------------------------------------------------------------------------- poses


def _poses(key: str, value: Any, at: Mapping[str, int]) -> Iterator[Message]:
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return
    fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    rooted = dict(_rooted(key, fields))
    yield from _transforms(rooted, at)
    for frame, (parent, T) in rooted.items():
        if parent == "base":
            yield (
                f"/poses/{frame}",
                POSE_IN_FRAME,
                {"timestamp": at, "frame_id": "base", "pose": _pose(T)},
            )
    for name, field in fields.items():
        poses = _many(field)
        if poses:
            yield (
                f"/poses/{key}/{name}",
                POSES_IN_FRAME,
                {"timestamp": at, "frame_id": "base", "poses": poses},
            )


def _rooted(key: str, fields: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, Any]]]:
    """Yield (frame, (parent, T)) of the poses in `fields` that are connected to the base frame, also indirectly."""
    found: dict[str, tuple[str, Any]] = {}
    for name, T in fields.items():
        match = _T.fullmatch(name)
        if match and _is_pose(T) and (match[1] == "base" or match[2] not in found):
            found[match[2]] = (match[1], T)
    for child, (parent, T) in found.items():
        if parent == "base":
            yield f"{key}/{child}", ("base", T)
        elif found.get(parent, ("", None))[0] == "base":
            yield f"{key}/{child}", (f"{key}/{parent}", T)


def _many(field: Any) -> list[dict[str, Any]]:
    """Return the first base pose of each item of a list."""
    if not isinstance(field, (list, tuple)) or not field or not dataclasses.is_dataclass(field[0]):
        return []
    names = [f.name for f in dataclasses.fields(field[0]) if f.name.startswith("T_base_")]
    poses = [getattr(item, names[0], None) for item in field] if names else []
    return [_pose(T) for T in poses if T is not None and _is_pose(T)]


def _transforms(rooted: Mapping[str, tuple[str, Any]], at: Mapping[str, int]) -> Iterator[Message]:
    if rooted:
        yield (
            "/tf",
            FRAME_TRANSFORMS,
            {"transforms": [_transform(at, *entry) for entry in rooted.items()]},
        )


def _transform(at: Mapping[str, int], child: str, entry: tuple[str, Any]) -> dict[str, Any]:
    parent, T = entry
    pose = _pose(T)
    frames = {"timestamp": at, "parent_frame_id": parent, "child_frame_id": child}
    return frames | {"translation": pose["position"], "rotation": pose["orientation"]}


def _is_pose(T: Any) -> bool:
    return (
        isinstance(T, np.ndarray)
        and T.shape == (4, 4)
        and bool(np.isfinite(T).all() and np.linalg.det(T[:3, :3]) > 0.0)
    )


def _pose(T: NDArray[np.float64]) -> dict[str, Any]:
    x, y, z, w = to_quaternion(T[:3, :3]).tolist()
    return {"position": _xyz(T[:3, 3]), "orientation": {"x": x, "y": y, "z": z, "w": w}}


# -------------------------------------------------------------------------------------------------- space


def _scene(topic: str, view: SceneView, at: Mapping[str, int]) -> Iterator[Message]:
    for cloud in view.points:
        yield (
            f"/points/{topic}/{plain_name(cloud.label or cloud.style)}",
            POINT_CLOUD,
            _cloud(cloud, at),
        )
    if not (view.lines or view.meshes):
        return
    strip = {
        "type": 0,
        "pose": IDENTITY,
        "thickness": 3.0,
        "scale_invariant": True,
        "colors": [],
        "indices": [],
    }
    lines = [
        strip | {"points": _points(line.points), "color": _colour(line.style)}
        for line in view.lines
    ]
    entity = _entity(
        topic, "base", at, lines, [_triangles(mesh) for mesh in view.meshes], view.caption
    )
    yield f"/scene/{topic}", SCENE_UPDATE, {"deletions": [], "entities": [entity]}


def _body(topic: str, number: int, body: Mesh3, at: Mapping[str, int]) -> dict[str, Any]:
    """Return a body in its own frame, which transforms move."""
    frame = f"{topic}/{number}"
    return _entity(frame, frame, at, [], [_triangles(body)], body.label, locked=True)


def _moved(topic: str, number: int, pose: list[float], at: Mapping[str, int]) -> dict[str, Any]:
    x, y, z, qx, qy, qz, qw = pose
    frames = {"timestamp": at, "parent_frame_id": "base", "child_frame_id": f"{topic}/{number}"}
    return frames | {
        "translation": {"x": x, "y": y, "z": z},
        "rotation": {"x": qx, "y": qy, "z": qz, "w": qw},
    }


def _entity(
    name: str,
    frame: str,
    at: Mapping[str, int],
    lines: list[dict[str, Any]],
    triangles: list[dict[str, Any]],
    caption: str,
    locked: bool = False,
) -> dict[str, Any]:
    about = {
        "timestamp": at,
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": locked,
    }
    metadata = [{"key": "caption", "value": caption}] if caption else []
    empty: dict[str, Any] = {
        kind: [] for kind in ("arrows", "cubes", "spheres", "cylinders", "texts", "models")
    }
    return about | {"metadata": metadata, "lines": lines, "triangles": triangles} | empty


def _triangles(mesh: Mesh3) -> dict[str, Any]:
    corners = {
        "points": _points(mesh.vertices),
        "indices": np.ascontiguousarray(mesh.faces).reshape(-1),
    }
    return {"pose": IDENTITY, **corners, "color": _colour(mesh.style), "colors": []}


def _cloud(cloud: Points3, at: Mapping[str, int]) -> dict[str, Any]:
    packed = np.ascontiguousarray(cloud.points, "<f4").reshape(-1, 3)
    fields = [{"name": name, "offset": 4 * i, "type": FLOAT32} for i, name in enumerate("xyz")]
    about = {
        "timestamp": at,
        "frame_id": "base",
        "pose": IDENTITY,
        "point_stride": 12,
        "fields": fields,
    }
    return about | {"data": base64.b64encode(packed.tobytes()).decode()}


def _points(points: NDArray[np.float64]) -> list[dict[str, float]]:
    rounded = np.round(np.asarray(points, float).reshape(-1, 3), 6)
    finite = rounded[np.isfinite(rounded).all(axis=1)]
    return [{"x": x, "y": y, "z": z} for x, y, z in finite.tolist()]


def _xyz(p: NDArray[np.float64]) -> dict[str, float]:
    return {"x": float(p[0]), "y": float(p[1]), "z": float(p[2])}


def _colour(role: str) -> dict[str, float]:
    r, g, b = rgb(SCENE.get(role, MUTED))
    return {"r": r, "g": g, "b": b, "a": 1.0}


# ---------------------------------------------------------------------------------------------------- log


def _say(event: Event) -> tuple[int, str, str] | None:
    """Return level, name and text of an event for the log; None for an event that is not logged."""
    match event:
        case RunStarted():
            return (
                INFO,
                "run",
                f"{event.tree} on {event.cell} ({event.cell_kind}), seed {event.seed}",
            )
        case StateChanged():
            return INFO, "run", f"{event.state}: {event.because}"
        case NodeChanged(reason=Reason() as reason) if not reason.causes:
            return WARNING, event.path, f"{reason.code}: {reason.message}"
        case AttemptEnded():
            why = f": {event.reason.code}: {event.reason.message}" if event.reason else ""
            word = "succeeded" if event.succeeded else "failed"
            return (
                (INFO if event.succeeded else WARNING),
                event.path,
                f"attempt {event.number} of {event.of} {word}{why}",
            )
        case PortWritten() if event.sentence:
            return INFO, event.writer, f"{event.key.rsplit('/', 1)[-1]}: {event.sentence}"
        case Logged():
            return (
                logging.getLevelNamesMapping().get(event.level, logging.INFO) // 10,
                event.node,
                event.text,
            )
        case LinkChanged():
            return (INFO if event.state == "ok" else ERROR), event.device, event.state
        case OperatorActed():
            return WARNING, event.who, f"{event.action} {event.detail}".strip()
        case SafeStopped():
            return ERROR, "run", f"safe stop: {event.reason}"
        case ErrorRaised():
            return ERROR, event.node or "run", f"during {event.during}: {event.traceback.rstrip()}"
        case RunEnded():
            why = f": {event.reason.code}: {event.reason.message}" if event.reason else ""
            return (
                {"success": INFO, "partial": WARNING}.get(event.outcome, ERROR),
                "run",
                f"{event.outcome}{why}",
            )
    return None
