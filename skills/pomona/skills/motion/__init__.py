"""From a fruit to a path: robot, collision, map, planning, grasps. No py_trees, no devices.

The names below are public, and loaded on first use.
"""

from typing import TYPE_CHECKING

from pomona.executive.values.public_names import on_first_use

if TYPE_CHECKING:
    from pomona.skills.motion.collision import (
        Convex as Convex,
        RobotShape as RobotShape,
        fruit_points as fruit_points,
    )
    from pomona.skills.motion.grasp import (
        SAME_PLACE as SAME_PLACE,
        Grasp as Grasp,
        GraspCandidates as GraspCandidates,
        RuledOut as RuledOut,
    )
    from pomona.skills.motion.grasps.gripper_shape import (
        GripperShape as GripperShape,
        gripper_shape as gripper_shape,
    )
    from pomona.skills.motion.lines import straight_line as straight_line
    from pomona.skills.motion.occupancy import OccupancyMap as OccupancyMap
    from pomona.skills.motion.planning.arm_space import ArmSpace as ArmSpace, arm_space as arm_space
    from pomona.skills.motion.robot import (
        RobotModel as RobotModel,
        inverse_kinematics as inverse_kinematics,
        nearest_solution as nearest_solution,
    )

PUBLIC = {
    "collision": "Convex RobotShape fruit_points",
    "grasp": "Grasp GraspCandidates RuledOut SAME_PLACE",
    "grasps.gripper_shape": "GripperShape gripper_shape",
    "lines": "straight_line",
    "occupancy": "OccupancyMap",
    "planning.arm_space": "ArmSpace arm_space",
    "robot": "RobotModel inverse_kinematics nearest_solution",
}
"""Public names by the module that defines them."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = on_first_use(__name__, PUBLIC)
