"""The arm's joint space among the obstacles that a skill knows of."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
