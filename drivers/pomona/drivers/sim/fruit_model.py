"""Meshes of a fruit's model for a simulated world: `mesh` and `stem` of a fruit.yaml."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.documents import read_value_file
from pomona.executive.values.findings import Findings, place_of
from pomona.executive.values.kinds import PathTo
from pomona.executive.values.mesh_file import UnreadableMeshError, read_mesh
from pomona.executive.values.sections import Problem, Section, value
from pomona.executive.values.yaml_nodes import Refused

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
    """Flesh and stem in the object frame: vertices (n, 3) [m] and faces (m, 3) each."""

    flesh: tuple[Float64, Faces]
    stem: tuple[Float64, Faces] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _ModelSection:
    """The meshes that a fruit.yaml names."""

    mesh: Path = value(PathTo("file"), help="the flesh")
    stem: Path | None = value(PathTo("file"), None, "the stem")

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
        said = None if written is None else Section(_ModelSection, OF_PERCEPTION).read(written.root, written.reader)
    except Refused:
        said = None
    if said is None:
        first = findings.sorted()[0]
        raise UnusableModel(f"{place_of(first)}: {first.message}")
    stem = None if said.stem is None else _load(said.stem, said.stem.stat().st_mtime_ns)
    return FruitMeshes(_load(said.mesh, said.mesh.stat().st_mtime_ns), stem)


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
