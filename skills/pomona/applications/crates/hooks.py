"""Places from which a finger beside a wall or a neighbour draws a fruit away from it.

The hand points down, its sliding direction along the pull. One finger goes down between the fruit and the wall, as
far behind the fruit's middle as the wall allows; the other one is in front of the fruit. Pulled sideways, the rubber
of a pad holds on a flank on which pressing down would move nothing. Beside neighbours the fruit is drawn away from them
where a finger comes farther behind it there: on the crown of a small fruit it would press it down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pomona.drivers import Workspace
from pomona.executive import Float64
from pomona.skills import rot_x, rot_z
from pomona.skills.motion import (
    ArmSpace,
    Convex,
    Grasp,
    GraspCandidates,
    GripperShape,
    RuledOut,
    fruit_points,
    gripper_shape,
    inverse_kinematics,
    straight_line,
)
from pomona.skills.perception import MeasuredFruit

WALL_NEAR = 0.02
"""Gap between a fruit and a wall up to which the wall is in the fingers' way [m]: a finger is 12 mm thick."""
WALL_AIR = 1e-3
"""Between a finger and a wall or a neighbour [m]."""
TURNS = tuple(float(turn) for turn in np.radians((0.0, 20.0, -20.0, 40.0, -40.0)))
"""Angles of the pull to the direction away from the walls [rad], in the order in which they are preferred."""
STEP = 2e-3
"""Between two places of the finger behind the fruit's middle that are tried [m]."""
BEHIND = 0.012
"""Least distance of the finger's inner face behind the fruit's middle [m]: nearer, it slides over the crown."""
OVER = (0.035, 0.012)
"""Height of the fingers' tips over the fruit, and over the walls beside it, at the beginning [m]."""
LOWEST = 0.010
"""Least height of the TCP over the fruit's middle [m]: a finger touches the flank above it, and the palm stays over the
wall."""
PUSH = 2e-3
"""Way by which a neighbour may be pushed, as the fruit rolls over its bumps [m]."""
POSTURES = 8
"""Joint solutions of a place whose ways are tried."""


@dataclass(frozen=True, slots=True, eq=False)
class Beside:
    """A fruit with its neighbours and walls.

    Attributes:
        fruit: that is to be drawn.
        walls, neighbours: boxes of the cell that reach above its middle, and other fruit.
        points: its surface, shape (n, 3) [m].
    """

    fruit: MeasuredFruit
    walls: tuple[Convex, ...]
    neighbours: tuple[Convex, ...]
    points: Float64

    @classmethod
    def of(cls, fruit: MeasuredFruit, workspace: Workspace) -> Beside:
        """Return it for a fruit that was measured with its neighbours."""
        height = fruit.T_base_fruit[2, 3]
        boxes = [
            Convex.of_box(box)
            for box in workspace.obstacles
            if box.T_base_box[2, 3] + np.abs(box.T_base_box[2, :3]) @ np.array(box.half_extents)
            > height
        ]
        others = tuple(Convex.of_fruit(other, "neighbour") for other in fruit.beside)
        return cls(fruit, tuple(boxes), others, fruit_points(fruit))

    @property
    def radius(self) -> float:
        """Half of the fruit's width [m]."""
        return float(self.fruit.dimensions[0]) / 2.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the walls."""
        return tuple({wall.name for wall in self.walls})

    @property
    def top(self) -> float:
        """Height of the fingers' tips at the beginning, over the fruit and the walls beside it [m]."""
        walls = [
            wall.planes[wall.planes[:, 2] > 0.99, 3].min()
            for wall in self.walls
            if self._is_near(wall)
        ]
        return float(
            max([self.points[:, 2].max() + OVER[0], *(height + OVER[1] for height in walls)])
        )

    def _is_near(self, wall: Convex) -> bool:
        normal, gap = facing(self.points, wall)
        return gap < WALL_NEAR and abs(float(normal[2])) < 0.5

    @property
    def away(self) -> tuple[Float64, ...]:
        """Directions away from the walls beside the fruit, and from its neighbours: unit vectors, shape (3,).

        Away from neighbours, the fruit does not go towards a wall that is beside it.
        """
        walls, others = (
            [
                facing(self.points, shape)[0] * [1.0, 1.0, 0.0]
                for shape in shapes
                if self._is_near(shape)
            ]
            for shapes in (self.walls, self.neighbours)
        )
        total = sum([*walls, *others], np.zeros(3))
        for normal in walls:
            total -= min(float(total @ normal), 0.0) * normal
        found = [sum(walls, np.zeros(3)), *([total] if others else [])]
        return tuple(way / np.linalg.norm(way) for way in found if np.linalg.norm(way) > 0.5)


def hooks(
    beside: Beside, away: Float64, fingers: GripperShape, width: float, distance: float
) -> Iterator[tuple[float, Float64, Float64, str]]:
    """Yield hooks: the pull's angle [rad], T_base_tcp at the lowest place, (4, 4), the pull, (3,), and an obstacle.

    Args:
        away: the straightest pull, a unit vector in the plane, shape (3,).
        width: opening of the fingers [m].
        distance: of the pull [m].
    """
    for turn in TURNS:
        pull = rot_z(turn) @ away
        for flip in (0.0, np.pi):
            R_base_tcp = rot_z(float(np.arctan2(pull[1], pull[0])) - np.pi / 2.0 + flip) @ rot_x(
                np.pi
            )
            T_base_tcp, why = _lowest(beside, fingers, width, R_base_tcp, pull)
            why = (
                why
                or _ahead(beside, fingers, width, T_base_tcp, pull * distance)
                or _pushed(beside, pull * distance)
            )
            yield turn, T_base_tcp, pull, why


def hook_candidates(
    beside: Beside, space: ArmSpace, near: Float64, distance: float, attempt: int = 1
) -> GraspCandidates:
    """Return hooks whose ways down and across the arm can go, the straightest pull first.

    They lead away from the walls, or from the neighbours where the finger of the straightest pull comes farther behind
    the fruit. A candidate's `T_base_pre_grasp` is over the fruit, its `T_base_grasp` the lowest place; the pull is
    along the sliding direction of the fingers, to the side of the fruit (`pull_of`).

    Args:
        space: the arm among its obstacles, with the fingers open.
        near: joints from which short ways are preferred, shape (dof,) [rad].
    """
    ruled_out: list[RuledOut] = []
    found = [_reachable(beside, away, space, near, distance, ruled_out) for away in beside.away]
    grasps = max(
        found, key=lambda hooks: round(behind(hooks[0]) / STEP) if hooks else 0, default=[]
    )
    far = [
        hook for hook in grasps if behind(hook) > behind(grasps[0]) - STEP
    ]  # nearer, it slides over the shoulder
    return GraspCandidates(tuple(far), tuple(ruled_out), attempt)


def _reachable(
    beside: Beside,
    away: Float64,
    space: ArmSpace,
    near: Float64,
    distance: float,
    ruled_out: list[RuledOut],
) -> list[Grasp]:
    """Return the hooks about one direction that the arm can go, and add the others to `ruled_out`."""
    robot = space.world.shape.model
    grasps = []
    found = hooks(beside, away, gripper_shape(robot), space.width, distance)
    for index, (turn, T_base_tcp, pull, why) in enumerate(found, len(ruled_out)):
        q_free: Float64 = np.empty((0, robot.dof))
        T_base_over = T_base_tcp.copy()
        if not why:
            T_base_over[2, 3] = beside.top + gripper_shape(robot).points[:, 2].max()
            q_free, why = postures_over(
                space, beside.names, near, T_base_over, T_base_tcp, pull * distance
            )
        if why:
            ruled_out.append(
                RuledOut(index, 0.0, turn, "IN_COLLISION" if "touch" in why else "UNREACHABLE", why)
            )
            continue
        grasps.append(
            Grasp(
                index,
                0.0,
                turn,
                T_base_over,
                T_base_tcp,
                space.width,
                q_free,
                WALL_AIR,
                0.0,
                beside.fruit,
            )
        )
    return grasps


def behind(hook: Grasp) -> float:
    """Return how far the finger's inner face is behind the fruit's middle at the lowest place [m]."""
    ahead = float((hook.T_base_grasp[:3, 3] - hook.fruit.T_base_fruit[:3, 3]) @ pull_of(hook))
    return hook.width / 2.0 - ahead


def pull_of(hook: Grasp) -> Float64:
    """Return the direction of a hook's pull: along the sliding direction, from the fruit to the hand, shape (3,)."""
    along = hook.T_base_grasp[:3, 1]
    ahead = float((hook.T_base_grasp[:3, 3] - hook.fruit.T_base_fruit[:3, 3]) @ along)
    pull: Float64 = along * np.sign(ahead)
    return pull


def rolled_height(x: float, radius: float, behind: float) -> float:
    """Return how far a point of a rolling ball has risen [m] when it has come a way along the pull [m].

    Args:
        radius: of the ball [m].
        behind: how far behind the ball's middle the point began, on its upper half [m].
    """
    begin = float(np.arcsin(np.clip(behind / radius, 0.0, 0.95)))
    turn = np.linspace(0.0, np.pi / 2.0, 100)
    ways = radius * (turn + np.sin(begin) - np.sin(begin - turn))
    return float(radius * (np.cos(begin - np.interp(x, ways, turn)) - np.cos(begin)))


def _lowest(
    beside: Beside, fingers: GripperShape, width: float, R_base_tcp: Float64, pull: Float64
) -> tuple[Float64, str]:
    """Return the place where the finger is farthest behind the fruit, and the obstacle of the nearest one."""
    corners = (fingers.points + (width - fingers.closed) * fingers.slides) @ R_base_tcp.T
    middle = (beside.points.max(axis=0) + beside.points.min(axis=0)) / 2.0
    T_base_tcp = np.eye(4)
    T_base_tcp[:3, :3] = R_base_tcp
    half = float(np.ptp(beside.points @ pull)) / 2.0
    why = ""
    for behind in np.arange(half, BEHIND, -STEP):
        T_base_tcp[:3, 3] = middle + pull * (width / 2.0 - behind)
        T_base_tcp[2, 3] = middle[2] + LOWEST
        rise = np.array([0.0, 0.0, beside.top - float(corners[:, 2].min()) - T_base_tcp[2, 3]])
        swept = np.vstack((corners, corners + rise))
        why = touched(
            swept + T_base_tcp[:3, 3], fingers.bodies * 2, (*beside.walls, *beside.neighbours)
        )
        if not why:
            return T_base_tcp, ""
    return T_base_tcp, why or "the fruit is too small for a finger behind it"


def _ahead(
    beside: Beside, fingers: GripperShape, width: float, T_base_tcp: Float64, pull: Float64
) -> str:
    """Return the obstacle that the fingers would touch on the pull; the fruit may push neighbours."""
    corners = (fingers.points + (width - fingers.closed) * fingers.slides) @ T_base_tcp[
        :3, :3
    ].T + T_base_tcp[:3, 3]
    return touched(
        np.vstack((corners, corners + pull)),
        fingers.bodies * 2,
        (*beside.walls, *beside.neighbours),
    )


def _pushed(beside: Beside, pull: Float64) -> str:
    """Return which neighbour or wall the fruit would push on its way; it may slide along one that it touches."""
    for shape in (*beside.neighbours, *beside.walls):
        before = min(facing(beside.points, shape)[1], 0.0)
        for share in (0.2, 0.5, 1.0):
            if facing(beside.points + share * pull, shape)[1] < before - PUSH:
                return f"the fruit would touch the {shape.name} in front of it"
    return ""


def touched(points: Float64, bodies: Sequence[str], shapes: Sequence[Convex]) -> str:
    """Return which finger comes too near to which shape, by a plane between both; empty if none does."""
    for body in dict.fromkeys(bodies):
        own = points[[name == body for name in bodies]]
        for shape in shapes:
            if float(facing(own, shape)[1]) < WALL_AIR:
                return f"{body} would touch the {shape.name}"
    return ""


def facing(points: Float64, shape: Convex) -> tuple[Float64, float]:
    """Return the normal of a shape that faces points best, and the gap along it [m]."""
    gaps = (points @ shape.planes[:, :3].T).min(axis=0) - shape.planes[:, 3]
    best = int(gaps.argmax())
    return shape.planes[best, :3], float(gaps[best])


def postures_over(
    space: ArmSpace,
    passed: Sequence[str],
    near: Float64,
    T_base_over: Float64,
    T_base_tcp: Float64,
    pull: Float64,
) -> tuple[Float64, str]:
    """Return joints over the fruit from which the ways down and across are free, shape (n, dof), or why none is.

    Args:
        passed: names of obstacles beside which the fingers' outline was judged: the spheres of collision checks are
            too coarse there.
    """
    robot = space.world.shape.model
    world = space.world
    for name in set(passed) & set(world.names):
        world = world.allowing(name, "fingers")
    ways = replace(space, world=world)
    found = []
    why = "the arm does not reach over the fruit"
    solutions = inverse_kinematics(robot, T_base_over, arm_angles=18, near=near)
    T_base_end = T_base_tcp.copy()
    T_base_end[:3, 3] += pull
    for q in solutions:
        if not space.free(q):
            why = space.explain(q)[0]
            continue
        down = straight_line(robot, q, T_base_tcp)
        across = straight_line(robot, down.q[-1], T_base_end) if down.complete else down
        if not (down.complete and across.complete):
            why = f"on the way {across.reason}"
            continue
        way = np.vstack((down.q, across.q))
        blocked = ways.first_blocked(way)
        if blocked is not None:
            why = ways.explain(way[min(blocked + 1, len(way) - 1)])[0]
            continue
        found.append(q)
        if len(found) == POSTURES:
            break
    return np.array(found).reshape(-1, robot.dof), "" if found else why
