"""Errors of the fruit catalogue.

FruitError
├── UnknownFruit      no such name in the catalogue
└── BadFruitFile      a fruit.yaml, or the mesh it names, that cannot be read
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.fruit_body import FruitBody
from pomona.executive.values.archives import open_archive
from pomona.executive.values.arrays import Float64
from pomona.executive.values.documents import read_value_file, with_includes
from pomona.executive.values.findings import Finding, Findings, did_you_mean, format_findings
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.kinds import Measure, Number, Row, Schema, Text
from pomona.executive.values.mesh_file import UnreadableMeshError, read_mesh
from pomona.executive.values.plain_text import is_file
from pomona.executive.values.sections import Problem, Section, value
from pomona.executive.values.units import LENGTH, MASS, PRESSURE, RATIO, Array
from pomona.executive.values.yaml_nodes import Refused
from pomona.skills.perception.fruit.sizes import KindSizes


class FruitError(Exception):
    """Root of this package's errors."""


class UnknownFruit(FruitError):
    """The catalogue has no fruit of this name."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name = name
        self.known = known
        hint = did_you_mean(name, known)
        there = f"the catalogue has {', '.join(known) or 'none'}"
        super().__init__(f"no fruit named '{name}'; {hint + ' ' if hint else ''}{there}")


class BadFruitFile(FruitError):
    """A fruit file that cannot be used, with everything that was found in it."""

    def __init__(self, path: Path, findings: Sequence[Finding]) -> None:
        self.path, self.findings = path, tuple(findings)
        super().__init__(format_findings(self.findings))


CATALOGUE = installed_trees() / "fruits"
MOST_WEIGHTS = 256 << 20  # of a file of weights, unpacked, of whichever kind [byte]
SHIPPED_WEIGHTS = Path(__file__).resolve().parents[1] / "detection" / "weights"


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
        pressure: of a contact, up to which the fruit is not bruised [Pa].
        weights: the detector's weights for this fruit, None when there are none yet.
        photo_weights: weights that suit photographs better than `weights`, for `pomona detect`; None without any.
        stem: the stem in the object frame, for pictures only; None when the fruit has none.
        colour: typical colour of the flesh, RGB in 0..1.
        sizes: distribution of size and height over width of this kind, if it was learnt.
        mass: of a fruit of the model's size [kg]; None if no fruit was weighed.
        mass_spread: relative standard deviation of it among fruit of one size.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    dimensions: Annotated[NDArray[np.float64], Array(3, of=LENGTH)]
    symmetry_axis: Annotated[NDArray[np.float64], Array(3)]
    pressure: Annotated[float, PRESSURE]
    weights: Path | None = None
    stem: Mesh | None = None
    colour: tuple[float, float, float] = (0.7, 0.1, 0.1)
    sizes: KindSizes | None = None
    mass: Annotated[float | None, MASS] = None
    mass_spread: Annotated[float, RATIO] = 0.1
    photo_weights: Path | None = None

    @property
    def mesh(self) -> Mesh:
        """The flesh as a mesh."""
        return Mesh(self.vertices, self.faces)


def known_fruits(catalogue: Path = CATALOGUE) -> tuple[str, ...]:
    """Return names of the fruit in a catalogue folder, sorted."""
    return tuple(sorted(file.parent.name for file in catalogue.glob("*/fruit.yaml")))


@dataclass(frozen=True, slots=True, kw_only=True)
class SizesSection:
    """Sizes of a kind, from fruit of it that were measured by hand; each deviation is a share."""

    width: float = value(Measure(LENGTH, "1 mm", "1 m"), help="median of the horizontal dimension")
    width_deviation: float = value(Number(1e-3, 1.0), help="standard deviation of ln width")
    height_over_width: float = value(Number(0.1, 10.0), help="median of the proportion")
    height_over_width_deviation: float = value(
        Number(1e-3, 1.0), help="standard deviation of its logarithm"
    )
    looks: float = value(Number(0.2, 5.0), 1.0, "width that a scaled model shows over the true one")
    looks_deviation: float = value(Number(0.0, 1.0), 0.0, "standard deviation of its logarithm")

    def sizes(self) -> KindSizes:
        """For the fruit's model."""
        return KindSizes(**{f.name: getattr(self, f.name) for f in fields(KindSizes)})


@dataclass(frozen=True, slots=True, kw_only=True)
class FruitFileSection(FruitBody):
    """A kind of fruit: its CAD model in the object frame, and the weights of its detector."""

    name: str = value(Text(), help="its name in the catalogue, as its folder is called")
    dimensions: tuple[float, ...] = value(
        Row(Measure(LENGTH, "1 mm", "1 m"), 3), help="of the cuboid along x, y and z"
    )
    symmetry_axis: tuple[float, ...] = value(
        Row(Number(-1.0, 1.0), 3), help="of revolution, towards the stem"
    )
    colour: tuple[float, ...] = value(
        Row(Number(0.0, 1.0), 3), (0.7, 0.1, 0.1), "typical, RGB from 0 to 1"
    )
    mass: float | None = value(
        Measure(MASS, "1 g", "10 kg"), None, "of a fruit of these dimensions, weighed"
    )
    mass_spread: float = value(
        Number(0.0, 1.0), 0.1, "standard deviation of the mass among fruit of one size, a share"
    )
    weights: str | None = value(
        Text(), None, "of its detector: beside this file, or among those that are shipped"
    )
    photo_weights: str | None = value(
        Text(), None, "of its detector for photographs, found likewise"
    )
    sizes: SizesSection | None = value(
        Section(SizesSection), None, "of this kind, where they were learnt"
    )

    def problems(self) -> Iterator[Problem]:
        if np.linalg.norm(self.symmetry_axis) < 1e-9:
            yield Problem("symmetry_axis", "it is the zero vector, which has no direction")
        for key, path in (("mesh", self.mesh), ("stem", self.stem)):
            try:
                mesh = None if path is None else _read_mesh(path)
            except _BadMesh as error:
                yield Problem(key, str(error))
                continue
            if key == "mesh" and mesh is not None:
                yield from self._misfits(mesh)

    def _misfits(self, mesh: Mesh) -> Iterator[Problem]:
        extents = np.ptp(mesh.vertices, axis=0)
        # tolerance between a mesh's dimensions and those in the file [m]
        if np.any(np.abs(extents - self.dimensions) > 1e-4):
            measured = " ".join(f"{1e3 * size:.2f}" for size in extents)
            yield Problem("dimensions", f"the mesh measures {measured} mm", "a mesh is in metres")
        if np.any(np.abs(mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) > 2e-4):
            yield Problem(
                "mesh",
                f"the middle of {self.mesh.name} is not its origin",
                "move it by its bounding box",
            )
        closed, outwards = _surface(mesh)
        if not closed:
            yield Problem(
                "mesh", f"{self.mesh.name} has holes, or faces that do not meet", "close it"
            )
        elif not outwards:
            yield Problem(
                "mesh",
                f"the normals of {self.mesh.name} do not all point outwards",
                "turn its faces",
            )


FRUIT = Section(FruitFileSection)


class _BadMesh(ValueError):
    """A file that holds no mesh."""


def load_fruit(name_or_path: str | Path, catalogue: Path = CATALOGUE) -> FruitModel:
    """Load a fruit by its catalogue name, or from a folder or fruit.yaml anywhere.

    Raises:
        UnknownFruit: the catalogue has no such name and no such path exists.
        BadFruitFile: fruit.yaml or its mesh cannot be used; everything that is wrong, with places.
    """
    folder = catalogue / name_or_path
    if not is_file(folder / "fruit.yaml"):
        folder = Path(name_or_path)
        folder = folder.parent if folder.name == "fruit.yaml" else folder
    file = folder / "fruit.yaml"
    if not is_file(file):
        raise UnknownFruit(str(name_or_path), known_fruits(catalogue))
    findings = Findings()
    said = judge_fruit(file, findings)
    if said is None:
        raise BadFruitFile(file, findings.sorted())
    mesh = _read_mesh(said.mesh)
    axis = np.array(said.symmetry_axis)
    return FruitModel(
        name=said.name,
        vertices=mesh.vertices,
        faces=mesh.faces,
        dimensions=np.array(said.dimensions),
        symmetry_axis=axis / np.linalg.norm(axis),
        pressure=said.pressure,
        weights=find_weights(folder, said.weights),
        stem=None if said.stem is None else _read_mesh(said.stem),
        colour=(said.colour[0], said.colour[1], said.colour[2]),
        sizes=None if said.sizes is None else said.sizes.sizes(),
        mass=said.mass,
        mass_spread=said.mass_spread,
        photo_weights=find_weights(folder, said.photo_weights),
    )


def judge_fruit(file: Path, findings: Findings) -> FruitFileSection | None:
    """Read a fruit.yaml; all errors go to `findings`."""
    written = read_value_file(file, findings, "a fruit file")
    try:
        return None if written is None else FRUIT.read(written.root, written.reader)
    except Refused:
        return None


def damage(weights: Path) -> str:
    """Return the damage of a file of weights according to its checksums; an empty text for an intact file."""
    try:
        now = weights.stat()
        broken = _broken_member(weights, now.st_mtime_ns, now.st_size)
    except Exception as error:  # the errors of zipfile and zlib have no common base
        return str(error) or type(error).__name__
    return "" if broken is None else f"{broken} in it is damaged"


@lru_cache(maxsize=8)
def _broken_member(weights: Path, _changed: int, _size: int) -> str | None:
    with open_archive(weights, MOST_WEIGHTS) as archive:
        return archive.testzip()


class FruitKind:
    """Fruit files, for `pomona check` and `pomona schema`."""

    def recognises(self, keys: Collection[str]) -> bool:
        """Return True if a file with these keys at its top is one."""
        return "mesh" in keys and "symmetry_axis" in keys

    def check(self, path: Path, findings: Findings) -> None:
        """Everything that is wrong with a file, its meshes and its weights."""
        said = judge_fruit(path, findings)
        for name in ("weights", "photo_weights"):
            weights = None if said is None else find_weights(path.parent, getattr(said, name))
            if weights is not None and (problem := damage(weights)):
                findings.add(
                    Finding(str(weights), 0, 0, "error", name, f"cannot be read: {problem}")
                )

    def schema(self) -> Schema:
        """Return the JSON Schema of fruit files."""
        return {"title": "Pomona fruit file", **with_includes(FRUIT.schema())}


FRUIT_FILES = FruitKind()


def _read_mesh(path: Path) -> Mesh:
    try:
        return _load_mesh(path, path.stat().st_mtime_ns)
    except OSError as error:
        raise _BadMesh(f"{path.name} cannot be read: {error.strerror}") from error


@lru_cache(maxsize=8)
def _load_mesh(path: Path, _changed: int) -> Mesh:
    try:
        vertices, numbers = read_mesh(path)
    except UnreadableMeshError as error:
        raise _BadMesh(f"{path.name} {error}") from error
    if not np.all(np.isfinite(vertices)):
        raise _BadMesh(f"{path.name} is empty or holds values that are not finite")
    faces = numbers.astype(np.int32)
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return Mesh(vertices, faces)


@lru_cache(maxsize=8)
def _surface(mesh: Mesh) -> tuple[bool, bool]:
    """Return True if a mesh is closed, and whether all its normals point outwards."""
    _, same = np.unique(np.round(mesh.vertices, 8), axis=0, return_inverse=True)  # seams are joined
    corners = same.ravel()[mesh.faces].astype(np.int64)
    following = np.roll(corners, -1, axis=1)
    edges = corners * len(mesh.vertices) + following
    back = following * len(mesh.vertices) + corners
    _, shared = np.unique(np.minimum(edges, back), return_counts=True)
    _, directed = np.unique(edges, return_counts=True)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    volume = np.einsum("ij,ij->", a, np.cross(b, c))
    return bool((shared == 2).all()), bool((directed == 1).all() and volume > 0.0)


def find_weights(folder: Path, name: str | None) -> Path | None:
    """Return a weights file in this folder, else among the shipped ones."""
    if name is None:
        return None
    return next((path for path in (folder / name, SHIPPED_WEIGHTS / name) if is_file(path)), None)


def mass_of(
    fruit: FruitModel, dimensions: Float64, covariance: Float64
) -> tuple[float, float] | None:
    """Return the mass and its standard deviation [kg] by the dimensions, (3,) [m], and their covariance, (3, 3) [m²].

    The mean of weighed fruit of the model's size is scaled with the volume. None for a kind without weighed fruit.
    """
    if fruit.mass is None:
        return None
    mass = fruit.mass * float(np.prod(dimensions / fruit.dimensions))
    relative = 1.0 / dimensions  # d(ln m) / d(dimensions)
    return mass, mass * float(np.sqrt(relative @ covariance @ relative + fruit.mass_spread**2))
