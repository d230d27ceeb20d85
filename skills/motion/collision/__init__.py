"""What the robot may hit: its own geometry as spheres, the world around it, and checks of postures and whole paths."""

from skills.motion.collision.convex import Convex, fruit_points
from skills.motion.collision.distance_field import DistanceField
from skills.motion.collision.errors import CollisionError, UnknownObstacle
from skills.motion.collision.robot_shape import RobotShape
from skills.motion.collision.verdict import Collision, Margins
from skills.motion.collision.world import CollisionWorld

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
