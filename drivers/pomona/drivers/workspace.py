"""The `workspace:` of a cell file: table, mapped volume, obstacles, also of meshes, and named poses, in the base frame.

A hull contains its part, so a coarse cut keeps the arm too far away, never too near.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from pomona.drivers.errors import UnusableMesh
from pomona.drivers.interfaces import Box, Hull, PathWatchSettings, Workspace
from pomona.executive.values.arrays import Float64, Int64
from pomona.executive.values.kinds import ListOf, MappingOf, Measure, PathTo, Row, Text
from pomona.executive.values.mesh_file import MOST_TRIANGLES, UnreadableMeshError, read_mesh
from pomona.executive.values.sections import Problem, Section, value
from pomona.executive.values.units import ANGLE, LENGTH, SPEED, TIME

# sizes of anything that an arm may hit [m]; else the unit is another
LARGEST = 20.0
SMALLEST = 0.002
NARROW = 0.1  # inside of a crate below which no hand with open fingers goes in [m]
TOUCH = 1e-3  # depth to which neighbours may overlap, by rounding [m]
MOST_PARTS = 400  # each costs every collision check about as much as a box


def read_parts(path: Path, unit: float = 1.0, detail: float | None = None) -> tuple[Hull, ...]:
    """Read the parts of a mesh file (STL, OBJ, PLY), in its own frame; `unit` is that of its numbers [m].

    Its surface is cut by cubes with the edge `detail` [m]; None: each body of the file is one part.

    Raises UnusableMesh: no mesh can be read, it is empty, or its size is impossible in this unit.
    """
    try:
        state = path.stat()
    except OSError as error:
        raise UnusableMesh(f"{path} cannot be read: {error.strerror}") from error
    return _parts(path, state.st_mtime_ns, state.st_size, unit, detail)


@lru_cache(maxsize=16)
def _parts(
    path: Path, _changed: int, _size: int, unit: float, detail: float | None
) -> tuple[Hull, ...]:
    vertices, faces = _triangles(path)
    vertices = vertices * unit
    size = vertices.max(axis=0) - vertices.min(axis=0)
    told = f"{path.name} is {' x '.join(f'{edge:.4g}' for edge in size)} m large"
    if size.max() > LARGEST:
        raise UnusableMesh(f"{told}: if it is in millimetres, write `unit: mm`")
    if size.max() < SMALLEST:
        raise UnusableMesh(f"{told}: if it is in metres, write `unit: m`")
    groups = (
        _bodies(vertices, faces) if detail is None else _cubes(vertices, faces, detail, path.name)
    )
    if len(groups) > MOST_PARTS:
        what = (
            "bodies: join them, or cut it with `detail`"
            if detail is None
            else "parts: take a coarser `detail`"
        )
        raise UnusableMesh(
            f"{path.name} has {len(groups)} {what}; {MOST_PARTS} parts are taken at most"
        )
    return tuple(_hull(path.stem, corners) for corners in groups)


def _triangles(path: Path) -> tuple[Float64, Int64]:
    """Vertices (n, 3) and faces (m, 3) that use them all."""
    try:
        vertices, faces = read_mesh(path)
    except UnreadableMeshError as error:
        raise UnusableMesh(f"{path.name} {error}") from error
    used, numbers = np.unique(faces, return_inverse=True)
    if not np.isfinite(vertices[used]).all():
        raise UnusableMesh(f"{path.name} has vertices that are not finite numbers")
    return vertices[used], numbers.reshape(faces.shape)


def _bodies(vertices: Float64, faces: Int64) -> list[Float64]:
    """Return the triangles (m, 3, 3) of each connected body."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    _same, welded = np.unique(
        np.round(vertices, 6), axis=0, return_inverse=True
    )  # STL repeats its corners
    joined = welded.reshape(-1)[faces]
    ends = joined[:, [0, 0]], joined[:, [1, 2]]
    count = int(joined.max()) + 1
    edges = coo_array(
        (np.ones(2 * len(faces)), (ends[0].ravel(), ends[1].ravel())), shape=(count, count)
    )
    label = connected_components(edges, directed=False)[1][joined[:, 0]]
    return [vertices[faces[label == body]] for body in np.unique(label)]


def _cubes(vertices: Float64, faces: Int64, detail: float, name: str) -> list[Float64]:
    """Return triangles (m, 3, 3) of each cube of the surface, cut until none is longer than a cube's edge."""
    triangles = vertices[faces]
    while len(triangles):
        sides = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = sides.max(axis=1) > detail
        if not long.any():
            break
        if len(triangles) + long.sum() > MOST_TRIANGLES:
            raise UnusableMesh(f"{name} has too many parts: take a coarser `detail`")
        triangles = np.concatenate(
            (triangles[~long], _halved(triangles[long], sides[long].argmax(axis=1)))
        )
    cube = np.floor(triangles.mean(axis=1) / detail).astype(np.int64)
    _cubes_there, label = np.unique(cube, axis=0, return_inverse=True)
    order = np.argsort(label.reshape(-1), kind="stable")
    return np.split(triangles[order], np.flatnonzero(np.diff(label.reshape(-1)[order])) + 1)


def _halved(triangles: Float64, longest: Int64) -> Float64:
    """Return each triangle (m, 3, 3) as two, cut at the middle of its side from corner `longest` to the next."""
    rows = np.arange(len(triangles))
    a, b, c = (triangles[rows, (longest + k) % 3] for k in range(3))
    middle = (a + b) / 2.0
    return np.concatenate((np.stack((a, middle, c), axis=1), np.stack((middle, b, c), axis=1)))


def _hull(name: str, triangles: Float64) -> Hull:
    """Return the hull of a part: its corners, and the normals of its largest faces."""
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(across, axis=1)
    known = area > 1e-12
    looks, of = np.unique(
        np.round(across[known] / area[known, None], 3), axis=0, return_inverse=True
    )
    weight = np.bincount(of.reshape(-1), area[known], len(looks))
    # Maximum number of face directions that define a part's hull, the largest faces first; others round it off
    largest = looks[np.argsort(-weight, kind="stable")[:64]]
    normals = np.concatenate((largest, -largest))  # of a sheet both sides, however it is wound
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Hull(name, np.unique(triangles.reshape(-1, 3), axis=0), normals)


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleSection:
    """A solid box; with `wall` a crate: open at the top, floor and walls of that thickness, its size the outer one."""

    name: str = value(Text(), help="skills call it so: 'crate'")
    centre: tuple[float, ...] = value(
        Row(Measure(LENGTH), 3), help="of the whole box, in the base frame"
    )
    size: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="outer size along x, y and z")
    yaw: float = value(Measure(ANGLE), "0 rad", "turned about z")
    wall: float | None = value(
        Measure(LENGTH, "0.1 mm"), None, "thickness of a crate's floor and walls"
    )

    def problems(self) -> Iterator[Problem]:
        if min(self.size) <= 0.0:
            yield Problem("size", "a box has three positive sizes")
        elif self.wall is not None and (
            2.0 * self.wall >= min(self.size[:2]) or self.wall >= self.size[2]
        ):
            yield Problem("wall", "the walls of a crate leave room between them")
        elif max(self.size) > LARGEST:
            edges = " x ".join(f"{edge:.4g}" for edge in self.size)
            yield Problem("size", f"it is {edges} m large: if it is in millimetres, write mm")
        elif self.wall is not None and (inside := min(self.size[:2]) - 2.0 * self.wall) < NARROW:
            words = f"its inside is {1e3 * inside:.0f} mm wide: no hand goes in beside a fruit"
            yield Problem("size", words, warning=True)

    def boxes(self) -> tuple[Box, ...]:
        """Return the solids that it is made of, all of one name."""
        T_base_box = np.eye(4)
        T_base_box[:3, 3] = self.centre
        cos = np.cos(self.yaw)
        sin = np.sin(self.yaw)
        T_base_box[:2, :2] = [[cos, -sin], [sin, cos]]
        size = np.array(self.size)
        if self.wall is None:
            return (_box(self.name, T_base_box, np.zeros(3), size),)
        return _crate(self.name, T_base_box, size, self.wall)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSection:
    """A mesh of the surroundings, from CAD or a scan. Convex hulls of its parts are obstacles."""

    name: str = value(Text(), help="refusals call it so: 'shelf'")
    file: Path = value(PathTo("file"), help="STL, OBJ or PLY")
    unit: str = value(Text("m", "mm"), "m", "unit of the file's numbers")
    at: tuple[float, ...] = value(
        Row(Measure(LENGTH), 3), (0.0, 0.0, 0.0), "where its origin is, in the base frame"
    )
    rpy: tuple[float, ...] = value(
        Row(Measure(ANGLE), 3), (0.0, 0.0, 0.0), "turned about the base's x, then y, then z"
    )
    detail: float | None = value(
        Measure(LENGTH, "5 mm"),
        None,
        "cut the surface into cubes of this edge; without it each body is one hull",
    )

    def problems(self) -> Iterator[Problem]:
        try:
            self.parts()
        except UnusableMesh as error:
            yield Problem("file", str(error))

    def parts(self) -> tuple[Hull, ...]:
        """Return its hulls, in the base frame. Raises UnusableMesh: the file holds no mesh that can be used."""
        from scipy.spatial.transform import Rotation

        R: Float64 = Rotation.from_euler("xyz", self.rpy).as_matrix()
        return tuple(
            Hull(self.name, part.points @ R.T + self.at, part.normals @ R.T)
            for part in read_parts(self.file, {"m": 1.0, "mm": 1e-3}[self.unit], self.detail)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoneSection:
    """A box along the axes of the base frame in which nothing of the robot, and nothing that it holds, may be."""

    name: str = value(Text(), help="the zone's name in messages, such as 'window'")
    lower: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="corner of the zone")
    upper: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="the opposite corner")

    def problems(self) -> Iterator[Problem]:
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            yield Problem("upper", "it must lie above the zone's lower in x, y and z")

    def box(self) -> Box:
        """For the skills."""
        lower = np.array(self.lower)
        upper = np.array(self.upper)
        T_base_box = np.eye(4)
        T_base_box[:3, 3] = (lower + upper) / 2.0
        return _box(f"zone {self.name}", T_base_box, np.zeros(3), upper - lower)


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchSection:
    """Comparison of the rest of a path with the camera images while the arm follows it. No safety function."""

    speed: float = value(
        Measure(SPEED, "0 m/s", "10 m/s"), "1.6 m/s", "expected approach speed of moving objects"
    )
    near: float = value(
        Measure(LENGTH, "20 mm", "500 mm"), "30 mm", "distance to unmapped standing objects"
    )
    padding: float = value(
        Measure(LENGTH, "20 mm", "200 mm"),
        "30 mm",
        "around the robot; nearer points count as the robot itself",
    )
    delay: float = value(
        Measure(TIME, "0 s", "2 s"),
        "50 ms",
        "from a look at a frame until the arm begins to brake; measure yours",
    )
    passing: tuple[ZoneSection, ...] = value(
        ListOf(Section(ZoneSection)), (), "volumes of a belt's goods: not watched"
    )

    def settings(self) -> PathWatchSettings:
        """For the skills."""
        return PathWatchSettings(
            self.speed, self.near, self.padding, self.delay, tuple(v.box() for v in self.passing)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceSection:
    """Known surroundings of the arm, in its base frame."""

    table_z: float | None = value(
        Measure(LENGTH), None, "height of the table's surface; no table without it"
    )
    lower: tuple[float, ...] = value(
        Row(Measure(LENGTH), 3), help="corner of the volume that is mapped and moved in"
    )
    upper: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="the opposite corner")
    obstacles: tuple[ObstacleSection, ...] = value(
        ListOf(Section(ObstacleSection)), (), "fixed geometry that no camera needs to see"
    )
    meshes: tuple[MeshSection, ...] = value(
        ListOf(Section(MeshSection)),
        (),
        "fixed geometry as meshes; a simulated world does not have it",
    )
    zones: tuple[ZoneSection, ...] = value(
        ListOf(Section(ZoneSection)),
        (),
        "where nothing of the robot, and nothing that it holds, may be",
    )
    poses: Mapping[str, tuple[float, ...]] = value(
        MappingOf(Row(Measure(ANGLE))), {}, "joints, by the pose's name"
    )
    watch: WatchSection | None = value(
        Section(WatchSection), None, "watch of paths while the arm moves; off if omitted"
    )

    def problems(self) -> Iterator[Problem]:
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            yield Problem("upper", "it must lie above workspace.lower in x, y and z")
        names = [zone.name for zone in self.zones]
        if len(set(names)) < len(names):
            yield Problem("zones", "two zones have one name, so that messages would be ambiguous")
        for number, crate in enumerate(self.obstacles, 1):
            if crate.wall is not None and (words := self._misplaced(crate)):
                yield Problem(f"obstacles.{number}", f"the crate '{crate.name}' {words}")

    def _misplaced(self, crate: ObstacleSection) -> str:
        """Return why fruit cannot be in a crate at its place, empty if it can."""
        boxes = crate.boxes()
        reach = np.abs(boxes[0].T_base_box[:3, :3]) @ crate.size / 2.0
        low = crate.centre - reach
        high = crate.centre + reach
        if (low[:2] < np.subtract(self.lower[:2], TOUCH)).any() or (
            high > np.add(self.upper, TOUCH)
        ).any():
            return (
                "leaves the volume from workspace.lower to workspace.upper, in which the arm moves"
            )
        floor = self.lower[2] if self.table_z is None else self.table_z
        if low[2] < floor - TOUCH:
            return f"is {1e3 * (floor - low[2]):.0f} mm under the table"
        others = [other for other in self.obstacles if other is not crate]
        if any(other.name == crate.name for other in others):
            return "has the name of another obstacle"
        near = (
            other.name
            for other in others
            if any(_overlap(a, b) for a in boxes for b in other.boxes())
        )
        return "".join([f"overlaps the obstacle '{name}'" for name in near][:1])

    def workspace(self) -> Workspace:
        """For the skills."""
        return Workspace(
            table_z=self.table_z,
            lower=np.array(self.lower),
            upper=np.array(self.upper),
            obstacles=tuple(box for obstacle in self.obstacles for box in obstacle.boxes()),
            poses={name: np.array(q) for name, q in self.poses.items()},
            zones=tuple(zone.box() for zone in self.zones),
            hulls=tuple(part for mesh in self.meshes for part in mesh.parts()),
            watch=None if self.watch is None else self.watch.settings(),
        )


def _crate(name: str, T_base_crate: Float64, size: Float64, wall: float) -> tuple[Box, ...]:
    """Floor, then walls."""
    x, y, z = size
    middle = (x - wall) / 2.0, (y - wall) / 2.0
    return (
        _box(name, T_base_crate, np.array([0.0, 0.0, (wall - z) / 2.0]), np.array([x, y, wall])),
        *(
            _box(name, T_base_crate, np.array([side * middle[0], 0.0, 0.0]), np.array([wall, y, z]))
            for side in (-1, 1)
        ),
        *(
            _box(name, T_base_crate, np.array([0.0, side * middle[1], 0.0]), np.array([x, wall, z]))
            for side in (-1, 1)
        ),
    )


def _overlap(a: Box, b: Box) -> bool:
    """Return True if two boxes that are turned about z only overlap by more than `TOUCH` along each of their axes."""
    axes = np.hstack((a.T_base_box[:3, :3], b.T_base_box[:3, :3])).T
    reach = sum(np.abs(axes @ box.T_base_box[:3, :3]) @ box.half_extents for box in (a, b))
    between = np.abs(axes @ (a.T_base_box[:3, 3] - b.T_base_box[:3, 3]))
    return bool((between < reach - TOUCH).all())


def _box(name: str, T_base_whole: Float64, offset: Float64, size: Float64) -> Box:
    """Return a part of an object whose pose is given, `offset` from its centre."""
    T_base_box = T_base_whole.copy()
    T_base_box[:3, 3] += T_base_whole[:3, :3] @ offset
    return Box(name, T_base_box, (float(size[0]) / 2.0, float(size[1]) / 2.0, float(size[2]) / 2.0))
