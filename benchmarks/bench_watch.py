"""The watch over a moving arm: paths against a hand that comes in, and paths on which nothing is new.

    python -m benchmarks.bench_watch --paths 200 --free 100 --seed 1

The skill Follow carries out random paths in the simulated cell `sim_watched`, with fruit on the table and a map from
one look. On each of `--paths` a hand comes along a straight line, so that arm and hand would meet. The same path is
followed without a watch first, which shows whether a fixed camera had the hand in sight. A contact is counted by the
world's own geometry, once while the arm moves and once with the arm at rest: stopping the arm does not keep a hand from
going on into it.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pomona.drivers.interfaces import Arm, Camera, Cameras, Gripper, Trajectory, Workspace
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.executive.files import find_cell
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.executive.values.arrays import Float64
from pomona.skills.follow import Follow
from pomona.skills.geometry import inverse
from pomona.skills.motion.collision import RobotShape
from pomona.skills.motion.occupancy import OccupancyMap, integrate, pose_of_camera
from pomona.skills.motion.planning.arm_space import ArmSpace, arm_space
from pomona.skills.motion.planning.timing import time_polyline
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.watch import path_watch
from pomona.tools.simulation.intruder import BODY, Intruder, Reach
from pomona.tools.simulation.world import SimWorld

TICK = 0.02
REST = 0.8
"""The hand is looked at for so long after the motion has ended [s]."""
FARTHEST = 1.2
"""The hand starts no further away than this [m]."""
DEEPEST = 4.5
"""Distance behind a hand beyond which there is no measurable background [m]."""
IN_TIME = 0.6
"""The hand is under way for so long before they would meet [s]: the longest braking, a frame, and some more."""
NEAREST = 0.35
"""The robot stands at least so far from where the hand starts, when the motion begins [m]."""
SEEN = 0.9
"""A hand counts as seen when a fixed camera has its middle in sight on this share of its way, until it would be hit."""
SPEEDS = (0.2, 1.6)
"""Of the hand [m/s]; 1.6 m/s is ISO 13855's."""


@dataclass(frozen=True, slots=True)
class WatchedPath:
    """One path: whether the watch stopped the arm, how near the hand came while the arm moved and at all [m], its speed
    [m/s], and on what share of its way a fixed camera saw it."""

    blocked: bool
    code: str
    nearest_moving: float
    nearest: float
    speed: float
    seen: float
    duration: float
    why: str


class Trials:
    """A cell, its map, and random paths in it."""

    def __init__(self, seed: int, within: float = np.inf) -> None:
        self.within = within  # latest time at which arm and hand would meet [s]
        self.cell: Cell = load_cell(
            find_cell("sim_watched"), seed=seed, overrides={"others": "4", "distractors": "0"}
        )
        self.rng = np.random.default_rng([seed, 99])
        self.arm, world = self.cell.device(Arm), self.cell.devices["world"]
        assert isinstance(world, SimWorld)
        self.world: SimWorld = world
        assert self.world.intruder is not None
        self.intruder: Intruder = self.world.intruder
        self.workspace = self.cell.device(Workspace)
        self.robot = RobotModel.load(self.arm.description)
        self.shape = RobotShape.of(self.robot)
        self.width = self.cell.device(Gripper).state().width
        self.map = self._look()
        self.space: ArmSpace = arm_space(self.arm, self.workspace, self.map.field, self.width, 0.02)

    def _look(self) -> OccupancyMap:
        """One look from the observe pose, where the arm starts."""
        frame = self.cell.device(Camera).latest()
        assert frame is not None
        assert frame.q is not None
        grid = OccupancyMap.empty(self.workspace.lower, self.workspace.upper, 0.01)
        own = self.shape.spheres(frame.q, self.width)
        return integrate(grid, frame, pose_of_camera(frame, self.robot), self.workspace, robot=own)

    def path(self) -> Trajectory:
        """A free path from where the arm stands to a random posture over the table."""
        q = self.arm.state().q
        while True:
            goal = self.rng.uniform(self.robot.lower, self.robot.upper)
            p = self.robot.tcp(goal)[:3, 3]
            over = -0.4 < p[0] < 0.4 and -0.65 < p[1] < -0.15 and 0.0 < p[2] < 0.4
            if not over or np.abs(goal - q).max() < 0.5 or np.abs(goal - q).max() > 2.5:
                continue
            if self.space.free(goal) and self.space.free_between(q, goal):
                return time_polyline(np.array([q, goal]), self.arm.limits)

    def reach(self, path: Trajectory) -> Reach | None:
        """A hand that meets a part of the robot somewhere on its path; None where there is no room for it."""
        at = float(self.rng.uniform(0.3, 0.95)) * path.duration
        if not IN_TIME <= at <= self.within:
            return None
        q = np.array([np.interp(at, path.t, joint) for joint in path.q.T])
        moving = [
            g for g, link in enumerate(self.shape.arrays.links) if link >= 4
        ]  # elbow to fingers
        spheres = self.shape.spheres_of(int(self.rng.choice(moving)), q, self.width)
        goal = spheres[self.rng.integers(len(spheres)), :3]
        speed = float(self.rng.uniform(*SPEEDS))
        way = self.rng.normal(size=3) * (1.0, 1.0, 0.5)
        way /= np.linalg.norm(way)
        length = min(speed * at, FARTHEST)
        start = goal - length * way
        if speed * at > FARTHEST:
            speed = FARTHEST / at
        stands = self.shape.spheres(path.q[0], self.width)
        hand = np.linspace(start - 0.45 * way, start + 0.1 * way, 12)  # the forearm behind it, too
        apart = np.linalg.norm(stands[:, None, :3] - hand, axis=2) - stands[:, None, 3]
        if apart.min() < NEAREST or hand[:, 2].min() < 0.0 or goal[2] < -0.02:
            return None
        return Reach(start, goal, speed)

    def _seen(self) -> bool:
        """Whether a fixed camera sees the palm now: in its image, nothing before it, a background behind."""
        mujoco, model, state = self.world.mujoco, self.world.model, self.world.state
        hand = model.body(BODY)
        at = np.array(state.body(BODY).xpos)
        cameras: Any = self.cell.device(Cameras).all[1:]
        for camera in cameras:
            lens, eye, T = (
                camera._intrinsics,
                camera.T_mount_camera[:3, 3],
                inverse(camera.T_mount_camera),
            )
            x, y, z = T[:3, :3] @ at + T[:3, 3]
            if z < 0.2 or not (
                0 < lens.fx * x / z + lens.cx < lens.width
                and 0 < lens.fy * y / z + lens.cy < lens.height
            ):
                continue
            first = np.full(1, -1, np.int32)
            mujoco.mj_ray(model, state, eye, at - eye, None, 1, -1, first)
            if int(first[0]) != int(hand.geomadr[0]):  # the palm is that body's first geom
                continue
            behind = mujoco.mj_ray(model, state, eye, at - eye, None, 1, int(hand.id), first)
            if 0.0 < behind * float(np.linalg.norm(at - eye)) < DEEPEST:
                return True
        return False

    def run(self, path: Trajectory, reach: Reach | None, watched: bool) -> WatchedPath:
        """Follow one path."""
        workspace = self.workspace if watched else replace(self.workspace, watch=None)
        devices = {
            Arm: self.arm,
            Gripper: self.cell.device(Gripper),
            Workspace: workspace,
            Cameras: self.cell.device(Cameras),
        }
        self.intruder.forget()
        if reach is not None:
            self.intruder.send(reach)
        sights: list[bool] = []

        def sight(_tick: int) -> None:
            if reach is not None and self.intruder.nearest > 0.0:
                sights.append(self._seen())

        ports = {"path": path, "map": self.map}
        end: SkillEnd = drive(
            Follow(), ports, devices, clock=self.cell.clock, period=TICK, each_tick=sight
        )
        self.cell.clock.advance(REST)
        nearest_moving, nearest = self.intruder.nearest_moving, self.intruder.nearest
        self.intruder.clear_fault()
        code = end.reason.code if end.reason else ""
        seen, speed = float(np.mean(sights or [False])), reach.speed if reach else 0.0
        why = (
            f"after {end.duration:.2f} s: {end.reason.message if end.reason else 'came to its end'}"
        )
        return WatchedPath(
            code == "PATH_BLOCKED", code, nearest_moving, nearest, speed, seen, end.duration, why
        )

    def go_back(self, q: Float64) -> None:
        """Bring the arm back without a watch; the hand is away."""
        way = time_polyline(np.array([self.arm.state().q, q]), self.arm.limits)
        if way.duration > 0.02:
            self.run(way, None, False)


def tell(what: str, pairs: list[tuple[WatchedPath, WatchedPath]]) -> None:
    """Print the results of some paths."""
    watched = [one for _, one in pairs]
    gaps = 1e3 * np.array([one.nearest_moving for one in watched])
    low, median = np.percentile(gaps, [5, 50])
    print(f"{len(pairs)} paths, {what}, {SPEEDS[0]} to {SPEEDS[1]} m/s:")
    print(f"  stopped by the watch:       {sum(one.blocked for one in watched)}")
    print(f"  contacts of the moving arm: {sum(one.nearest_moving <= 0.0 for one in watched)}")
    print(
        f"  without a watch:            {sum(control.nearest_moving <= 0.0 for control, _ in pairs)}"
    )
    print(
        f"  hand into an arm at rest:   {sum(one.nearest <= 0.0 < one.nearest_moving for one in watched)}"
    )
    print(
        f"  smallest distance while the arm moved [mm]: median {median:.0f}, p5 {low:.0f}, least {gaps.min():.0f}"
    )


def main() -> None:
    """Run the trials and print the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--paths", type=int, default=200, help="paths against a hand")
    parser.add_argument("--free", type=int, default=100, help="paths on which nothing is new")
    parser.add_argument(
        "--unseen", type=int, default=50, help="paths against a hand that is not seen all the way"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--within",
        type=float,
        default=np.inf,
        help="only hands that would meet the arm by then [s]",
    )
    asked = parser.parse_args()
    trials, took = Trials(asked.seed, asked.within), []
    look = path_watch.PathWatch.look

    def timed(*arguments: Any) -> Any:
        began = time.perf_counter()
        found = look(*arguments)
        took.append(time.perf_counter() - began)
        return found

    path_watch.PathWatch.look = timed  # type: ignore[method-assign, assignment]
    free = []
    for _ in range(asked.free):
        q = trials.arm.state().q
        free.append(trials.run(trials.path(), None, True))
        if free[-1].blocked:
            print(f"false stop on free path {len(free)}: {free[-1].why}", flush=True)
            trials.go_back(q)
    pairs: list[tuple[WatchedPath, WatchedPath]] = []  # without a watch, and with it
    unseen = 0
    while len(pairs) - unseen < asked.paths:
        path = trials.path()
        reach = trials.reach(path)
        if reach is None:
            continue
        control = trials.run(path, reach, False)
        trials.go_back(path.q[0])
        if control.seen < SEEN and unseen >= asked.unseen:
            continue
        unseen += control.seen < SEEN
        path = replace(path, q=path.q + (trials.arm.state().q - path.q[0]))
        one = trials.run(path, reach, True)
        pairs.append((control, one))
        if one.nearest_moving <= 0.0:
            print(
                f"contact: seen on {control.seen:.0%} of its way, {one.speed:.2f} m/s, {reach}, {one.why}",
                flush=True,
            )
    print(f"{asked.free} paths on which nothing is new: {sum(o.blocked for o in free)} stopped, "
          f"{np.mean([o.duration for o in free] or [0.0]):.3f} s each")  # fmt: skip
    for seen in (True, False):
        chosen = [(control, one) for control, one in pairs if (control.seen >= SEEN) is seen]
        if chosen:
            tell(
                f"hands that a fixed camera sees {'' if seen else 'not '}on {SEEN:.0%} of their way",
                chosen,
            )
    other = sorted(
        {o.code for o in (*free, *(one for _, one in pairs)) if o.code not in ("", "PATH_BLOCKED")}
    )
    print(f"other endings: {', '.join(other) or 'none'}")
    ms = 1e3 * np.array(took[2:])
    print(
        f"a frame [ms]: median {np.median(ms):.1f}, p99 {np.percentile(ms, 99):.1f}, most {ms.max():.1f}, of {len(ms)}"
    )


if __name__ == "__main__":
    main()
