"""DOPE's config_pose.yaml: objects, and the constants of its post-processing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pomona.executive.values.plain_text import read_plain_text
from pomona.skills.perception.detection.errors import BadPoseConfig


@dataclass(frozen=True, slots=True)
class DecodeThresholds:
    """DOPE's post-processing constants, under the names that config_pose.yaml uses."""

    # largest difference between the unit direction to the centroid and the affinity
    thresh_angle: float = 0.5
    thresh_map: float = 0.01  # least smoothed belief of a peak
    sigma: float = 3.0  # of the smoothing [cells]
    thresh_points: float = 0.1  # least belief of a centroid or corner


SAME_SIZE = 0.05  # greatest relative difference between the sides of a configured cuboid and those of the fruit's mesh

_THRESHOLDS = ("thresh_angle", "thresh_map", "sigma", "thresh_points")


@dataclass(frozen=True, slots=True, eq=False)
class ObjectEntry:
    """One object of a config_pose.yaml."""

    name: str  # its key in the file
    weights: str  # as written: a path or URL; empty in files of DOPE's newer tools, which take weights as an option
    dimensions: NDArray[np.float64]  # cuboid [m]; the file gives centimetres


@dataclass(frozen=True, slots=True)
class PoseConfig:
    """A whole config_pose.yaml: objects by name, and how pictures are treated."""

    objects: dict[str, ObjectEntry]
    thresholds: DecodeThresholds
    downscale_height: int = 400


def load_pose_config(path: Path | str) -> PoseConfig:
    """Read a config_pose.yaml, plain or with its entries under `/dope: ros__parameters:` as in ROS 2 launches.

    Keys without a use in Detect (topics, frames, colours, meshes, camera settings) are ignored. The objects are those
    with weights; in a file without weights, as DOPE's tools under `train/` read it, those with dimensions.

    Raises BadPoseConfig: unreadable, without objects, or an object without dimensions.
    """
    content = _read(Path(path))
    weights = _table(path, content, "weights")
    dimensions = _table(path, content, "dimensions")
    if not dimensions:
        raise BadPoseConfig(
            path, "names no dimensions of any object, expected dimensions: {apple: [9.8, 8.5, 9.6]}"
        )
    objects = {}
    for name, source in (weights or dict.fromkeys(dimensions, "")).items():
        if name not in dimensions:
            raise BadPoseConfig(path, f"{name} has weights but no dimensions")
        objects[name] = ObjectEntry(
            name=name,
            weights=str(source),
            dimensions=_numbers(path, f"dimensions of {name}", dimensions[name], (3,)) / 100.0,
        )
    thresholds = {key: _number(path, key, content[key]) for key in _THRESHOLDS if key in content}
    downscale = round(_positive(path, "downscale_height", content.get("downscale_height", 400)))
    return PoseConfig(
        objects,
        DecodeThresholds(**thresholds),
        downscale,
    )


def find_entry(
    path: Path, fruit: str, dimensions: NDArray[np.float64]
) -> tuple[PoseConfig, ObjectEntry]:
    """Read a config_pose.yaml and the fruit's entry in it: that of its name, or the only one.

    Args:
        fruit: name.
        dimensions: of its mesh, (3,) [m].

    Raises BadPoseConfig: unreadable, without this fruit, or with a cuboid of another size.
    """
    config = load_pose_config(path)
    entry = config.objects.get(fruit)
    if entry is None and len(config.objects) == 1:
        entry = next(iter(config.objects.values()))
    if entry is None:
        raise BadPoseConfig(path, f"configures {', '.join(config.objects)}, not {fruit}")
    if np.any(np.abs(entry.dimensions - dimensions) > SAME_SIZE * dimensions):
        cuboid, mesh = (
            " × ".join(f"{100 * v:.1f}" for v in sides) for sides in (entry.dimensions, dimensions)
        )
        raise BadPoseConfig(
            path,
            f"{entry.name} is {cuboid} cm, the mesh of {fruit} {mesh} cm: they must be the same object",
        )
    return config, entry


def _read(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(read_plain_text(path))
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise BadPoseConfig(path, f"cannot be read: {error}") from error
    while (
        isinstance(content, dict)
        and len(content) == 1
        and not content.keys() & {"weights", "dimensions"}
    ):
        content = next(iter(content.values()))
    if not isinstance(content, dict):
        raise BadPoseConfig(path, "must be a mapping with weights and dimensions")
    return content


def _table(path: Path | str, content: dict[str, Any], key: str) -> dict[str, Any]:
    table = content.get(key) or {}
    if not isinstance(table, dict):
        raise BadPoseConfig(path, f"{key} must map objects to values")
    return table


def _numbers(
    path: Path | str, what: str, value: Any, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    try:
        numbers = np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        raise BadPoseConfig(path, f"{what} must be numbers, not {value!r}") from error
    if numbers.size == int(np.prod(shape)):
        numbers = numbers.reshape(shape)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        count = f"{' by '.join(map(str, shape))} finite numbers" if shape else "a finite number"
        raise BadPoseConfig(path, f"{what} must be {count}, not {value!r}")
    return numbers


def _number(path: Path | str, what: str, value: Any) -> float:
    return float(_numbers(path, what, value, ()))


def _positive(path: Path | str, what: str, value: Any) -> float:
    number = _number(path, what, value)
    if number <= 0.0:
        raise BadPoseConfig(path, f"{what} must be positive, not {value!r}")
    return number
