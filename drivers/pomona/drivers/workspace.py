"""The `workspace:` of a cell file: table, mapped volume, fixed obstacles and named poses, in the base frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.drivers.errors import UnusableMesh
from pomona.drivers.interfaces import Box, Hull, PathWatchSettings, Workspace
from pomona.drivers.scene_mesh import read_parts
from pomona.executive.values.arrays import Float64
from pomona.executive.values.kinds import ListOf, MappingOf, Measure, PathTo, Row, Text
from pomona.executive.values.sections import Problem, Section, value
from pomona.executive.values.units import ANGLE, LENGTH, SPEED, TIME


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleSection:
    """A solid box; with `wall` a crate: open at the top, floor and walls of that thickness, its size the outer one."""

    name: str = value(Text(), help="skills call it so: 'crate'")
    centre: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="of the whole box, in the base frame")
    size: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="outer size along x, y and z")
    yaw: float = value(Measure(ANGLE), "0 rad", "turned about z")
    wall: float | None = value(Measure(LENGTH, "0.1 mm"), None, "thickness of a crate's floor and walls")

    def problems(self) -> Iterator[Problem]:
        if min(self.size) <= 0.0:
            yield Problem("size", "a box has three positive sizes")
        elif self.wall is not None and (2.0 * self.wall >= min(self.size[:2]) or self.wall >= self.size[2]):
            yield Problem("wall", "the walls of a crate leave room between them")

    def boxes(self) -> tuple[Box, ...]:
        """Return the solids that it is made of, all of one name."""
        T_base_box = np.eye(4)
        T_base_box[:3, 3] = self.centre
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
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
    at: tuple[float, ...] = value(Row(Measure(LENGTH), 3), (0.0, 0.0, 0.0), "where its origin is, in the base frame")
    rpy: tuple[float, ...] = value(Row(Measure(ANGLE), 3), (0.0, 0.0, 0.0), "turned about the base's x, then y, then z")
    detail: float | None = value(
        Measure(LENGTH, "5 mm"), None, "cut the surface into cubes of this edge; without it each body is one hull"
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

    name: str = value(Text(), help="refusals call it so: 'window'")
    lower: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="corner of the zone")
    upper: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="the opposite corner")

    def problems(self) -> Iterator[Problem]:
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            yield Problem("upper", "it must lie above the zone's lower in x, y and z")

    def box(self) -> Box:
        """For the skills."""
        lower, upper = np.array(self.lower), np.array(self.upper)
        T_base_box = np.eye(4)
        T_base_box[:3, 3] = (lower + upper) / 2.0
        return _box(f"zone {self.name}", T_base_box, np.zeros(3), upper - lower)


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchSection:
    """Comparison of the rest of a path with the camera images while the arm follows it. No safety function."""

    speed: float = value(Measure(SPEED, "0 m/s", "10 m/s"), "1.6 m/s", "expected approach speed of moving objects")
    near: float = value(Measure(LENGTH, "20 mm", "500 mm"), "30 mm", "distance to unmapped standing objects")
    padding: float = value(
        Measure(LENGTH, "20 mm", "200 mm"), "30 mm", "around the robot; nearer points count as the robot itself"
    )
    delay: float = value(
        Measure(TIME, "0 s", "2 s"), "50 ms", "from a look at a frame until the arm begins to brake; measure yours"
    )

    def settings(self) -> PathWatchSettings:
        """For the skills."""
        return PathWatchSettings(self.speed, self.near, self.padding, self.delay)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceSection:
    """Known surroundings of the arm, in its base frame."""

    table_z: float | None = value(Measure(LENGTH), None, "height of the table's surface; no table without it")
    lower: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="corner of the volume that is mapped and moved in")
    upper: tuple[float, ...] = value(Row(Measure(LENGTH), 3), help="the opposite corner")
    obstacles: tuple[ObstacleSection, ...] = value(
        ListOf(Section(ObstacleSection)), (), "fixed geometry that no camera needs to see"
    )
    meshes: tuple[MeshSection, ...] = value(
        ListOf(Section(MeshSection)), (), "fixed geometry as meshes; a simulated world does not have it"
    )
    zones: tuple[ZoneSection, ...] = value(
        ListOf(Section(ZoneSection)), (), "where nothing of the robot, and nothing that it holds, may be"
    )
    poses: Mapping[str, tuple[float, ...]] = value(MappingOf(Row(Measure(ANGLE))), {}, "joints, by the pose's name")

    watch: WatchSection | None = value(
        Section(WatchSection), None, "watch of paths while the arm moves; off if omitted"
    )

    def problems(self) -> Iterator[Problem]:
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            yield Problem("upper", "it must lie above workspace.lower in x, y and z")
        names = [zone.name for zone in self.zones]
        if len(set(names)) < len(names):
            yield Problem("zones", "two zones have one name, so that messages would be ambiguous")

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
        *(_box(name, T_base_crate, np.array([side * middle[0], 0.0, 0.0]), np.array([wall, y, z])) for side in (-1, 1)),
        *(_box(name, T_base_crate, np.array([0.0, side * middle[1], 0.0]), np.array([x, wall, z])) for side in (-1, 1)),
    )


def _box(name: str, T_base_whole: Float64, offset: Float64, size: Float64) -> Box:
    """Return a part of an object whose pose is given, `offset` from its centre."""
    T_base_box = T_base_whole.copy()
    T_base_box[:3, 3] += T_base_whole[:3, :3] @ offset
    return Box(name, T_base_box, (float(size[0]) / 2.0, float(size[1]) / 2.0, float(size[2]) / 2.0))
