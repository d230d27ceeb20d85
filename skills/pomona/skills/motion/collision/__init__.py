"""Collisions: the robot's geometry as spheres, the world around it, and checks of postures and whole paths."""

from pomona.skills.motion.collision.convex import Convex, fruit_points
from pomona.skills.motion.collision.distance_field import DistanceField
from pomona.skills.motion.collision.robot_shape import RobotShape
from pomona.skills.motion.collision.verdict import Collision, Margins
from pomona.skills.motion.collision.world import CollisionError, CollisionWorld, UnknownObstacle

__all__ = [
    "Collision",
    "CollisionError",
    "CollisionWorld",
    "Convex",
    "DistanceField",
    "Margins",
    "RobotShape",
    "UnknownObstacle",
    "fruit_points",
]
