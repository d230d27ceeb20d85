"""One fruit of the simulated world: a mesh, its own or that of its model, stretched to size and slightly deformed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.fruit_body import FruitBody
from pomona.executive.values.arrays import Float64
from pomona.executive.values.documents import read_value_file
from pomona.executive.values.findings import Findings, place_of
from pomona.executive.values.later import Later
from pomona.executive.values.mesh_file import UnreadableMeshError, read_mesh
from pomona.executive.values.sections import Problem, Section
from pomona.executive.values.yaml_nodes import Refused

cv2: Any = Later("cv2")

Faces = NDArray[np.int32]

OF_PERCEPTION = (
    "name",
    "dimensions",
    "symmetry_axis",
    "colour",
    "mass",
    "mass_spread",
    "weights",
    "photo_weights",
    "sizes",
)
"""Further keys of a fruit.yaml, which the skills read."""


class UnusableModel(ValueError):
    """A folder that holds no model of a fruit: where and why."""


@dataclass(frozen=True, slots=True, eq=False)
class FruitMeshes:
    """Flesh and stem in the object frame: vertices (n, 3) [m] and faces (m, 3) each; the pressure that it bears [Pa]."""

    flesh: tuple[Float64, Faces]
    stem: tuple[Float64, Faces] | None
    pressure: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _ModelSection(FruitBody):
    """What the simulated world reads of a fruit.yaml."""

    def problems(self) -> Iterator[Problem]:
        for key, path in (("mesh", self.mesh), ("stem", self.stem)):
            try:
                if path is not None:
                    _load(path, path.stat().st_mtime_ns)
            except UnusableModel as error:
                yield Problem(key, str(error))


def read_model(folder: Path) -> FruitMeshes:
    """Return the meshes of a fruit's folder. Raises UnusableModel: its fruit.yaml or a mesh cannot be read."""
    findings = Findings()
    written = read_value_file(folder / "fruit.yaml", findings, "a fruit file")
    try:
        said = (
            None
            if written is None
            else Section(_ModelSection, OF_PERCEPTION).read(written.root, written.reader)
        )
    except Refused:
        said = None
    if said is None:
        first = findings.sorted()[0]
        raise UnusableModel(f"{place_of(first)}: {first.message}")
    stem = None if said.stem is None else _load(said.stem, said.stem.stat().st_mtime_ns)
    return FruitMeshes(_load(said.mesh, said.mesh.stat().st_mtime_ns), stem, said.pressure)


@lru_cache(maxsize=16)
def _load(path: Path, _changed: int) -> tuple[Float64, Faces]:
    try:
        vertices, numbers = read_mesh(path)
    except UnreadableMeshError as error:
        raise UnusableModel(f"{path.name} {error}") from error
    faces = numbers.astype(np.int32)
    if not np.all(np.isfinite(vertices)) or np.ptp(vertices, axis=0).min() <= 0.0:
        raise UnusableModel(f"{path.name} is empty or flat")
    vertices.setflags(write=False)
    return vertices, faces


APPLES = ("red", "striped", "yellow", "green")  # skins that are drawn where none is asked for

# ground colour, blush colour, how much of the skin is blushed
SKINS: dict[str, tuple[tuple[float, float, float], tuple[float, float, float], float]] = {
    "red": ((0.72, 0.22, 0.12), (0.55, 0.05, 0.07), 0.75),
    "striped": ((0.85, 0.62, 0.25), (0.70, 0.10, 0.10), 0.55),
    "yellow": ((0.86, 0.74, 0.28), (0.85, 0.40, 0.20), 0.25),
    "green": ((0.52, 0.66, 0.20), (0.66, 0.60, 0.22), 0.15),
    "lemon": ((0.88, 0.76, 0.16), (0.80, 0.66, 0.10), 0.30),
}

_TEXTURE = (128, 256)  # rows from stem to calyx, columns around the axis


@dataclass(frozen=True, slots=True, eq=False)
class FruitShape:
    """A fruit in its object frame: origin at the cuboid's centre, x right, y down, z forward, stem along -y."""

    vertices: Float64  # flesh, (n, 3) [m]; vertices on the texture's seam appear twice
    faces: NDArray[np.int32]  # (m, 3) int32, normals outwards
    uv: Float64  # texture coordinates, (n, 2)
    dimensions: Float64  # cuboid (d_x, d_y, d_z) of the flesh [m]
    texture: NDArray[np.uint8]  # RGB, (rows, columns, 3), uint8
    stem: (
        tuple[Float64, NDArray[np.int32]] | None
    )  # vertices (k, 3) [m] and faces of the stem, or None
    pressure: float  # that it bears [Pa]


def make_fruit(
    model: Path, dimensions: Float64, skin: str, rng: np.random.Generator, shape_noise: float = 1.0
) -> FruitShape:
    """Return a fruit by the model in a folder with fruit.yaml, of the given size (d_x, d_y, d_z) [m].

    With 0 for `shape_noise` it keeps the model's form, with 1 it is as uneven as an ordinary one.
    """
    meshes = read_model(model)
    vertices, triangles = meshes.flesh
    scale = dimensions / np.ptp(vertices, axis=0)
    deformed = _deform(vertices, rng, shape_noise)
    extents = np.ptp(deformed, axis=0)
    centre = (deformed.max(axis=0) + deformed.min(axis=0)) / 2.0
    fitted = (deformed - centre) * (dimensions / extents)
    stem = None
    if meshes.stem is not None:
        stem = (meshes.stem[0] * scale, meshes.stem[1])
    vertices, faces, uv = _unwrap(fitted, triangles)
    painted = _paint(skin, rng)
    return FruitShape(vertices, faces, uv, dimensions.copy(), painted, stem, meshes.pressure)


def _deform(vertices: Float64, rng: np.random.Generator, shape_noise: float) -> Float64:
    """Low harmonics around the axis and a slight lean: no two apples are alike, and none is a body of revolution."""
    angle = np.arctan2(vertices[:, 2], vertices[:, 0])
    height = vertices[:, 1] / np.abs(vertices[:, 1]).max()
    radial = np.ones(len(vertices))
    for k in (2, 3, 5):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        radial += (
            rng.normal(0.0, shape_noise * 0.012 / np.sqrt(k))
            * np.cos(k * angle + phase)
            * (1.0 - 0.5 * height**2)
        )
    deformed = vertices.copy()
    deformed[:, 0] *= radial
    deformed[:, 2] *= radial
    lean = rng.normal(0.0, shape_noise * 0.03, 2)
    deformed[:, 1] *= 1.0 + lean[0] * vertices[:, 0] / 0.05 + lean[1] * vertices[:, 2] / 0.05
    return deformed


def _unwrap(
    vertices: Float64, faces: NDArray[np.int32]
) -> tuple[Float64, NDArray[np.int32], Float64]:
    """Cylindrical texture coordinates; triangles across the seam get vertices of their own with u beyond 1."""
    u = np.arctan2(vertices[:, 2], vertices[:, 0]) / (2.0 * np.pi) + 0.5
    v = (vertices[:, 1] - vertices[:, 1].min()) / np.ptp(vertices[:, 1])
    corner = u[faces]
    wraps = np.any(corner > 0.75, axis=1, keepdims=True) & (corner < 0.25)
    moved = np.unique(faces[wraps])
    twin = np.full(len(vertices), -1, np.int32)
    twin[moved] = len(vertices) + np.arange(len(moved), dtype=np.int32)
    split = np.where(wraps, twin[faces], faces).astype(np.int32)
    uv = np.column_stack([np.concatenate([u, u[moved] + 1.0]), np.concatenate([v, v[moved]])])
    return np.concatenate([vertices, vertices[moved]]), split, uv


def _paint(skin: str, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Ground colour, a blush on the sunny side in streaks along the meridians, lenticels, greenish cavities."""
    ground, blush, share = SKINS[skin]
    rows, columns = _TEXTURE
    v = np.linspace(0.0, 1.0, rows)[:, None]
    u = np.linspace(0.0, 2.0 * np.pi, columns, endpoint=False)[None, :]
    streaks = _wrapped_noise(rng, 0.8, 9.0) * 0.35 + _wrapped_noise(rng, 10.0, 8.0) * 0.5
    sunny = (
        np.cos(u - rng.uniform(0.0, 2.0 * np.pi)) * (1.0 - share) + 2.4 * (share - 0.5) + streaks
    )
    weight = 1.0 / (1.0 + np.exp(-3.5 * sunny))
    tint = 1.0 + rng.normal(0.0, 0.05, 3)
    colour = (np.array(ground) * tint) * (1.0 - weight[..., None]) + (
        np.array(blush) * tint
    ) * weight[..., None]
    cavity = np.clip((0.07 - v) / 0.07, 0.0, 1.0) + np.clip((v - 0.95) / 0.05, 0.0, 1.0)
    colour += (np.array([0.42, 0.38, 0.16]) - colour) * (0.6 * cavity * np.ones_like(u))[..., None]
    dots = rng.random(_TEXTURE) < 0.006
    colour[dots] += (np.array([0.85, 0.75, 0.5]) - colour[dots]) * 0.4
    colour *= 1.0 + 0.04 * _wrapped_noise(rng, 2.0, 2.0)[..., None]
    painted: NDArray[np.uint8] = (np.clip(colour, 0.0, 1.0) * 255.0).astype(np.uint8)
    return painted


def _wrapped_noise(rng: np.random.Generator, across: float, along: float) -> Float64:
    """Smooth noise of unit deviation that closes around the axis; widths of the blur in texels."""
    noise = np.tile(rng.normal(size=_TEXTURE), (1, 3))
    blurred = cv2.GaussianBlur(noise, (0, 0), sigmaX=across, sigmaY=along)[
        :, _TEXTURE[1] : 2 * _TEXTURE[1]
    ]
    unit: Float64 = blurred / blurred.std()
    return unit
