"""The robot model: kinematics, limits and collision geometry from a description file."""

from pomona.skills.motion.robot.description import Body, Geom
from pomona.skills.motion.robot.errors import BadJoints, BadRobotFile, NotAPose, RobotError
from pomona.skills.motion.robot.inverse_kinematics import inverse_kinematics, nearest_solution
from pomona.skills.motion.robot.model import RobotModel

__all__ = [
    "BadJoints",
    "BadRobotFile",
    "Body",
    "Geom",
    "NotAPose",
    "RobotError",
    "RobotModel",
    "inverse_kinematics",
    "nearest_solution",
]
