"""Times of the parts of planning: inverse kinematics, collision checks, map update, distance field.

    python -m benchmarks.motion_kernels

Every line compares two ways of the same work in the same run; the ratio is what counts, times drift with the machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

from pomona.drivers.interfaces import Frame, Intrinsics, Workspace
from pomona.skills.geometry import rot_x, rot_y, rot_z, transform
from pomona.skills.motion.collision import CollisionWorld, DistanceField
from pomona.skills.motion.occupancy import OccupancyMap, integrate
from pomona.skills.motion.robot import RobotModel, inverse_kinematics
from pomona.skills.motion.robot.inverse_kinematics import descend, spread_starts

ROBOT = Path(__file__).resolve().parents[1] / "trees" / "robots" / "sia5f_wsg32.xml"
ROUNDS = 7


def best(work: Callable[[], object], rounds: int = ROUNDS) -> float:
    """Shortest time of some rounds, after one to warm up [s]."""
    work()
    times = []
    for _ in range(rounds):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def pre_grasps(centre: np.ndarray, radius: float = 0.12) -> list[np.ndarray]:
    """125 poses of the TCP on a sphere, looking at its centre."""
    poses = []
    for theta in np.linspace(0.0, np.radians(45.0), 5):
        for alpha in np.linspace(0.0, 2.0 * np.pi, 25, endpoint=False):
            R = rot_z(alpha) @ rot_y(theta) @ rot_x(np.pi)
            poses.append(transform(R, centre - radius * R[:, 2]))
    return poses


def bench_kinematics(robot: RobotModel) -> None:
    rng = np.random.default_rng(0)
    poses = [robot.tcp(rng.uniform(robot.lower, robot.upper)) for _ in range(50)]
    closed = best(lambda: [inverse_kinematics(robot, T) for T in poses]) / len(poses)
    found = np.mean([len(inverse_kinematics(robot, T)) for T in poses])
    starts = spread_starts(robot, 50)
    descent = best(lambda: [descend(robot, T, starts) for T in poses], 3) / len(poses)
    reached = np.mean([len(descend(robot, T, starts)) for T in poses])
    print(
        f"inverse kinematics of a pose: closed form {1e6 * closed:.0f} µs for {found:.0f} solutions, "
        f"descent {1e6 * descent:.0f} µs for {reached:.0f}: {descent / reached / (closed / found):.0f} x a solution"
    )


def bench_collision(robot: RobotModel) -> None:
    rng = np.random.default_rng(1)
    blocked = np.zeros((120, 100, 84), dtype=np.bool_)
    for _ in range(8):
        x, y = rng.integers(10, 110), rng.integers(10, 60)
        blocked[x - 4 : x + 4, y - 4 : y + 4, 2:10] = True
    lower = np.array([-0.6, -0.8, -0.14])
    field = DistanceField.of_blocked(blocked, lower, 0.01, 0.3)
    workspace = Workspace(-0.12, lower, np.array([0.6, 0.2, 0.7]))
    world = CollisionWorld.build(robot, workspace, field)
    postures = rng.uniform(robot.lower, robot.upper, (5000, robot.dof))
    check = best(lambda: world.free(postures, 0.08)) / len(postures)
    exact = best(lambda: world.clearances(postures, 0.08), 3) / len(postures)
    print(f"one posture: free or not {1e6 * check:.2f} µs, with its clearance {1e6 * exact:.1f} µs")
    free = postures[world.free(postures, 0.08)][:1000]
    ends = np.clip(free + rng.normal(size=free.shape) * 0.15, robot.lower, robot.upper)
    proven = best(
        lambda: [world.segment_free(a, b, 0.08) for a, b in zip(free, ends, strict=True)], 3
    ) / len(free)
    share = np.linspace(0.0, 1.0, 100)[:, None]
    sampled = best(
        lambda: [world.free(a + share * (b - a), 0.08) for a, b in zip(free, ends, strict=True)], 3
    ) / len(free)
    print(
        f"one segment of {np.linalg.norm(ends - free, axis=1).mean():.2f} rad: proven {1e6 * proven:.0f} µs, "
        f"100 samples (no proof) {1e6 * sampled:.0f} µs: {sampled / proven:.1f} x"
    )
    poses = pre_grasps(np.array([-0.03, -0.45, -0.08]))

    def all_pre_grasps() -> int:
        found = [inverse_kinematics(robot, T) for T in poses]
        return int(world.free(np.vstack(found), 0.1).sum())

    print(
        f"125 pre-grasps x 36 arm angles, solved and checked: {1e3 * best(all_pre_grasps):.0f} ms"
    )


def bench_map() -> None:
    lens = Intrinsics(610.6, 610.6, 317.7, 238.1, 640, 480)
    T_base_camera = transform(rot_x(np.pi - 0.35), [-0.04, -0.25, 0.6])
    rng = np.random.default_rng(2)
    v, u = np.mgrid[: lens.height, : lens.width].astype(float)
    rays = np.stack(((u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones_like(u)), axis=-1)
    depth = (-0.12 - 0.6) / (rays @ T_base_camera[:3, :3].T)[..., 2]
    for _ in range(8):
        row, column = rng.integers(60, 420), rng.integers(60, 580)
        depth[row - 40 : row + 40, column - 40 : column + 40] -= 0.07
    frame = Frame(
        0.0,
        0,
        np.zeros((480, 640, 3), np.uint8),
        depth.astype(np.float32),
        lens,
        None,
        T_base_camera,
    )
    for name, lower, upper, resolution in (
        ("2 cm, 2 x 2 x 1.6 m", np.array([-1.0, -1.0, -0.2]), np.array([1.0, 1.0, 1.4]), 0.02),
        ("1 cm, 1.2 x 1 x 0.84 m", np.array([-0.6, -0.8, -0.14]), np.array([0.6, 0.2, 0.7]), 0.01),
    ):
        workspace = Workspace(-0.12, lower, upper)
        grid = OccupancyMap.empty(lower, upper, resolution)
        update = best(
            lambda grid=grid, workspace=workspace: integrate(grid, frame, T_base_camera, workspace)
        )  # type: ignore[misc]
        blocked = integrate(grid, frame, T_base_camera, workspace).blocked
        own = best(
            lambda blocked=blocked, r=resolution: DistanceField.of_blocked(
                blocked, np.zeros(3), r, 0.3
            )
        )  # type: ignore[misc]
        scipys = best(lambda blocked=blocked: distance_transform_edt(~blocked), 3)  # type: ignore[misc]
        print(
            f"map of {name} ({blocked.size} cells): a frame {1e3 * update:.1f} ms, distance field {1e3 * own:.1f} ms, "
            f"scipy's {1e3 * scipys:.0f} ms: {scipys / own:.1f} x"
        )


def main() -> None:
    """Print all comparisons."""
    robot = RobotModel.load(ROBOT)
    bench_kinematics(robot)
    bench_collision(robot)
    bench_map()


if __name__ == "__main__":
    main()
