"""Fruit models: a folder with a fruit.yaml and its meshes, found by name or by path."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from numpy.typing import NDArray

from skills.perception.fruit.errors import BadFruitFile, UnknownFruit

CATALOGUE = Path(__file__).resolve().parents[3] / "trees" / "fruits"
SHIPPED_WEIGHTS = Path(__file__).resolve().parents[1] / "detection" / "weights"

_REQUIRED = {"name", "mesh", "dimensions", "symmetry_axis"}
_OPTIONAL = {"stem", "weights", "colour"}


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles in the object frame: vertices (n, 3) float64 [m], faces (m, 3) int32, normals outwards."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class FruitModel:
    """The CAD model of one kind of fruit.

    The object frame's origin is the centre of the cuboid, x right, y down, z forward: the stem axis points along -y.

    Attributes:
        name: its name in the catalogue.
        vertices: flesh without stem, watertight, (n, 3) float64 [m].
        faces: (m, 3) int32, normals outwards.
        dimensions: cuboid (d_x, d_y, d_z), d_y is the height [m].
        symmetry_axis: unit vector of the axis about which the fruit is nearly a body of revolution, towards the stem.
        weights: the detector's weights for this fruit, None when there are none yet.
        stem: the stem in the object frame, for pictures only; None when the fruit has none.
        colour: typical colour of the flesh, RGB in 0..1.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    dimensions: NDArray[np.float64]
    symmetry_axis: NDArray[np.float64]
    weights: Path | None = None
    stem: Mesh | None = None
    colour: tuple[float, float, float] = (0.7, 0.1, 0.1)

    @property
    def mesh(self) -> Mesh:
        """The flesh as a mesh."""
        return Mesh(self.vertices, self.faces)


def known_fruits(catalogue: Path = CATALOGUE) -> tuple[str, ...]:
    """Names of the fruit in a catalogue folder, sorted."""
    return tuple(sorted(file.parent.name for file in catalogue.glob("*/fruit.yaml")))


def load_fruit(name_or_path: str | Path, catalogue: Path = CATALOGUE) -> FruitModel:
    """Load a fruit by its catalogue name, or from a folder or fruit.yaml anywhere.

    Raises:
        UnknownFruit: the catalogue has no such name and no such path exists.
        BadFruitFile: fruit.yaml or its mesh cannot be read, or contradict each other.
    """
    folder = catalogue / name_or_path
    if not (folder / "fruit.yaml").is_file():
        folder = Path(name_or_path)
        folder = folder.parent if folder.name == "fruit.yaml" else folder
    file = folder / "fruit.yaml"
    if not file.is_file():
        raise UnknownFruit(str(name_or_path), known_fruits(catalogue))
    entry = _read_entry(file)
    mesh = _read_mesh(file, str(entry["mesh"]))
    dimensions = _vector(file, entry, "dimensions")
    axis = _vector(file, entry, "symmetry_axis")
    extents = np.ptp(mesh.vertices, axis=0)
    if np.any(dimensions <= 0.0) or np.any(np.abs(extents - dimensions) > 1e-4):
        raise BadFruitFile(
            file, f"dimensions {dimensions.tolist()} m, but the mesh measures {extents.round(5).tolist()} m"
        )
    if np.linalg.norm(axis) < 1e-9:
        raise BadFruitFile(file, "symmetry_axis must not be the zero vector")
    colour = _vector(file, entry, "colour") if "colour" in entry else np.array([0.7, 0.1, 0.1])
    return FruitModel(
        name=str(entry["name"]),
        vertices=mesh.vertices,
        faces=mesh.faces,
        dimensions=dimensions,
        symmetry_axis=axis / np.linalg.norm(axis),
        weights=_find_weights(folder, entry.get("weights")),
        stem=_read_mesh(file, str(entry["stem"])) if entry.get("stem") else None,
        colour=(float(colour[0]), float(colour[1]), float(colour[2])),
    )


def _read_entry(file: Path) -> dict[str, Any]:
    try:
        entry = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BadFruitFile(file, f"cannot be read: {error}") from error
    if not isinstance(entry, dict):
        raise BadFruitFile(file, f"must be a mapping with {', '.join(sorted(_REQUIRED))}")
    if missing := _REQUIRED - entry.keys():
        raise BadFruitFile(file, f"misses {', '.join(sorted(missing))}")
    if unknown := entry.keys() - _REQUIRED - _OPTIONAL:
        raise BadFruitFile(file, f"does not know {', '.join(sorted(map(str, unknown)))}")
    return entry


def _vector(file: Path, entry: dict[str, Any], key: str) -> NDArray[np.float64]:
    try:
        vector = np.asarray(entry[key], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BadFruitFile(file, f"{key} must be three numbers, not {entry[key]!r}") from error
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise BadFruitFile(file, f"{key} must be three finite numbers, not {entry[key]!r}")
    return vector


def _read_mesh(file: Path, name: str) -> Mesh:
    path = file.parent / name
    try:
        loaded = trimesh.load_mesh(path, process=False)
        vertices, faces = np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces, np.int32)
    except Exception as error:  # trimesh raises whatever the format's reader meets
        raise BadFruitFile(file, f"mesh {name} cannot be read: {error}") from error
    if len(vertices) == 0 or len(faces) == 0 or not np.all(np.isfinite(vertices)):
        raise BadFruitFile(file, f"mesh {name} is empty or holds values that are not finite")
    return Mesh(vertices, faces)


def _find_weights(folder: Path, name: str | None) -> Path | None:
    """A weights file beside fruit.yaml, else among the shipped ones."""
    if name is None:
        return None
    return next((path for path in (folder / name, SHIPPED_WEIGHTS / name) if path.is_file()), None)
