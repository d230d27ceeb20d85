"""Content of a synthetic scene before it is rendered."""

from __future__ import annotations

from dataclasses import dataclass, field

from pomona.executive.values.arrays import Float32, Float64
from pomona.tools.training.options import SceneKind
from pomona.tools.training.shapes import ShadedMesh


@dataclass(slots=True)
class Item:
    """One thing of a scene: shape, pose [m] and paint."""

    shape: ShadedMesh
    rotation: Float64
    scale: Float64
    centre: Float64
    albedo: Float32
    grain_frequency: float
    material: tuple[float, float, float]
    fruit: int = -1
    openness: float = 1.0


@dataclass(slots=True)
class SyntheticScene:
    """A scene to render: camera, things, and the truth about the fruit among them."""

    kind: SceneKind
    T_world_camera: Float64
    table: bool
    items: list[Item] = field(default_factory=list)
    spheres: list[tuple[Float64, float]] = field(default_factory=list)
    truths: list[tuple[Float64, Float64, Float64, bool]] = field(default_factory=list)
    decoys: list[tuple[Float64, float]] = field(default_factory=list)
