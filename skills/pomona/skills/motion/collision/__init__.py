"""Collisions: the robot's geometry as spheres, the world around it, and checks of postures and whole paths."""

from pomona.skills.motion.collision.distance_field import Convex, DistanceField, fruit_points
from pomona.skills.motion.collision.robot_shape import RobotShape
from pomona.skills.motion.collision.world import (
    Collision,
    CollisionError,
    CollisionWorld,
    Margins,
    UnknownObstacle,
)

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
