"""The arm's joint space among the obstacles that a skill knows of.

`UprightSpace` bounds the tilt of a held fruit. Nearly no random posture keeps a fruit upright, so trees grow along the
bound: each step is pulled back to it, by Newton steps of least joint motion, before it is checked (as CBiRRT does:
Berenson et al., ICRA 2009).

Between two postures a direction of the tool turns by no more than the joints together, so looks along a straight
segment are as far apart as the tilt that is left allows: none is missed by more than `SLACK`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import Arm, Workspace
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import apply, inverse
from pomona.skills.motion.collision import CollisionWorld, Convex, Margins, RobotShape, fruit_points
from pomona.skills.motion.collision.distance_field import DistanceField
from pomona.skills.motion.collision.world import TABLE
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.planning import rrt_connect
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.measured_fruit import MeasuredFruit

TURN = 2.0 * np.pi  # [rad]

TARGET = "target"  # name of the fruit to be picked among the obstacles


@dataclass(frozen=True, slots=True, eq=False)
class ArmSpace:
    """Joint space with a gripper opening: the `Space` that planners and samplers ask. Picklable."""

    world: CollisionWorld  # robot and obstacles with their margins
    width: float  # opening of the gripper [m]

    @property
    def lower(self) -> Float64:
        """Lower joint limits, shape (dof,) [rad]."""
        return np.where(self.endless, -TURN, self.world.shape.model.lower)

    @property
    def upper(self) -> Float64:
        """Upper joint limits, shape (dof,) [rad]."""
        return np.where(self.endless, TURN, self.world.shape.model.upper)

    @property
    def endless(self) -> NDArray[np.bool_]:
        """Which joints turn without limits, shape (dof,)."""
        return self.world.shape.model.endless

    def at_width(self, width: float) -> ArmSpace:
        """Return the same with the fingers open to a width [m]."""
        return replace(self, width=width)

    def leaving_table(self) -> ArmSpace:
        """Return the same for a fruit on the table: it and the fingers around it may be near the table."""
        if self.world.table_z is None:
            return self
        return replace(self, world=self.world.allowing(TABLE, "held", "fingers"))

    def leaving(self, q: Float64) -> ArmSpace:
        """Return the same for a rise from a posture: a held fruit and the fingers may leave their contacts there."""
        return replace(self, world=self.world.leaving(q, self.width, "held", "fingers"))

    def free(self, q: Float64) -> bool:
        """Return True if a configuration keeps all margins."""
        return bool(self.world.free(q[None], self.width)[0])

    def free_between(self, q_a: Float64, q_b: Float64) -> bool:
        """Return True if the straight joint segment keeps all margins, at every point of it."""
        return bool(
            rrt_connect.free_between(
                self.world.shape.arrays, self.world.arrays, self.width, q_a, q_b
            )
        )

    def connect(
        self, q_start: Float64, q_goals: Float64, iterations: int, seed: int
    ) -> tuple[Float64 | None, int]:
        """Waypoints (n, dof) [rad] from a free start to a free goal by RRT-Connect, and the iterations taken."""
        trees = rrt_connect.room(q_start, q_goals, iterations)
        at_start, at_goal, used = rrt_connect.grow(
            self.world.shape.arrays,
            self.world.arrays,
            self.width,
            self.lower,
            self.upper,
            trees,
            len(q_goals),
            rrt_connect.MAX_STEP,
            iterations,
            np.random.default_rng(seed),
        )
        return (None if at_start < 0 else rrt_connect.path_between(trees, at_start, at_goal)), used

    def first_blocked(self, path: Float64) -> int | None:
        """Return the number of the first segment of a polyline, shape (n, dof), that violates a margin, or None."""
        return self.world.first_blocked(path, self.width)

    def clearances(self, q: Float64) -> Float64:
        """Return the distance of postures, (n, dof), beyond the margins, shape (n,) [m]; negative in collision."""
        return self.world.clearances(q, self.width)

    def explain(self, q: Float64) -> tuple[str, dict[str, object]]:
        """Why a configuration is not free: half a sentence, and link, obstacle, depth and place."""
        collision = self.world.check(q, self.width)
        if collision is None:
            return "everything is free", {}
        return str(collision), {
            "link": collision.body,
            "obstacle": collision.other,
            "depth_m": collision.depth,
            "point_m": [round(float(x), 4) for x in collision.point],
        }


def arm_space(
    arm: Arm,
    workspace: Workspace,
    field: DistanceField | None,
    width: float,
    clearance: float,
    target: MeasuredFruit | None = None,
    held: Grasp | None = None,
) -> ArmSpace:
    """Return the obstacles of a skill's arm.

    Args:
        field: obstacles from the camera (`usable_field`), without the target.
        width: opening of the gripper [m].
        clearance: kept by the arm's links [m]; gripper and fingers keep their usual ratio of it (see `Margins`).
        target: a fruit that is to be grasped: the fingers may come near to it, nothing else may.
        held: the grasp by which a fruit is held: the fruit is then part of the robot.
    """
    robot = RobotModel.load(arm.description)
    shape = RobotShape.of(robot)
    if held is not None:
        shape = shape.holding(apply(inverse(held.T_base_grasp), fruit_points(held.fruit)))
    world = CollisionWorld.build(
        shape,
        workspace,
        field,
        () if target is None else (Convex.of_fruit(target, TARGET),),
        Margins().scaled(clearance / Margins().arm),
    )
    if target is not None:
        world = world.allowing(TARGET, "fingers")
    return ArmSpace(world, width)


SLACK = np.radians(
    0.25
)  # tolerance of the bound between two checks [rad]; for a path before its execution twice that
STEP = 0.3  # longest step of a tree [rad]
COST = 20  # cost of a step of these trees in steps without a bound, which are compiled: budgets stay in seconds


class _Tree(NamedTuple):
    nodes: list[Float64]
    parents: list[int]

    def add(self, q: Float64, parent: int) -> int:
        self.nodes.append(q)
        self.parents.append(parent)
        return len(self.nodes) - 1

    def nearest(self, q: Float64) -> int:
        return int(np.linalg.norm(np.array(self.nodes) - q, axis=1).argmin())

    def way(self, node: int) -> list[Float64]:
        """From a node to its root."""
        found = []
        while node >= 0:
            found.append(self.nodes[node])
            node = self.parents[node]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class UprightSpace:
    """A `Space` for an arm with a load that must stay upright. Picklable."""

    space: ArmSpace  # the other constraints
    up: Float64  # the direction in the TCP's frame that points up when it is upright, shape (3,), unit length
    most: float  # largest allowed tilt [rad]

    @property
    def lower(self) -> Float64:
        """Lower joint limits, shape (dof,) [rad]."""
        return self.space.lower

    @property
    def upper(self) -> Float64:
        """Upper joint limits, shape (dof,) [rad]."""
        return self.space.upper

    @property
    def endless(self) -> NDArray[np.bool_]:
        """Which joints turn without limits, shape (dof,)."""
        return self.space.endless

    def tilt(self, q: Float64) -> float:
        """How far it is tilted in a posture, shape (dof,) [rad]."""
        return float(
            np.arccos(
                np.clip((self.space.world.shape.model.tcp(q)[:3, :3] @ self.up)[2], -1.0, 1.0)
            )
        )

    def free(self, q: Float64) -> bool:
        """Return True if a configuration keeps all margins and the bound."""
        return self.space.free(q) and self.tilt(q) <= self.most

    def free_between(self, q_a: Float64, q_b: Float64) -> bool:
        """Return True if the straight joint segment keeps all margins and the bound, at every point of it."""
        return self.space.free_between(q_a, q_b) and not self._tilted_between(q_a, q_b, 0.0)

    def first_blocked(self, path: Float64) -> int | None:
        """Return the number of the first segment of a polyline, shape (n, dof), that violates a margin, or None."""
        blocked = self.space.first_blocked(path)
        until = len(path) - 1 if blocked is None else blocked
        return next(
            (k for k in range(until) if self._tilted_between(path[k], path[k + 1], SLACK)), blocked
        )

    def explain(self, q: Float64) -> tuple[str, dict[str, object]]:
        """Why a configuration is not free: half a sentence, and data."""
        if not self.space.free(q):
            return self.space.explain(q)
        tilt = self.tilt(q)
        words = f"the held fruit would be tilted by {np.degrees(tilt):.0f}°, {np.degrees(self.most):.0f}° are allowed"
        return words, {"tilt_rad": tilt, "allowed_rad": self.most}

    def connect(
        self, q_start: Float64, q_goals: Float64, iterations: int, seed: int
    ) -> tuple[Float64 | None, int]:
        """Waypoints (n, dof) [rad] from a free start to a free goal, and the iterations taken: see `COST`."""
        rng = np.random.default_rng(seed)
        trees = _Tree([q_start], [-1]), _Tree(list(q_goals), [-1] * len(q_goals))
        rounds = max(iterations // COST, 1)
        for number in range(rounds):
            ours, theirs = trees if number % 2 == 0 else trees[::-1]
            target = rng.uniform(self.lower, self.upper)
            node = self._grow(ours, target)
            met = self._grow(theirs, ours.nodes[node])
            if np.array_equal(theirs.nodes[met], ours.nodes[node]):
                at_start, at_goal = (node, met) if number % 2 == 0 else (met, node)
                way = [*reversed(trees[0].way(at_start)), *trees[1].way(at_goal)[1:]]
                return np.array(way), (number + 1) * COST
        return None, rounds * COST

    def _grow(self, tree: _Tree, target: Float64) -> int:
        """From the tree's nearest node as far towards a posture as it goes; the node that was reached."""
        node = tree.nearest(target)
        while True:
            q = tree.nodes[node]
            left = float(np.linalg.norm(target - q))
            if left <= 1e-12:
                return node
            wanted = target if left <= STEP else q + STEP / left * (target - q)
            new = self._pulled_back(wanted)
            if new is None or np.linalg.norm(target - new) > left - 0.05 * min(STEP, left):
                return node
            if not self.free_between(q, new):
                return node
            node = tree.add(new, node)

    def _pulled_back(self, q: Float64) -> Float64 | None:
        """Return the posture itself where it keeps the bound, else one near it that does, or None."""
        model = self.space.world.shape.model
        if self.tilt(q) <= self.most:
            return q
        for _ in range(8):  # Newton steps of a projection
            up = model.tcp(q)[:3, :3] @ self.up
            axis = np.cross(up, (0.0, 0.0, 1.0))
            length = float(np.linalg.norm(axis))
            tilt = float(np.arctan2(length, up[2]))
            if tilt <= self.most:
                return q
            if length < 1e-6:  # upside down: no way back is nearer than another
                return None
            row = axis / length @ model.jacobian(q)[3:]
            # steps are pulled back to this share of the bound, so that the way between two of them stays within it
            q = np.clip(
                q + row * (tilt - 0.7 * self.most) / (row @ row + 1e-6), self.lower, self.upper
            )
        return None

    def _tilted_between(self, q_a: Float64, q_b: Float64, tolerance: float) -> bool:
        step = q_b - q_a
        most = self.most + tolerance
        turned = float(np.abs(step).sum())
        t = 0.0
        while True:
            tilt = self.tilt(q_a + t * step)
            if tilt > most:
                return True
            t += (most + SLACK - tilt) / max(turned, 1e-12)
            if t >= 1.0:
                return self.tilt(q_b) > most
