"""What stands in a synthetic scene before it is rendered."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skills.perception.synthetic.options import SceneKind
from skills.perception.synthetic.shapes import ShadedMesh

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


@dataclass(slots=True)
class Item:
    """One thing of a scene: shape, pose [m] and paint."""

    shape: ShadedMesh
    rotation: F64
    scale: F64
    centre: F64
    albedo: F32
    grain_frequency: float
    material: tuple[float, float, float]
    fruit: int = -1
    openness: float = 1.0


@dataclass(slots=True)
class SyntheticScene:
    """What is rendered: camera, things, and the truth about the fruit among them."""

    kind: SceneKind
    T_world_camera: F64
    table: bool
    items: list[Item] = field(default_factory=list)
    spheres: list[tuple[F64, float]] = field(default_factory=list)
    truths: list[tuple[F64, F64, F64, bool]] = field(default_factory=list)
    decoys: list[tuple[F64, float]] = field(default_factory=list)
