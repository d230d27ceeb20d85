"""Comparison of a camera's present frame with the rest of a path.

Each cell of a coarse grid is in one of three classes. A *known* cell (the map, the cell's fixed boxes, the table,
measured fruit, the robot itself with a held fruit) is ignored. A cell *seen free* during this motion and now occupied
holds a moving object: the arm stops if the object could meet it before it rests. A cell occupied at its first
observation holds a standing object: the arm stops if it would come near to it while braking. Objects further along the
path are reported, and do not stop the arm yet.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import ArmLimits, Frame, PathWatchSettings, Trajectory, Workspace
from pomona.drivers.path_follower import PathFollower
from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.motion.collision import Convex, RobotShape
from pomona.skills.motion.collision.world import standing
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.occupancy.integrate import mark_spheres
from pomona.skills.motion.watch.kernel import CameraView, Nearest, Noise, WatchedCells, nearest_ahead, see

PERIOD = 0.005  # of the trial's steps [s]; drivers step finer (a test compares)

CELL = 0.025  # edge of the grid's cells [m]: a hand takes dozens of them
AROUND = 0.03  # distance within which points belong to a known object [m]: noise at its edge, or a stem
BEYOND = 0.6  # the grid reaches so far beyond the workspace, upwards and sideways [m]: a hand needs 0.4 s for it
SURE = 3.0  # standard deviations of the depth's noise that are allowed for
MOST = 4096  # new cells of one frame that are looked at: 1.6 m² of surface
# Way of an object until it counts as moved [m]: its cells lie two or more beside those where it stood, along a diagonal
UNNOTICED = 2.0 * np.sqrt(3.0) * CELL
FRAME_INTERVAL = 0.04  # longest time between two frames for which the pace is safe [s]
PACES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.125)  # tried in this order; the last one is taken in any case


@dataclass(frozen=True, slots=True)
class Ahead:
    """Something new that the robot would come near to on the rest of its path."""

    stop: bool  # whether it is so near that the arm must brake now
    moved: bool  # whether it has come in since the motion began; else it stood there, unseen
    distance: float  # of the robot from it along the stretch that was judged, the smallest [m]
    after: float  # seconds until the robot is there, at the path's pace
    point: tuple[float, float, float]  # where it is, in the base frame [m]
    part: str  # the robot's part that would be the nearest
    cells: int  # how many new cells the camera saw, near or not


class PathWatch:
    """Watches one motion; needs every new frame of every camera.

    Args:
        shape: of the robot, with a held fruit.
        trajectory: that it follows.
        limits: of the arm, which give its braking time.
        width: opening of the gripper [m].
        workspace: table, fixed boxes, the watched volume, and the settings of the watch.
        map: obstacles from earlier frames, or None.
        known: further known objects: the fruit to pick.

    Attributes:
        width: opening of the gripper now; write it while the fingers move [m].
    """

    def __init__(
        self,
        shape: RobotShape,
        trajectory: Trajectory,
        limits: ArmLimits,
        width: float,
        workspace: Workspace,
        map: OccupancyMap | None = None,
        known: Sequence[Convex] = (),
    ) -> None:
        self._how = workspace.watch or PathWatchSettings()
        self._shape, self.width, self._braking = shape, width, Braking(trajectory, limits)
        # Postures of the rest of a path are looked at so far apart [s]; the fastest joint moves by 0.12 rad meanwhile
        self._times = np.append(np.arange(0.0, trajectory.duration, 0.02), trajectory.duration)
        self._Q = np.column_stack([np.interp(self._times, trajectory.t, q) for q in trajectory.q.T])
        floor = -np.inf if workspace.table_z is None else workspace.table_z
        # height above the table below which everything is the table's [m]
        self._lowest = float(max(floor + 0.02, workspace.lower[2]))
        self._origin = workspace.lower - (BEYOND, BEYOND, 0.0)
        shape_of_grid = np.ceil((workspace.upper + BEYOND - self._origin) / CELL).astype(int)
        nx, ny, nz = (int(n) for n in shape_of_grid)
        self._known = self._mark_known((nx, ny, nz), map, [*standing(workspace), *known])
        self._states: dict[int, UInt8] = {}  # by camera: two of them never agree to the millimetre at an edge
        self._area = np.zeros((nx, ny, nz), np.float32)
        self._touched = np.empty(nx * ny * nz, np.int64)
        self._found, self._moved = np.empty((MOST, 3)), np.empty(MOST, np.bool_)

    def look(
        self, frame: Frame, T_base_camera: Float64, q: Float64, age: float, path_time: float, camera: int = 0
    ) -> Ahead | None:
        """Compare one frame with the rest of the path.

        Args:
            frame: with depth.
            T_base_camera: pose of the camera at the exposure, shape (4, 4).
            q: the arm's joints at the exposure, shape (dof,) [rad].
            age: of the frame now [s].
            path_time: how far along its trajectory the arm is now [s].
            camera: number of the camera: moving objects are found by its own earlier frames.

        Returns:
            the most urgent new object near the rest of the path, or None.
        """
        new = self._new_cells(frame, T_base_camera, q, camera)
        if new == 0:
            return None
        how, points, moved = self._how, self._found[:new], self._moved[:new]
        # fewer cells that were free and are taken now are noise, and count as standing there: a hand has dozens
        if np.count_nonzero(moved) < 3:
            moved = np.zeros(new, np.bool_)
        stopping = age + how.delay + self._braking.time(path_time)
        first = max(int(np.searchsorted(self._times, path_time, side="right")) - 1, 0)
        within = max(int(np.searchsorted(self._times, path_time + stopping)) + 1, first + 1)
        judged = (
            (True, True, points[moved], first, within, how.near + how.speed * stopping),
            (True, False, points[~moved], first, within, how.near),
            (False, False, points, within, len(self._times), how.near),
        )
        for stop, came, those, begin, end, allowed in judged:
            told = self._nearest(those, begin, end, allowed, path_time)
            if told is not None:
                distance, after, point, part = told
                return Ahead(stop, came, distance, after, point, part, new)
        return None

    def standing(self, frame: Frame, T_base_camera: Float64, q: Float64, camera: int = 0) -> Float64:
        """Note a frame from before the motion; return the cells that are occupied and not known, shape (n, 3) [m]."""
        return self._found[: self._new_cells(frame, T_base_camera, q, camera)].copy()

    def slowed(self, points: Float64) -> tuple[float, PathWatch]:
        """Return the largest pace at which no standing object can meet the moving arm, and the watch at that pace.

        At any time of the path the arm rests before an object could come from one of the points to a posture that is
        passed until then: distance > near + UNNOTICED + speed · (FRAME_INTERVAL + delay + braking time).

        Args:
            points: of objects that may set off when the arm does, shape (n, 3) [m].
        """
        paced = self
        for pace in PACES:
            paced = self if pace == 1.0 else self._at(pace)
            if not len(points) or paced._rests_in_time(points):
                break
        return pace, paced

    def _at(self, pace: float) -> PathWatch:
        """Return the same watch of the same path, followed at a share of its pace."""
        other = copy.copy(self)
        other._braking = self._braking.at(pace)
        other._times = self._times / pace
        return other

    def _rests_in_time(self, points: Float64) -> bool:
        how = self._how
        for path_time in np.arange(0.0, self._times[-1], 0.1):
            stopping = FRAME_INTERVAL + how.delay + self._braking.time(float(path_time))
            first = max(int(np.searchsorted(self._times, path_time, side="right")) - 1, 0)
            last = max(int(np.searchsorted(self._times, path_time + stopping)) + 1, first + 1)
            allowed = how.near + UNNOTICED + how.speed * stopping
            if self._nearest(points, first, last, allowed, float(path_time)) is not None:
                return False
        return True

    def _new_cells(self, frame: Frame, T_base_camera: Float64, q: Float64, camera: int) -> int:
        if frame.depth is None:
            return 0
        lens, errs = frame.intrinsics, frame.depth_model
        # an image with more columns than this is looked at in every second pixel each way
        step = 2 if lens.width > 480 else 1
        # A read-only image would be compiled for once more.
        depth = np.require(frame.depth[::step, ::step], np.float32, ["C", "W"])
        own = np.zeros(self._known.shape, np.bool_)
        robot = self._shape.spheres(q, self.width)
        farthest = np.linalg.norm(robot[:, :3] - T_base_camera[:3, 3], axis=1).max()
        padding = self._how.padding + SURE * float(errs.deviation(farthest, lens.fx))
        mark_spheres(np.ascontiguousarray(robot), padding, self._origin, CELL, own)
        spread = SURE * (errs.disparity / (lens.fx * errs.baseline) + errs.growth)
        state = self._states.setdefault(camera, np.zeros(self._known.shape, np.uint8))
        rays = np.array([lens.fx, lens.fy, lens.cx, lens.cy]) / step
        view = CameraView(rays, np.ascontiguousarray(T_base_camera[:3]), frame.q is None)
        cells = WatchedCells(self._origin, CELL, self._known, own, state, self._area, self._touched)
        # of a surface in a cell, as the camera sees it; less is noise [m²]: a quarter of a cell's face
        noise = Noise(self._lowest + SURE * errs.floor, spread, 1e-4)
        new: int = see(depth, view, cells, noise, self._found, self._moved)
        return new

    def _nearest(
        self, points: Float64, first: int, last: int, allowed: float, path_time: float
    ) -> tuple[float, float, tuple[float, float, float], str] | None:
        """Return distance, seconds until then, place and part of the robot's nearest posture among first … last - 1."""
        Q = np.ascontiguousarray(self._Q[first:last])
        if not len(points) or not len(Q):
            return None
        centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
        bound = np.append(centre, np.linalg.norm(points - centre, axis=1).max())
        nearest = Nearest(np.empty(len(Q)), np.empty(len(Q), np.int64), np.empty(len(Q), np.int64))
        points = np.ascontiguousarray(points)
        nearest_ahead(self._shape.arrays, Q, self.width, points, bound, allowed, nearest)
        away, geom, which = nearest
        m = int(np.argmin(away))
        if geom[m] < 0:
            return None
        x, y, z = (round(float(c), 3) for c in points[which[m]])
        after = max(float(self._times[first + m]) - path_time, 0.0)
        return float(away[m]), after, (x, y, z), self._shape.geom_bodies[geom[m]]

    def _mark_known(
        self, shape: tuple[int, int, int], map: OccupancyMap | None, known: Sequence[Convex]
    ) -> NDArray[np.bool_]:
        """Return cells that something known takes, or is near to."""
        marked = np.zeros(shape, np.bool_)
        reach = AROUND + CELL * np.sqrt(3.0) / 2.0
        for convex in known:
            first = np.maximum(((convex.bound[:3] - convex.bound[3] - reach - self._origin) / CELL).astype(int), 0)
            last = np.minimum(
                ((convex.bound[:3] + convex.bound[3] + reach - self._origin) / CELL).astype(int) + 1, shape
            )
            if np.any(first >= last):
                continue
            cells = np.indices(last - first).reshape(3, -1).T + first
            near = cells[convex.distance(self._origin + (cells + 0.5) * CELL) < reach]
            marked[near[:, 0], near[:, 1], near[:, 2]] = True
        if map is not None and map.blocked.any():
            centres = map.origin + (np.argwhere(map.blocked) + 0.5) * map.resolution
            spheres = np.column_stack((centres, np.full(len(centres), map.resolution * np.sqrt(3.0) / 2.0)))
            mark_spheres(spheres, reach - AROUND / 2.0, self._origin, CELL, marked)
        return marked


class Braking:
    """How long the arm brakes, at any time of a trajectory that it follows at its pace or at a share of it."""

    def __init__(self, trajectory: Trajectory, limits: ArmLimits) -> None:
        self._follower, self._pace = PathFollower(trajectory, limits, PERIOD), 1.0

    def at(self, pace: float) -> Braking:
        """Return the braking of the same path, followed at a share of its pace."""
        other = copy.copy(self)
        other._follower, other._pace = copy.copy(self._follower), pace
        other._follower.rate = pace
        return other

    def time(self, t: float) -> float:
        """Return seconds from the order to stop at time `t` [s] of the trajectory until the arm rests on its path."""
        follower = copy.copy(self._follower)  # the path itself is only read
        follower.path_time = t * self._pace
        follower.slow_down()
        steps = 0
        while not follower.at_rest:
            follower.step()
            steps += 1
        return steps * PERIOD
