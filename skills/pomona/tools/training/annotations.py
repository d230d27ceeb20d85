"""Annotation files as DOPE's tools read and write them: one JSON beside each picture."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.plain_text import read_plain_text
from pomona.executive.values.rotations import from_quaternion, to_quaternion
from pomona.skills.perception.detection.errors import BadAnnotation

LARGEST_OBJECT = 2.0  # an object larger than this [m] is one whose file is in centimetres
FARTHEST_OBJECT = (
    10.0  # the same for one that is farther than this [m], where a file holds no cuboid in space
)


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedObject:
    """One object of a picture."""

    name: str  # its class
    visibility: float  # part of its silhouette that is seen, 0..1
    T_camera_object: Float64  # its pose [m]
    keypoints: Float64  # corners 0..7 and centroid, (9, 2) [px]
    scale: float = 1.0  # size against the CAD model; 1 without it in the file
    dimensions: Float64 | None = None  # true cuboid [m], None without it in the file
    box: tuple[int, int, int, int] | None = (
        None  # x, y, w, h of the visible pixels [px], None without it in the file
    )


@dataclass(frozen=True, slots=True, eq=False)
class Annotation:
    """Annotation of one picture.

    Attributes:
        width, height: picture size [px]; 0 without it in the file.
        camera: fx, fy, cx, cy [px]; 0 without it in the file.
        decoys: u, v, radius of things that are no fruit [px]; training takes hard negatives from them.
        scene: kind of scene, for the tables of a report.
    """

    width: int
    height: int
    camera: tuple[float, float, float, float]
    objects: tuple[AnnotatedObject, ...]
    decoys: tuple[tuple[float, float, float], ...] = ()
    scene: str = ""

    @property
    def K(self) -> Float64:
        """Camera matrix (3, 3) [px]."""
        fx, fy, cx, cy = self.camera
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def write_annotation(path: Path, annotation: Annotation) -> None:
    """Write a JSON file with DOPE's keys and, beside them, Pomona's own (`scale`, `dimensions`, `decoys`)."""
    fx, fy, cx, cy = annotation.camera
    content = {
        "camera_data": {
            "width": annotation.width,
            "height": annotation.height,
            "intrinsics": {"fx": fx, "fy": fy, "cx": cx, "cy": cy},
        },
        "scene": annotation.scene,
        "objects": [_object_json(item) for item in annotation.objects],
        "decoys": [[round(v, 2) for v in decoy] for decoy in annotation.decoys],
    }
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content), encoding="utf-8")
    part.replace(path)


def read_annotation(path: Path) -> Annotation:
    """Read a JSON file written by DOPE's tools or by `write_annotation`.

    Both forms of keypoints are accepted: 9 points, or 8 and `projected_cuboid_centroid`. NDDS writes centimetres, and
    its camera into `_camera_settings.json` beside the frames; both are noticed.

    Raises BadAnnotation: no such file, no JSON, or keys of another shape.
    """
    try:
        content = json.loads(read_plain_text(path))
        camera = content.get("camera_data") or _camera_beside(path)
        k = camera.get("intrinsics") or {}
        return Annotation(
            width=int(camera.get("width", 0)),
            height=int(camera.get("height", 0)),
            camera=(
                float(k.get("fx", 0)),
                float(k.get("fy", 0)),
                float(k.get("cx", 0)),
                float(k.get("cy", 0)),
            ),
            objects=tuple(_object(item) for item in content["objects"]),
            decoys=tuple((float(u), float(v), float(r)) for u, v, r in content.get("decoys", ())),
            scene=str(content.get("scene", "")),
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise BadAnnotation(path, f"is no DOPE annotation: {error!r}") from error


def _object_json(item: AnnotatedObject) -> dict[str, Any]:
    content: dict[str, Any] = {
        "class": item.name,
        "visibility": round(item.visibility, 4),
        "location": [round(float(v), 6) for v in item.T_camera_object[:3, 3]],
        "quaternion_xyzw": [
            round(float(v), 7) for v in to_quaternion(item.T_camera_object[:3, :3])
        ],
        "projected_cuboid": [[round(float(u), 3), round(float(v), 3)] for u, v in item.keypoints],
        "projected_cuboid_centroid": [round(float(v), 3) for v in item.keypoints[8]],
        "scale": round(item.scale, 5),
    }
    if item.dimensions is not None:
        content["dimensions"] = [round(float(v), 6) for v in item.dimensions]
    if item.box is not None:
        content["bounding_box"] = list(item.box)
    return content


def _object(item: dict[str, Any]) -> AnnotatedObject:
    points = np.asarray(item["projected_cuboid"], np.float64)
    if points.shape == (8, 2):
        points = np.vstack([points, np.asarray(item["projected_cuboid_centroid"], np.float64)])
    if points.shape != (9, 2):
        raise ValueError(f"projected_cuboid must hold 8 or 9 points, not shape {points.shape}")
    T = np.eye(4)
    T[:3, :3] = from_quaternion(item.get("quaternion_xyzw", (0, 0, 0, 1)))
    T[:3, 3] = np.asarray(item.get("location", (0.0, 0.0, 0.0)), np.float64) * _metres(item)
    dimensions, box = item.get("dimensions"), item.get("bounding_box")
    return AnnotatedObject(
        name=str(item["class"]),
        visibility=float(item.get("visibility", 1.0)),
        T_camera_object=T,
        keypoints=points,
        scale=float(item.get("scale", 1.0)),
        dimensions=None if dimensions is None else np.asarray(dimensions, np.float64),
        box=None if box is None else (int(box[0]), int(box[1]), int(box[2]), int(box[3])),
    )


def _metres(item: dict[str, Any]) -> float:
    """Metres of one unit of an object's location.

    The files name no unit. The unit follows from the extent of the cuboid's corners in space, else from the distance.
    """
    if "cuboid" in item:
        corners = np.asarray(item["cuboid"], np.float64).reshape(-1, 3)
        return 0.01 if float(np.ptp(corners, axis=0).max()) > LARGEST_OBJECT else 1.0
    distance = float(np.linalg.norm(np.asarray(item.get("location", (0.0, 0.0, 0.0)), np.float64)))
    return 0.01 if distance > FARTHEST_OBJECT else 1.0


def _camera_beside(path: Path) -> dict[str, Any]:
    """NDDS's camera of all frames of a folder, under the keys of a frame's own; empty where there is none."""
    beside = path.with_name("_camera_settings.json")
    if not beside.is_file():
        return {}
    settings = json.loads(read_plain_text(beside))["camera_settings"][0]
    return {**settings["captured_image_size"], "intrinsics": settings["intrinsic_settings"]}
