"""MotionBenchMaker's problems with this project's planner.

python -m benchmarks.bench_problems --problems FOLDER --robot panda_spherized.urdf --tool panda_hand
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.motion_bench_maker import BadProblem, PlanningProblem, problem_sets, read_problems
from pomona.executive.values.kinds import Measure
from pomona.executive.values.units import TIME
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.planning.plan import PLANNERS, solve
from pomona.skills.motion.planning.space import Effort, path_length, shortcut
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.robot.errors import RobotError


@dataclass(frozen=True, slots=True)
class PlannedProblem:
    """One problem: whether start and goal are free, the planner's time [s], and the path's length, NaN for none."""

    valid: bool
    seconds: float
    length: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print."""
    planning = argparse.ArgumentParser(
        description="Motion planning on folders of MotionBenchMaker."
    )
    planning.add_argument(
        "--problems", type=Path, required=True, help="folder with scenes and requests"
    )
    planning.add_argument(
        "--robot", type=Path, required=True, help="URDF or MJCF with collision spheres or shapes"
    )
    planning.add_argument("--tool", default="tool0", help="frame at the end of the planned joints")
    planning.add_argument("--planner", default="RRTConnect", choices=tuple(PLANNERS))
    planning.add_argument(
        "--budget",
        type=Measure(TIME, "1 ms").option,
        default=10.0,
        help="of a problem on an unloaded core (10s)",
    )
    planning.add_argument("--limit", type=int, default=0, help="problems of each set, 0 for all")
    planning.add_argument("--seed", type=int, default=0)
    try:
        _run_and_print(planning.parse_args(arguments))
    except (BadProblem, RobotError) as unusable:
        sys.stderr.write(f"{unusable}\n")
        return 2
    return 0


def _run_and_print(options: argparse.Namespace) -> None:
    robot = RobotModel.load(options.robot, tool=options.tool, tcp=options.tool)
    everything: list[PlannedProblem] = []
    for folder in problem_sets(options.problems):
        attempts = run_set(
            read_problems(folder, robot, options.limit),
            options.planner,
            options.budget,
            options.seed,
        )
        everything += attempts
        sys.stdout.write(f"{folder.name:32} {summary(attempts)}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{'all':32} {summary(everything)}\n")


def run_set(
    problems: Iterable[PlanningProblem], planner: str, budget: float, seed: int
) -> list[PlannedProblem]:
    """Plan every problem once; times are processor time of planning alone, without shortcuts."""
    return [_attempt(problem, planner, budget, seed) for problem in problems]


def _attempt(problem: PlanningProblem, planner: str, budget: float, seed: int) -> PlannedProblem:
    space = ArmSpace(problem.world, problem.world.shape.model.width_max)
    if not (space.free(problem.q_start) and space.free(problem.q_goal)):
        return PlannedProblem(False, np.nan, np.nan)
    began = time.process_time()
    if space.free_between(problem.q_start, problem.q_goal):
        waypoints = np.array([problem.q_start, problem.q_goal])
    else:
        iterations = int(budget * PLANNERS[planner].iterations_per_second)
        effort = Effort(iterations, seed, time.perf_counter() + 10.0 * budget)
        found = solve(space, problem.q_start, problem.q_goal[None], planner, effort)
        if found.waypoints is None:
            return PlannedProblem(True, time.process_time() - began, np.nan)
        waypoints = found.waypoints
    seconds = time.process_time() - began
    return PlannedProblem(
        True, seconds, path_length(shortcut(space, waypoints, np.random.default_rng(seed)))
    )


def summary(attempts: list[PlannedProblem]) -> str:
    """Solved, median and p95 as one line."""
    valid = [attempt for attempt in attempts if attempt.valid]
    solved = [attempt for attempt in valid if np.isfinite(attempt.length)]
    line = f"solved {len(solved)} of {len(valid)}"
    if solved:
        took = 1e3 * np.array([attempt.seconds for attempt in solved])
        line += f", median {np.median(took):.1f} ms, p95 {np.percentile(took, 95):.1f} ms"
        line += f", length {np.median([attempt.length for attempt in solved]):.1f}"
    left_out = len(attempts) - len(valid)
    return line + (f" ({left_out} with start or goal in collision)" if left_out else "")


if __name__ == "__main__":
    sys.exit(main())
