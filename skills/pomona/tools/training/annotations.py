"""Annotation files of rendered frames, with the keys that DOPE's tools read: one JSON beside each picture."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.plain_text import read_plain_text
from pomona.executive.values.rotations import from_quaternion, to_quaternion
from pomona.skills.perception.detection.errors import DetectError


class BadTraining(DetectError):
    """A training that cannot go on, or not with these options."""

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(problem)


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedObject:
    """One object of a picture."""

    name: str  # its class
    visibility: float  # part of its silhouette that is seen, 0..1
    T_camera_object: Float64  # its pose [m]
    keypoints: Float64  # corners 0..7 and centroid, (9, 2) [px]
    scale: float  # size against the CAD model
    dimensions: Float64  # true cuboid [m]
    box: tuple[int, int, int, int]  # x, y, w, h of the visible pixels [px]; zeros when none


@dataclass(frozen=True, slots=True, eq=False)
class Annotation:
    """Annotation of one picture.

    Attributes:
        width, height: picture size [px].
        camera: fx, fy, cx, cy [px].
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
    """Read a JSON file of `write_annotation`.

    Raises BadTraining: no such file, no JSON, or other keys, such as those of frames that another tool rendered.
    """
    try:
        content = json.loads(read_plain_text(path))
        camera = content["camera_data"]
        k = camera["intrinsics"]
        return Annotation(
            width=int(camera["width"]),
            height=int(camera["height"]),
            camera=(float(k["fx"]), float(k["fy"]), float(k["cx"]), float(k["cy"])),
            objects=tuple(_object(item) for item in content["objects"]),
            decoys=tuple((float(u), float(v), float(r)) for u, v, r in content["decoys"]),
            scene=str(content["scene"]),
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        words = f"is no frame of `pomona data detect`: {error!r}"
        raise BadTraining(f"{path}: {words}") from error


def _object_json(item: AnnotatedObject) -> dict[str, Any]:
    rotation = item.T_camera_object[:3, :3]
    place = item.T_camera_object[:3, 3]
    return {
        "class": item.name,
        "visibility": round(item.visibility, 4),
        "location": [round(float(v), 6) for v in place],
        "quaternion_xyzw": [round(float(v), 7) for v in to_quaternion(rotation)],
        "projected_cuboid": [[round(float(u), 3), round(float(v), 3)] for u, v in item.keypoints],
        "projected_cuboid_centroid": [round(float(v), 3) for v in item.keypoints[8]],
        "scale": round(item.scale, 5),
        "dimensions": [round(float(v), 6) for v in item.dimensions],
        "bounding_box": list(item.box),
    }


def _object(item: dict[str, Any]) -> AnnotatedObject:
    points = np.asarray(item["projected_cuboid"], np.float64)
    if points.shape != (9, 2):
        raise ValueError(f"projected_cuboid must hold 9 points, not shape {points.shape}")
    T = np.eye(4)
    T[:3, :3] = from_quaternion(item["quaternion_xyzw"])
    T[:3, 3] = np.asarray(item["location"], np.float64)
    x, y, w, h = item["bounding_box"]
    return AnnotatedObject(
        name=str(item["class"]),
        visibility=float(item["visibility"]),
        T_camera_object=T,
        keypoints=points,
        scale=float(item["scale"]),
        dimensions=np.asarray(item["dimensions"], np.float64),
        box=(int(x), int(y), int(w), int(h)),
    )
