"""What the robot may hit: its own geometry as spheres, the world around it, and checks of postures and whole paths."""

from skills.collision.convex import Convex, fruit_points
from skills.collision.distance_field import DistanceField
from skills.collision.errors import BadTrajectory, CollisionError, UnknownObstacle
from skills.collision.robot_shape import RobotShape
from skills.collision.verdict import Collision, Margins
from skills.collision.world import CollisionWorld

__all__ = [
    "BadTrajectory",
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
