"""Shorter polylines: leave out corners and cut between random points, as long as every new segment is free."""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.motion.planning.space import Space


def path_length(waypoints: Float64) -> float:
    """Length of a joint polyline, shape (n, dof) [rad]."""
    return float(np.linalg.norm(np.diff(waypoints, axis=0), axis=1).sum())


def shortcut(space: Space, waypoints: Float64, rng: np.random.Generator) -> Float64:
    """Return a path from a free polyline, shape (n, dof) [rad], that is never longer; its new segments are checked."""
    path = _leave_out_corners(space, waypoints)
    for _ in range(60):  # random cuts of a polyline
        if len(path) < 3:
            break
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        first, second = np.sort(rng.uniform(0.0, along[-1], 2))
        i, j = (int(np.clip(np.searchsorted(along, s, side="right") - 1, 0, len(path) - 2)) for s in (first, second))
        if i == j:
            continue
        a = path[i] + (first - along[i]) / (along[i + 1] - along[i]) * (path[i + 1] - path[i])
        b = path[j] + (second - along[j]) / (along[j + 1] - along[j]) * (path[j + 1] - path[j])
        if space.free_between(a, b):
            path = np.vstack([path[: i + 1], a, b, path[j + 1 :]])
    return _leave_out_corners(space, path)


def _leave_out_corners(space: Space, waypoints: Float64) -> Float64:
    """From each kept corner, go straight to the farthest later one that can be reached."""
    kept, here = [0], 0
    while here < len(waypoints) - 1:
        here = next(
            (k for k in range(len(waypoints) - 1, here + 1, -1) if space.free_between(waypoints[here], waypoints[k])),
            here + 1,
        )
        kept.append(here)
    return waypoints[kept]
