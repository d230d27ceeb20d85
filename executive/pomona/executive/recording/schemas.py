"""JSON schemas of the messages in a record. Foxglove's schemas are used where possible, so other tools draw a record.

docs/records.md describes every topic.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Json = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Schema:
    """A named JSON schema, as an MCAP file holds it."""

    name: str
    content: Json

    @property
    def text(self) -> str:
        """The schema as JSON."""
        return json.dumps(self.content, ensure_ascii=False)


def _object(**properties: Json) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _list(items: Json, **limits: int) -> dict[str, Any]:
    return {"type": "array", "items": items, **limits}


def _foxglove(title: str, /, **properties: Json) -> Schema:
    return Schema(f"foxglove.{title}", {"title": f"foxglove.{title}", **_object(**properties)})


NUMBER: Json = {"type": "number"}
WHOLE: Json = {"type": "integer"}
TEXT: Json = {"type": "string"}
BYTES: Json = {"type": "string", "contentEncoding": "base64"}
NANOSECONDS: Json = {"type": "integer", "minimum": 0, "maximum": 999_999_999}
TIME: Json = {"title": "time", **_object(sec={"type": "integer", "minimum": 0}, nsec=NANOSECONDS)}
DURATION: Json = {"title": "duration", **_object(sec=WHOLE, nsec=NANOSECONDS)}
XYZ: Json = _object(x=NUMBER, y=NUMBER, z=NUMBER)
QUATERNION: Json = _object(x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
POSE: Json = _object(position=XYZ, orientation=QUATERNION)
COLOUR: Json = _object(r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)

FLAG: Json = {"type": "boolean"}
NATURAL: Json = {"type": "integer", "minimum": 0}
_AT: Mapping[str, Json] = {"timestamp": TIME, "frame_id": TEXT}
_COLOURS: Mapping[str, Json] = {"color": COLOUR, "colors": _list(COLOUR), "indices": _list(WHOLE)}
_SIZE: Mapping[str, Json] = {"width": WHOLE, "height": WHOLE}


def _matrix(size: int) -> Json:
    return _list(NUMBER, minItems=size, maxItems=size)


COMPRESSED_IMAGE = _foxglove("CompressedImage", **_AT, data=BYTES, format=TEXT)
_MATRICES = {"D": _list(NUMBER), "K": _matrix(9), "R": _matrix(9), "P": _matrix(12)}
CAMERA_CALIBRATION = _foxglove(
    "CameraCalibration", **_AT, **_SIZE, distortion_model=TEXT, **_MATRICES
)
POSE_IN_FRAME = _foxglove("PoseInFrame", **_AT, pose=POSE)
POSES_IN_FRAME = _foxglove("PosesInFrame", **_AT, poses=_list(POSE))
_TRANSFORM = _object(
    timestamp=TIME, parent_frame_id=TEXT, child_frame_id=TEXT, translation=XYZ, rotation=QUATERNION
)
FRAME_TRANSFORMS = _foxglove("FrameTransforms", transforms=_list(_TRANSFORM))
_FIELD = _object(name=TEXT, offset=WHOLE, type=WHOLE)
POINT_CLOUD = _foxglove(
    "PointCloud", **_AT, pose=POSE, point_stride=WHOLE, fields=_list(_FIELD), data=BYTES
)
_LINE = _object(
    type=WHOLE, pose=POSE, thickness=NUMBER, scale_invariant=FLAG, points=_list(XYZ), **_COLOURS
)
_TRIANGLES = _object(pose=POSE, points=_list(XYZ), **_COLOURS)
_DRAWN = {
    "metadata": _list(_object(key=TEXT, value=TEXT)),
    "lines": _list(_LINE),
    "triangles": _list(_TRIANGLES),
}
_EMPTY = {
    kind: _list(_object())
    for kind in ("arrows", "cubes", "spheres", "cylinders", "texts", "models")
}
_ENTITY = _object(**_AT, id=TEXT, lifetime=DURATION, frame_locked=FLAG, **_DRAWN, **_EMPTY)
_DELETION = _object(timestamp=TIME, type=WHOLE, id=TEXT)
SCENE_UPDATE = _foxglove("SceneUpdate", deletions=_list(_DELETION), entities=_list(_ENTITY))
_LEVEL = {"type": "integer", "minimum": 0, "maximum": 5}
LOG = _foxglove(
    "Log", timestamp=TIME, level=_LEVEL, message=TEXT, name=TEXT, file=TEXT, line=NATURAL
)

EVENT = Schema(
    "pomona.Event",
    {
        "title": "pomona.Event",
        "description": "One event of a run; its fields are those of the dataclass of the same name (docs/records.md).",
        **_object(
            event={**TEXT, "description": "the event's name"},
            t={
                **NUMBER,
                "description": "seconds of the run's clock since the run began, pauses left out",
            },
            tick={**WHOLE, "description": "number of the tick, from 1; 0 before the first"},
        ),
        "required": ["event", "t", "tick"],
    },
)

SERIES = Schema(
    "pomona.Sample",
    {
        "title": "pomona.Sample",
        "description": "One sample of the plotted quantities; names end with the unit: grasp_force_N",
        **_object(t={**NUMBER, "description": "seconds on the cell's clock"}),
        "additionalProperties": NUMBER,
        "required": ["t"],
    },
)

READING = Schema(
    "pomona.Reading",
    {
        "title": "pomona.Reading",
        "description": "Measurements of one device of the cell since the previous message, SI units, by quantity",
        **_object(t={**NUMBER, "description": "seconds of the run's clock"}, tick=WHOLE),
        "additionalProperties": True,
        "required": ["t", "tick"],
    },
)

INTERVENTION = Schema(
    "pomona.Intervention",
    {
        "title": "pomona.Intervention",
        "description": "One action of an operator (docs/records.md)",
        **_object(t=NUMBER, tick=WHOLE, who=TEXT, action=TEXT, detail=TEXT),
        "required": ["t", "tick", "who", "action"],
    },
)
