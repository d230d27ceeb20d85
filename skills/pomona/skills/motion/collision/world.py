"""Distances to keep, and the message for a violation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pomona.drivers.interfaces import ArmLimits, Trajectory, Workspace
from pomona.drivers.trajectory import check_trajectory
from pomona.executive.values.arrays import Float64
from pomona.executive.values.read_only import read_only
from pomona.skills.motion.collision import kernel
from pomona.skills.motion.collision.distance_field import Convex, DistanceField
from pomona.skills.motion.collision.kernel import WorldArrays
from pomona.skills.motion.collision.robot_shape import RobotShape
from pomona.skills.motion.collision.segment import SLACK, check_path
from pomona.skills.motion.robot import RobotModel


@dataclass(frozen=True, slots=True)
class Margins:
    """Distances to keep, body by body [m]: with one margin for all, large fruit would not fit between the fingers."""

    # arm, gripper, fingers, held: of the links, of parts fixed on the flange, of fingers and pads, of held fruit, from
    # everything in the world
    arm: float = 0.010
    gripper: float = 0.006
    fingers: float = 0.002
    held: float = 0.002
    itself: float = 0.004  # of the robot's parts from each other

    def scaled(self, factor: float) -> Margins:
        """Return all margins times a factor, for example of a fallback in the tree."""
        return Margins(
            *(factor * m for m in (self.arm, self.gripper, self.fingers, self.held, self.itself))
        )


@dataclass(frozen=True, slots=True, eq=False)
class Collision:
    """Two things that are closer than they may be."""

    geom: str  # geom, body: the robot's part, by the names of its shape and of its body
    body: str
    other: str  # the obstacle's name ("map", "table", "target" …), or the robot's other body
    depth: float  # by how much the margin is violated [m]; larger than the margin means contact
    margin: float  # the distance that was to be kept [m]
    point: Float64  # the robot's point where it is deepest, in the base frame, shape (3,) [m]
    q: Float64  # the posture, shape (dof,) [rad]
    at: float  # where on a path: number of the segment plus the share of it; 0 for a single posture
    itself: bool  # True for a collision of the robot with itself

    def __str__(self) -> str:
        x, y, z = self.point
        what = f"the arm's own {self.other}" if self.itself else f"the {self.other}"
        gap = self.margin - self.depth
        how = f"touches {what}" if gap <= 0.0 else f"comes within {1e3 * gap:.1f} mm of {what}"
        kept = (
            f"{1e3 * self.margin:.0f} mm are to be kept"
            if self.margin >= 0.0
            else "it may be left, not pressed more"
        )
        return f"{self.body} {how} at ({x:.3f}, {y:.3f}, {z:.3f}) m; {kept}"


MAP = "map"
TABLE = "table"

_FAR = 0.25  # limit of the reported clearances [m]

GIVES = 3e-3
"""Length by which something that is left may be pressed [m]: an apple of 62 mm that rises beside one of 93 mm on the
same table needs 2.4 mm, and the neighbour rolls aside."""

DEEPEST = 16e-3
"""Overlap of touching objects by measurement and model [m]: two positions within 2 mm each in 95 % of looks, and
covering spheres that protrude by up to 12 mm from a ball of 80 mm."""

DEEPEST_IN_MAP = 2.5e-3
"""The same for cells of the map [m]: a finger sphere of 4.4 mm in a cell is in it by that, however deep the cell."""


@dataclass(frozen=True, slots=True, eq=False)
class CollisionWorld:
    """A frozen picture of the surroundings for one robot. Cheap to vary: its methods that return a world copy little.

    Attributes:
        shape: the robot's geometry.
        field: distance to blocked cells of the map.
        obstacles: convex obstacles by number; their names need not differ.
        margins: distances to keep.
        table_z: height of the table [m], or None.
        ignored: names of obstacles that a group of the robot may touch.
    """

    shape: RobotShape
    field: DistanceField
    obstacles: tuple[Convex, ...]
    margins: Margins
    table_z: float | None
    ignored: frozenset[tuple[str, str]]
    arrays: WorldArrays

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave the arrays out: another process makes its own, of the kinds for which functions are compiled."""
        return _assemble, (
            self.shape,
            self.field,
            self.obstacles,
            self.margins,
            self.table_z,
            self.ignored,
        )

    @staticmethod
    def build(
        robot: RobotModel | RobotShape,
        workspace: Workspace | None = None,
        field: DistanceField | None = None,
        obstacles: Sequence[Convex] = (),
        margins: Margins | None = None,
    ) -> CollisionWorld:
        """Build a world from a robot, or its shape with a held fruit.

        Args:
            workspace: table, fixed obstacles, meshes and zones of the cell.
            field: of the map, with its shapes (`OccupancyMap.usable_field`).
            obstacles: further shapes, such as the target (`Convex.of_fruit`).
        """
        shape = RobotShape.of(robot) if isinstance(robot, RobotModel) else robot
        fixed = (*standing(workspace), *map(Convex.of_box, workspace.zones)) if workspace else ()
        return _assemble(
            shape,
            field or DistanceField.nothing_blocked(),
            (*fixed, *(() if field is None else field.shapes), *obstacles),
            margins or Margins(),
            workspace.table_z if workspace else None,
            frozenset(),
        )

    # ------------------------------------------------------------------------------------------- variations

    def with_obstacles(self, *obstacles: Convex) -> CollisionWorld:
        """Return the same world with more obstacles."""
        return self._changed(obstacles=(*self.obstacles, *obstacles))

    def without(self, name: str) -> CollisionWorld:
        """Return the same world without the obstacles of a name; UnknownObstacle if there is none."""
        kept = tuple(o for o in self.obstacles if o.name != name)
        if len(kept) == len(self.obstacles):
            raise UnknownObstacle(name, self.names)
        return self._changed(obstacles=kept)

    def allowing(self, name: str, *groups: str) -> CollisionWorld:
        """Return the same world in which groups of geoms may touch an obstacle, "map" or "table".

        Groups are "arm", "gripper", "fingers" and "held"; all when left out.

        Raises:
            UnknownObstacle: there is none of this name.
        """
        if name not in self.names:
            raise UnknownObstacle(name, self.names)
        allowed = {(name, group) for group in groups or ("arm", "gripper", "fingers", "held")}
        return self._changed(ignored=self.ignored | allowed)

    def leaving(self, q: ArrayLike, width: float, *groups: str) -> CollisionWorld:
        """Return the same world in which groups of geoms may leave their contacts in a posture q, shape (dof,) [rad].

        Their distance to it may not shrink by more than `GIVES`: a fruit below another one is not free to rise. A
        distance below -`DEEPEST`, in the map -`DEEPEST_IN_MAP`, is no contact but an error of a measurement, and keeps
        its margin. This is the last variation: others restore the margins.

        Raises:
            BadJoints: q is no posture of this robot.
        """
        joints = self.shape.model.checked(q)[None]
        arrays = self.arrays
        robot = read_only(self.shape.arrays._replace(pairs=np.empty((0, 2), np.int64)))
        margins = arrays.margins.copy()
        clearances = np.empty(1)
        closest = np.empty((1, 2), np.int64)
        for other, geom in np.argwhere(~arrays.ignored):
            if self.shape.geom_groups[geom] not in groups:
                continue
            alone = np.ones_like(arrays.ignored)
            alone[other, geom] = False
            kernel.check_states(
                robot, arrays._replace(ignored=alone), joints, width, _FAR, clearances, closest
            )
            distance = clearances[0] + margins[other, geom]
            if (
                -(DEEPEST_IN_MAP if other == kernel.MAP else DEEPEST)
                < distance
                < margins[other, geom]
            ):
                margins[other, geom] = distance - GIVES
        return replace(self, arrays=arrays._replace(margins=margins))

    def with_margins(self, margins: Margins) -> CollisionWorld:
        """Return the same world with other margins."""
        return self._changed(margins=margins)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all obstacles by their number in the kernels."""
        table = () if self.table_z is None else (TABLE,)
        return (MAP, *(o.name for o in self.obstacles), *table)

    # -------------------------------------------------------------------------------------------- questions

    def check(self, q: ArrayLike, width: float) -> Collision | None:
        """Return the worst collision of a posture q, shape (dof,) [rad], at an opening [m], or None.

        Raises:
            BadJoints: q is no posture of this robot.
        """
        joints = self.shape.model.checked(q)
        clearances, closest = self._judge(joints[None], width, _FAR)
        if clearances[0] >= 0.0:
            return None
        return self._collision(
            joints, width, float(clearances[0]), int(closest[0, 0]), int(closest[0, 1]), 0.0
        )

    def clearance(self, q: ArrayLike, width: float) -> float:
        """Return the distance beyond the margins [m], negative in collision, at most 0.25; BadJoints: no posture."""
        return float(self._judge(self.shape.model.checked(q)[None], width, _FAR)[0][0])

    def clearances(self, Q: ArrayLike, width: float) -> Float64:
        """`clearance` of many postures, shape (n, dof) -> (n,) [m]."""
        return self._judge(self._checked_many(Q), width, _FAR)[0]

    def free(self, Q: ArrayLike, width: float) -> NDArray[np.bool_]:
        """Which postures, shape (n, dof), keep all margins, shape (n,): the fast question."""
        free: NDArray[np.bool_] = self._judge(self._checked_many(Q), width, 0.0)[0] >= 0.0
        return free

    def check_path(self, waypoints: ArrayLike, width: float) -> Collision | None:
        """Return the first collision along straight joint-space segments between waypoints, shape (n, dof), or None.

        No sampling step: how far each part of the robot can move is bounded by joint steps times reach, and the next
        look is where a found clearance ends, so no cell is jumped. A segment that was proven free is free here, too: a
        look may miss `SLACK` of a margin, and 2 `SLACK` are the most by which one is undershot.

        Args:
            waypoints: shape (n, dof) [rad].
            width: opening of the gripper [m].

        Raises:
            BadJoints: a waypoint is no posture of this robot.
        """
        path = self._checked_many(waypoints)
        number, at, away, geom, other = check_path(
            self.shape.arrays, self.arrays, path, width, SLACK
        )
        if number < 0:
            return None
        start = path[number]
        end = path[min(number + 1, len(path) - 1)]
        return self._collision(start + at * (end - start), width, away, geom, other, number + at)

    def first_blocked(self, waypoints: ArrayLike, width: float) -> int | None:
        """Return the number of the first segment of `check_path` that is not free, or None; BadJoints as there."""
        path = self._checked_many(waypoints)
        number = check_path(self.shape.arrays, self.arrays, path, width, SLACK)[0]
        return None if number < 0 else number

    def check_trajectory(self, trajectory: Trajectory, width: float) -> Collision | None:
        """Return the first collision along a timed trajectory, or None.

        Between samples the arm may leave the straight segment by up to max|qdd|·dt²/8 in each joint; the resulting
        motion is added to the margin of every part.

        Raises:
            BadTrajectory: malformed, or beyond a limit of the arm: see `pomona.drivers.trajectory`.
        """
        model = self.shape.model
        check_trajectory(
            trajectory,
            ArmLimits(model.lower, model.upper, model.velocity, model.acceleration, model.jerk),
        )
        q = trajectory.q
        qdd = np.abs(trajectory.qdd)
        bow = np.maximum(qdd[:-1], qdd[1:]) * np.diff(trajectory.t)[:, None] ** 2 / 8.0
        bulge = float(np.max(bow @ self.shape.arrays.reach, initial=0.0))
        wider = self if bulge < 1e-6 else replace(self, arrays=self._grown(bulge))
        return wider.check_path(q, width)

    # ---------------------------------------------------------------------------------------------- inside

    def _changed(
        self,
        *,
        shape: RobotShape | None = None,
        obstacles: tuple[Convex, ...] | None = None,
        margins: Margins | None = None,
        ignored: frozenset[tuple[str, str]] | None = None,
    ) -> CollisionWorld:
        return _assemble(
            shape or self.shape,
            self.field,
            self.obstacles if obstacles is None else obstacles,
            margins or self.margins,
            self.table_z,
            self.ignored if ignored is None else ignored,
        )

    def _grown(self, distance: float) -> WorldArrays:
        arrays = self.arrays
        return arrays._replace(
            margins=arrays.margins + distance, self_margin=arrays.self_margin + 2.0 * distance
        )

    def _checked_many(self, Q: ArrayLike) -> Float64:
        postures = np.array(
            Q, dtype=np.float64, order="C"
        )  # writable: read-only arrays compile all kernels again
        if postures.ndim != 2:
            self.shape.model.checked(postures)
            postures = postures[None]
        if postures.shape[1] != self.shape.model.dof or not np.isfinite(postures).all():
            for q in postures:
                self.shape.model.checked(q)
        return postures

    def _judge(self, Q: Float64, width: float, enough: float) -> tuple[Float64, NDArray[np.int64]]:
        clearances = np.empty(len(Q))
        closest = np.empty((len(Q), 2), dtype=np.int64)
        kernel.check_states(self.shape.arrays, self.arrays, Q, width, enough, clearances, closest)
        return clearances, closest

    def _collision(
        self, q: Float64, width: float, away: float, geom: int, other: int, at: float
    ) -> Collision:
        itself = other < 0
        return Collision(
            geom=self.shape.geom_names[geom],
            body=self.shape.geom_bodies[geom],
            other=self.shape.geom_bodies[-1 - other] if itself else self.names[other],
            depth=-away,
            margin=self.arrays.self_margin if itself else float(self.arrays.margins[other, geom]),
            point=self._deepest(q, width, geom, other),
            q=q.copy(),
            at=at,
            itself=itself,
        )

    def _deepest(self, q: Float64, width: float, geom: int, other: int) -> Float64:
        """Centre of the geom's sphere that is closest to an obstacle."""
        spheres = self.shape.spheres_of(geom, q, width)
        centres = spheres[:, :3]
        radii = spheres[:, 3]
        if other < 0:
            others = self.shape.spheres_of(-1 - other, q, width)
            apart = (
                np.linalg.norm(centres[:, None] - others[None, :, :3], axis=2) - others[None, :, 3]
            )
            away = apart.min(axis=1)
        elif other == kernel.MAP:
            away = self.field.distance(centres)
        elif other <= len(self.obstacles):
            away = self.obstacles[other - 1].distance(centres)
        else:
            away = centres[:, 2]
        deepest: Float64 = centres[int(np.argmin(away - radii))]
        return deepest


@lru_cache(maxsize=4)
def standing(workspace: Workspace) -> tuple[Convex, ...]:
    """Return the obstacles in the cell file: boxes and parts of meshes."""
    return (*map(Convex.of_box, workspace.obstacles), *map(Convex.of_hull, workspace.hulls))


def _assemble(
    shape: RobotShape,
    field: DistanceField,
    obstacles: tuple[Convex, ...],
    margins: Margins,
    table_z: float | None,
    ignored: frozenset[tuple[str, str]],
) -> CollisionWorld:
    groups = shape.geom_groups
    names = (MAP, *(o.name for o in obstacles), *(() if table_z is None else (TABLE,)))
    by_group = {
        "arm": margins.arm,
        "gripper": margins.gripper,
        "fingers": margins.fingers,
        "held": margins.held,
    }
    arrays = WorldArrays(
        field=field.values,
        origin=field.origin,
        resolution=float(field.resolution),
        planes=np.vstack([o.planes for o in obstacles]) if obstacles else np.empty((0, 4)),
        plane_start=np.cumsum([0] + [len(o.planes) for o in obstacles], dtype=np.int64),
        bounds=np.array([o.bound for o in obstacles]).reshape(-1, 4),
        half_spaces=np.array([] if table_z is None else [[0.0, 0.0, 1.0, table_z]]).reshape(-1, 4),
        margins=np.tile([by_group[group] for group in groups], (len(names), 1)),
        self_margin=float(margins.itself),
        ignored=np.array([[(name, group) in ignored for group in groups] for name in names]),
    )
    return CollisionWorld(shape, field, obstacles, margins, table_z, ignored, arrays)


class CollisionError(Exception):
    """Root of this package's errors."""


class UnknownObstacle(CollisionError):
    """A name that no obstacle of the world has."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name = name
        self.known = known
        super().__init__(f"no obstacle is named '{name}'; there are {', '.join(known)}")
