"""JSON schemas of what a record holds: (name, text) each. Well-known ones where they exist."""

from __future__ import annotations

import json

COMPRESSED_IMAGE = (
    "foxglove.CompressedImage",
    json.dumps(
        {
            "title": "foxglove.CompressedImage",
            "type": "object",
            "properties": {
                "timestamp": {
                    "type": "object",
                    "title": "time",
                    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
                },
                "frame_id": {"type": "string"},
                "data": {"type": "string", "contentEncoding": "base64"},
                "format": {"type": "string"},
            },
        }
    ),
)

EVENT = (
    "pomona.Event",
    json.dumps(
        {
            "title": "pomona.Event",
            "description": "One event of a run; its fields are those of the dataclass of the same name.",
            "type": "object",
            "properties": {
                "event": {"type": "string"},
                "t": {"type": "number", "description": "seconds of the run's clock"},
                "tick": {"type": "integer"},
            },
            "required": ["event", "t", "tick"],
        }
    ),
)
