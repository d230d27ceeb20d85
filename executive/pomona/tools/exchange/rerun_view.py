"""A run in Rerun's viewer while it goes on, or in a file for it (the extra `rerun`)."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import DEVICES, EVENTS
from pomona.executive.recording.plain_file import refuse_taken
from pomona.executive.recording.schemas import Schema
from pomona.executive.recording.well_known import SERIES_TOPIC
from pomona.executive.values.installation import need
from pomona.executive.views import ImageView
from pomona.tools.exchange.live import plain_content

EXTRA = "rerun"
VIEWER = "rerun+http://127.0.0.1:9876/proxy"  # where Rerun's viewer listens
_LEVELS = {2: "INFO", 3: "WARN", 4: "ERROR"}


class RerunView:
    """A sink of `Live`. Entities are named like a record's topics, frames like its frames."""

    def __init__(self, target: str = VIEWER) -> None:
        """Show in a viewer at an address, or write a file `….rrd`.

        Raises UsageError: the extra is not installed, or the file is there already.
        """
        self._rr = rr = need("rerun", EXTRA, "a live view in Rerun")
        self._out = rr.RecordingStream("pomona")
        if "://" in target:
            if not target.startswith(("rerun+http://127.0.0.1", "rerun+http://localhost")):
                raise UsageError(
                    f"{target}: a run is shown to a viewer on this machine only; others use a tunnel"
                )
            self._out.connect_grpc(target)
        else:
            refuse_taken(Path(target))
            if Path(target).suffix != ".rrd" or not Path(target).absolute().parent.is_dir():
                raise UsageError(
                    f"{target}: a file for Rerun must end with .rrd, and its folder must exist"
                )
            self._out.save(target)
        self._out.log("base", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def send(self, topic: str, schema: Schema, content: Mapping[str, Any], stamp: int) -> None:
        rr, plain = self._rr, plain_content(content)
        self._out.set_time("run", timestamp=stamp / 1e9)
        match schema.name:
            case "foxglove.FrameTransforms":
                for moved in plain["transforms"]:
                    place, turn = moved["translation"], moved["rotation"]
                    self._log(
                        f"frames/{moved['child_frame_id']}",
                        rr.Transform3D(
                            translation=[place[k] for k in "xyz"],
                            quaternion=rr.Quaternion(xyzw=[turn[k] for k in "xyzw"]),
                        ),
                    )
            case "foxglove.PointCloud":
                data = np.frombuffer(base64.b64decode(plain["data"]), np.float32)
                self._log(
                    topic,
                    rr.Points3D(data.reshape(-1, plain["point_stride"] // 4)[:, :3], radii=0.004),
                )
            case "foxglove.SceneUpdate":
                for entity in plain["entities"]:
                    self._entity(topic, entity)
            case "foxglove.Log":
                text = f"{plain['name']}: {plain['message']}"
                self._log("log", rr.TextLog(text, level=_LEVELS.get(plain["level"], "INFO")))
            case _ if topic.startswith(SERIES_TOPIC):
                for name, value in plain.items():
                    if name != "t" and value is not None:
                        self._log(f"{topic}/{name}", rr.Scalars(value))
            case _ if topic.startswith(DEVICES):
                for name, values in plain.items():
                    if name not in ("t", "tick", "stamp_s"):
                        self._log(
                            f"{topic}/{name}",
                            rr.Scalars(np.atleast_1d(np.asarray(values, float))[-1]),
                        )
            case _ if topic == EVENTS and plain["event"] == "NodeChanged":
                self._log(
                    f"tree/{plain['path']}", rr.TextLog(f"{plain['status']} {plain['feedback']}")
                )

    def show(self, topic: str, view: ImageView, stamp: int) -> None:
        self._out.set_time("run", timestamp=stamp / 1e9)
        if view.image is not None:
            self._log(f"images/{topic}", self._rr.Image(view.image).compress(jpeg_quality=90))
        if view.depth is not None:
            metres = np.where(np.isfinite(view.depth), view.depth, np.float32(0.0)).astype(
                np.float32
            )
            self._log(f"depth/{topic}", self._rr.DepthImage(metres, meter=1.0))

    def rest(self) -> None:
        pass

    def close(self) -> None:
        self._out.flush(timeout_sec=2.0)
        self._out.disconnect()

    def _entity(self, topic: str, entity: Mapping[str, Any]) -> None:
        rr, path = self._rr, f"{topic}/{entity['id']}"
        strips = [[[p[k] for k in "xyz"] for p in line["points"]] for line in entity["lines"]]
        if strips:
            self._log(f"{path}/lines", rr.LineStrips3D(strips))
        for number, mesh in enumerate(entity["triangles"]):
            points = [[p[k] for k in "xyz"] for p in mesh["points"]]
            faces = np.asarray(mesh["indices"], np.uint32).reshape(-1, 3)
            where = (
                f"frames/{entity['frame_id']}/{number}"
                if entity["frame_locked"]
                else f"{path}/{number}"
            )
            self._log(where, rr.Mesh3D(vertex_positions=points, triangle_indices=faces))

    def _log(self, path: str, what: Any) -> None:
        self._out.log(path.strip("/"), what)
