"""Compile what the occupancy map needs before a run's clock starts; the compiled code is kept on disk."""

from __future__ import annotations

import numpy as np

from pomona.drivers.interfaces import Frame, Intrinsics, Workspace
from pomona.skills.motion.collision import Convex
from pomona.skills.motion.occupancy.integrate import Sensing, integrate
from pomona.skills.motion.occupancy.occupancy_map import OccupancyMap


def warm_up() -> None:
    """Fuse a look at a wall of four pixels, and compute the distance field."""
    lens = Intrinsics(1.0, 1.0, 0.5, 0.5, 2, 2)
    depth = np.full((2, 2), 0.05, dtype=np.float32)
    frame = Frame(0.0, 0, np.zeros((2, 2, 3), np.uint8), depth, lens, None, np.eye(4))
    workspace = Workspace(None, np.full(3, -0.1), np.full(3, 0.1))
    grid = OccupancyMap.empty(workspace.lower, workspace.upper, 0.02)
    robot = np.array([[0.0, 0.0, -1.0, 0.01]])
    target = Convex.of_points("target", np.eye(3))
    _ = integrate(grid, frame, np.eye(4), workspace, robot=robot, target=target, sensing=Sensing()).field
