"""Occupancy map from depth frames: free, occupied and hidden cells, ages, distance to blocked cells."""

from pomona.skills.motion.occupancy.integrate import (
    Sensing,
    check_camera_pose,
    integrate,
    pose_of_camera,
)
from pomona.skills.motion.occupancy.occupancy_map import (
    FREE,
    HIDDEN,
    OCCUPIED,
    UNKNOWN,
    CameraPoseMismatch,
    MapEmpty,
    MapStale,
    NothingMeasured,
    OccupancyError,
    OccupancyMap,
)

__all__ = [
    "FREE",
    "HIDDEN",
    "OCCUPIED",
    "UNKNOWN",
    "CameraPoseMismatch",
    "MapEmpty",
    "MapStale",
    "NothingMeasured",
    "OccupancyError",
    "OccupancyMap",
    "Sensing",
    "check_camera_pose",
    "integrate",
    "pose_of_camera",
]
