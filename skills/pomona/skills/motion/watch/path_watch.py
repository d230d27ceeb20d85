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
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.errors import BadTrajectory
from pomona.drivers.interfaces import ArmLimits, Frame, PathWatchSettings, Trajectory, Workspace
from pomona.drivers.path_motion import PathFollower
from pomona.drivers.trajectory import check_trajectory
from pomona.executive.values.arrays import Float64, UInt8
from pomona.executive.values.later import Later
from pomona.skills.motion.collision import Convex, RobotShape
from pomona.skills.motion.collision.world import standing
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.occupancy.integrate import mark_spheres
from pomona.skills.motion.watch.kernel import (
    FREE,
    CameraView,
    Nearest,
    Noise,
    WatchedCells,
    nearest_ahead,
    see,
)

ndimage: Any = Later("scipy.ndimage")

PERIOD = 0.005  # of the trial's steps [s]; drivers step finer (a test compares)

CELL = 0.025  # edge of the grid's cells [m]: a hand takes dozens of them
# distance within which points belong to a known object [m]: noise at its edge, or a stem
AROUND = 0.03
BEYOND = 0.6  # the grid reaches so far beyond the workspace, upwards and sideways [m]: a hand needs 0.4 s for it
SURE = 3.0  # standard deviations of the depth's noise that are allowed for
MOST = 4096  # new cells of one frame that are looked at: 1.6 m² of surface
# Way of an object until it counts as moved [m]: its cells lie two or more beside those where it stood, along a diagonal
UNNOTICED = 2.0 * np.sqrt(3.0) * CELL
FRAME_INTERVAL = 0.04  # longest time between two frames for which the pace is safe [s]
PACES = (
    1.0,
    0.7,
    0.5,
    0.35,
    0.25,
    0.18,
    0.125,
)  # tried in this order; the last one is taken in any case
STEP = 0.05  # of the path's time, at which paces are chosen [s]
SUSPECT = 0.15  # around an object that stopped the arm, which may be a person's hand [m]
BESIDE = 0.2  # what was last seen so near to the robot may still be there, hidden by it [m]
CLEAR = 0.1  # to anything unmapped, of a way that must be seen free before it is taken [m]
LEAST_MOVED = 3  # cells that were free and are taken now, from which on something has come in


@dataclass(frozen=True, slots=True)
class Ahead:
    """Something new that the robot would come near to on the rest of its path."""

    stop: bool  # whether it is so near that the arm must brake now
    moved: bool  # whether it has come in since the motion began; else it stood there, unseen
    distance: float  # of the robot from it along the stretch that was judged, the smallest [m]
    after: float  # seconds until the robot is there, at the path's pace
    point: tuple[float, float, float]  # where it is, in the base frame [m]
    part: str  # the robot's part that would be the nearest


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
        self._limits = limits
        self._shape = shape
        self.width = width
        self._follow(trajectory)
        floor = -np.inf if workspace.table_z is None else workspace.table_z
        # height above the table below which everything is the table's [m]
        self._lowest = float(max(floor + 0.02, workspace.lower[2]))
        self._origin = workspace.lower - (BEYOND, BEYOND, 0.0)
        shape_of_grid = np.ceil((workspace.upper + BEYOND - self._origin) / CELL).astype(int)
        nx, ny, nz = (int(n) for n in shape_of_grid)
        passing = [Convex.of_box(volume) for volume in self._how.passing]
        shapes = [*standing(workspace), *known, *(map.shapes if map else ()), *passing]
        self._known = self._mark_known((nx, ny, nz), map, shapes)
        self._states: dict[
            int, UInt8
        ] = {}  # by camera: two of them never agree to the millimetre at an edge
        self._area = np.zeros((nx, ny, nz), np.float32)
        self._touched = np.empty(nx * ny * nz, np.int64)
        self._found, self._moved = np.empty((MOST, 3)), np.empty(MOST, np.bool_)
        self.beside = False  # what `entered` saw last was beside the robot, which hides it

    def _follow(self, trajectory: Trajectory) -> None:
        self._trajectory, self._braking = trajectory, Braking(trajectory, self._limits)
        # Postures of the rest of a path are looked at so far apart [s]; the fastest joint moves by 0.12 rad meanwhile
        self._times = np.append(np.arange(0.0, trajectory.duration, 0.02), trajectory.duration)
        self._Q = np.column_stack([np.interp(self._times, trajectory.t, q) for q in trajectory.q.T])

    @property
    def duration(self) -> float:
        """Of the motion [s]."""
        return self._trajectory.duration

    def look(
        self,
        frame: Frame,
        T_base_camera: Float64,
        q: Float64,
        age: float,
        path_time: float,
        camera: int = 0,
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
        points, moved = self._new_cells(frame, T_base_camera, q, camera)
        if not len(points):
            return None
        how = self._how
        # fewer cells that were free and are taken now are noise, and count as standing there: a hand has dozens
        if np.count_nonzero(moved) < LEAST_MOVED:
            moved = np.zeros_like(moved)
        # Without a stop now the arm begins to brake after the next frame at the earliest.
        waiting = FRAME_INTERVAL + how.delay
        stopping = (
            age + waiting + self._braking.time(min(path_time + waiting, float(self._times[-1])))
        )
        first, within = self._stretch(path_time, path_time + stopping)
        judged = (
            (True, True, points[moved], first, within, how.near + how.speed * stopping),
            (True, False, points[~moved], first, within, how.near),
            (False, False, points, within, len(self._times), how.near),
        )
        for stop, came, those, begin, end, allowed in judged:
            told = self._nearest(those, begin, end, allowed, path_time)
            if told is not None:
                distance, after, point, part = told
                return Ahead(stop, came, distance, after, point, part)
        return None

    def standing(
        self, frame: Frame, T_base_camera: Float64, q: Float64, camera: int = 0
    ) -> Float64:
        """Note a frame from before the motion; return the cells that are occupied and not known, shape (n, 3) [m]."""
        return self._new_cells(frame, T_base_camera, q, camera)[0].copy()

    def inherit(self, before: PathWatch, states: bool) -> None:
        """Take over the known cells of an earlier motion's watch; with `states`, also what each camera saw there.

        A fruit that was held then and is no more lies where the hand is now.
        """
        self._known |= before._known
        held = len(self._shape.geom_names)
        if held < len(before._shape.geom_names):
            fruit = before._shape.spheres_of(held, self._Q[0], self.width)
            mark_spheres(fruit, AROUND, self._origin, CELL, self._known)
        if states:
            self._states = before._states

    def suspect(self, point: Sequence[float]) -> None:
        """Count what stands within `SUSPECT` of a point, shape (3,) [m], as having come in."""
        near = np.zeros(self._known.shape, np.bool_)
        mark_spheres(np.array([[*point, SUSPECT]]), 0.0, self._origin, CELL, near)
        for state in self._states.values():
            state[near] = FREE

    def entered(self, frame: Frame, T_base_camera: Float64, q: Float64, camera: int) -> str:
        """Say what a frame shows that must not be there when the motion starts, empty if nothing: see `hidden`."""
        points, moved = self._new_cells(frame, T_base_camera, q, camera)
        near = max(CLEAR, self._how.near)
        words = "an unmapped object stands near the path"
        if np.count_nonzero(moved) >= LEAST_MOVED:
            points = points[moved]
            near = np.inf
            words = "something has come in"
        told = self._nearest(points, 0, len(self._Q), near, 0.0)
        if told is None:
            return ""
        self.beside = self._nearest(points, 0, 1, BESIDE, 0.0) is not None
        return f"{words}, at {spot(told[2])}"

    def hidden(self, views: Sequence[tuple[Frame, Float64, Float64]]) -> str:
        """Say where the robot would pass through a volume that none of the newest frames shows; empty if nowhere.

        What is smaller than a hand (three cells each way) counts as seen. The robot's own volume and known cells do, too.

        Args:
            views: frames, the pose of the camera (4, 4), and the joints then (dof,) [rad].
        """
        fresh = copy.copy(self)
        left = np.zeros(self._known.shape, np.bool_)
        fresh._states = {}
        for q in self._Q[:: max(len(self._Q) // 40, 1)]:
            mark_spheres(self._spheres(q), 0.0, self._origin, CELL, left)
        now = np.zeros_like(left)
        for number, (frame, T_base_camera, q) in enumerate(views):
            fresh._new_cells(frame, T_base_camera, q, number)
            left &= fresh._states[number] != FREE
        mark_spheres(self._spheres(self._Q[0]), self._how.padding + CELL, self._origin, CELL, now)
        left &= ~(now | self._known)
        left[:, :, : max(int((self._lowest - self._origin[2]) / CELL), 0)] = False
        cells = np.argwhere(ndimage.binary_erosion(left, np.ones((3, 3, 3))))
        if not len(cells):
            return ""
        return f"no camera shows {spot(self._origin + (cells[0] + 0.5) * CELL)}, where the robot would pass"

    def _spheres(self, q: Float64) -> Float64:
        return np.ascontiguousarray(self._shape.spheres(q, self.width))

    def slowed(self, points: Float64, age: float) -> Trajectory | None:
        """Return the path, slower where a standing object could meet the moving arm; None if it can stay as it is.

        At any time the arm rests before an object could come from one of the points to a posture that is passed until
        then: distance > near + way + speed · (FRAME_INTERVAL + delay + braking time). The way is UNNOTICED, and until
        the motion's first frame counts at least speed · age. Where no pace fulfils this, the last of `PACES` is taken.

        Args:
            points: of objects that may have set off since they were seen, shape (n, 3) [m].
            age: of the frames that show them, when the motion starts [s].
        """
        if not len(points):
            return None
        times = np.arange(0.0, self._times[-1], STEP)
        paces = np.array([self._pace(points, float(t), age) for t in times])
        if np.all(paces == 1.0):
            return None
        window = 0.2  # of the path's time in which the pace changes [s]
        while window < 4.0 * self._times[-1]:
            slower = _at_paces(self._trajectory, times, paces, window)
            with suppress(
                BadTrajectory
            ):  # the change of pace adds to the path's own accelerations and jerks
                check_trajectory(slower, self._limits)
                return slower
            window *= 1.5
        return _at_paces(self._trajectory, times, np.full(len(times), paces.min()), window)

    def on(self, trajectory: Trajectory, shape: RobotShape | None = None) -> PathWatch:
        """Return the same watch, with what the cameras have shown, of another path, or another shape of the robot."""
        other = copy.copy(self)
        other._shape = shape or self._shape
        other._follow(trajectory)
        return other

    def _pace(self, points: Float64, path_time: float, age: float) -> float:
        """Return the largest of `PACES` at which the arm rests in time from here, else the last."""
        how = self._how
        # the motion's first frame counts by then
        has_begun = path_time >= FRAME_INTERVAL + how.delay + STEP
        way = UNNOTICED if has_begun else max(UNNOTICED, how.speed * age)
        for pace in PACES:
            stopping = FRAME_INTERVAL + how.delay + self._braking.time(path_time, pace)
            stretch = self._stretch(path_time, path_time + pace * stopping)
            near = how.near + way + how.speed * stopping
            if self._nearest(points, *stretch, near, path_time) is None:
                break
        return pace

    def _stretch(self, begin: float, end: float) -> tuple[int, int]:
        """Return the posture at a time of the path or before it, and the one after those until another [s]."""
        first = max(int(np.searchsorted(self._times, begin, side="right")) - 1, 0)
        return first, max(int(np.searchsorted(self._times, end)) + 1, first + 1)

    def _new_cells(
        self, frame: Frame, T_base_camera: Float64, q: Float64, camera: int
    ) -> tuple[Float64, NDArray[np.bool_]]:
        if frame.depth is None:
            return self._found[:0], self._moved[:0]
        lens = frame.intrinsics
        errs = frame.depth_model
        # an image with more columns than this is looked at in every second pixel each way
        step = 2 if lens.width > 480 else 1
        # A read-only image or pose would be compiled for once more.
        depth = np.require(frame.depth[::step, ::step], np.float32, ["C", "W"])
        own = np.zeros(self._known.shape, np.bool_)
        robot = self._shape.spheres(q, self.width)
        farthest = np.linalg.norm(robot[:, :3] - T_base_camera[:3, 3], axis=1).max()
        padding = self._how.padding + SURE * float(errs.deviation(farthest, lens.fx))
        mark_spheres(np.ascontiguousarray(robot), padding, self._origin, CELL, own)
        spread = SURE * (errs.disparity / (lens.fx * errs.baseline) + errs.growth)
        state = self._states.setdefault(camera, np.zeros(self._known.shape, np.uint8))
        rays = np.array([lens.fx, lens.fy, lens.cx, lens.cy]) / step
        view = CameraView(rays, np.require(T_base_camera[:3], None, ["C", "W"]), frame.q is None)
        cells = WatchedCells(self._origin, CELL, self._known, own, state, self._area, self._touched)
        # of a surface in a cell, as the camera sees it; less is noise [m²]: a quarter of a cell's face
        noise = Noise(self._lowest + SURE * errs.floor, spread, 1e-4)
        new: int = see(depth, view, cells, noise, self._found, self._moved)
        return self._found[:new], self._moved[:new]

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
            first = np.maximum(
                ((convex.bound[:3] - convex.bound[3] - reach - self._origin) / CELL).astype(int), 0
            )
            last = np.minimum(
                ((convex.bound[:3] + convex.bound[3] + reach - self._origin) / CELL).astype(int)
                + 1,
                shape,
            )
            if np.any(first >= last):
                continue
            cells = np.indices(last - first).reshape(3, -1).T + first
            near = cells[convex.distance(self._origin + (cells + 0.5) * CELL) < reach]
            marked[near[:, 0], near[:, 1], near[:, 2]] = True
        if map is not None and map.blocked.any():
            centres = map.origin + (np.argwhere(map.blocked) + 0.5) * map.resolution
            spheres = np.column_stack(
                (centres, np.full(len(centres), map.resolution * np.sqrt(3.0) / 2.0))
            )
            mark_spheres(
                np.ascontiguousarray(spheres), reach - AROUND / 2.0, self._origin, CELL, marked
            )
        return marked


def spot(point: Sequence[float] | Float64) -> str:
    """Return a point, shape (3,) [m], for the operator."""
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f}) m"


def _at_paces(path: Trajectory, times: Float64, paces: Float64, window: float) -> Trajectory:
    """Return the path, nowhere faster than the paces at its times; these change within a window [s]."""
    grid = np.arange(-window, path.duration + window, PERIOD)
    wanted = paces[np.clip(np.searchsorted(times, grid, side="right") - 1, 0, len(paces) - 1)]
    half = max(int(window / PERIOD) // 2, 1)
    lowest = ndimage.minimum_filter1d(
        wanted, 2 * half + 1, mode="nearest"
    )  # so the means are slow enough everywhere
    for _ in range(2):
        lowest = ndimage.uniform_filter1d(lowest, half + 1, mode="nearest")
    rate = np.interp(path.t, grid, lowest)
    change = np.interp(path.t, grid, np.gradient(lowest, PERIOD))
    t = np.append(0.0, np.cumsum(np.diff(path.t) * 0.5 * (1.0 / rate[1:] + 1.0 / rate[:-1])))
    rates = rate[:, None]
    return Trajectory(
        t, path.q, path.qd * rates, path.qdd * rates**2 + path.qd * (rate * change)[:, None]
    )


class Braking:
    """How long the arm brakes, at any time of a trajectory."""

    def __init__(self, trajectory: Trajectory, limits: ArmLimits) -> None:
        self._follower = PathFollower(trajectory, limits, PERIOD)

    def time(self, t: float, pace: float = 1.0) -> float:
        """Return seconds from the order to stop at time `t` [s] of the trajectory until the arm rests on its path.

        Args:
            pace: share of the trajectory's pace at which the arm follows it there.
        """
        follower = copy.copy(self._follower)  # the path itself is only read
        follower.path_time = t
        follower.rate = pace
        steps = 0
        while not follower.at_rest:
            follower.step(goes_on=False)
            steps += 1
        return steps * PERIOD
