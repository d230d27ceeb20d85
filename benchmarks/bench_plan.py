"""Planning on random tables: how often, how fast, how short, against the paper's way in the same run.

    python -m benchmarks.bench_plan [--scenes 200] [--paper 25]

For every scene: does an exhaustive search find any grasp that can be approached; do SampleGrasp and Plan bring the arm
to one; how long does that take from the refined fruit to a checked, timed trajectory; does MuJoCo's own collision
detection, on the robot's own shapes, find any contact on the path and on the approach. On the first scenes the paper's
way is run as well: one candidate after the other, unchecked, RRT* to one goal with its whole budget of 1 s each.
In every other scene the arm starts from a random free posture instead of the observe pose. A third of the scenes is
obstructed by a wall, a shelf, posts or a crate, and the arm starts low over the table. Times are processor time.
"""

from __future__ import annotations

import argparse
import contextlib
import time
from dataclasses import dataclass, field

import numpy as np

from benchmarks.planning_oracle import PlanningOracle
from benchmarks.planning_scenes import (
    OBSERVE,
    PEDESTAL,
    TABLE_Z,
    WORKSPACE,
    PlanningScene,
    random_scene,
    table_look,
)
from pomona.drivers.interfaces import ArmLimits
from pomona.drivers.trajectory import check_trajectory
from pomona.executive.values.arrays import Float64
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.grasps.sample import GraspRules, sample_pre_grasps
from pomona.skills.motion.grasps.sphere import Sphere
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.occupancy import OccupancyMap, integrate
from pomona.skills.motion.planning.plan import PlanRequest, PlanResult, plan
from pomona.skills.motion.planning.space import PlanningFailed
from pomona.skills.motion.robot import RobotModel
from pomona.skills.sample_grasp import FINER

EXHAUSTIVE = GraspRules(solutions=1, tried_solutions=10_000, arm_angles=72)
PAPER = GraspRules(solutions=1, check=False)
PAPER_ATTEMPTS = 48


@dataclass(frozen=True, slots=True)
class PlannedScene:
    """One scene, one way."""

    solved: bool
    seconds: float
    length: float = np.nan
    duration: float = np.nan
    improved_s: float = np.nan
    found_by: str = ""
    goals: int = 0


@dataclass(slots=True)
class SceneTally:
    """Results of all scenes so far; `ours` has those with any feasible path."""

    scenes: int = 0
    obstructed: int = 0
    ours: list[PlannedScene] = field(default_factory=list)
    paper: list[tuple[PlannedScene, PlannedScene]] = field(default_factory=list)
    collisions: int = 0
    states: int = 0


def clock() -> float:
    """Processor time of this process [s]: everything here computes in one thread, and others may use the machine."""
    return time.process_time()


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument(
        "--paper", type=int, default=25, help="scenes on which the paper's way is run too"
    )
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--robot", default="trees/robots/sia5f_wsg32.xml")
    chosen = parser.parse_args()
    robot = RobotModel.load(chosen.robot)
    limits = ArmLimits(robot.lower, robot.upper, robot.velocity, robot.acceleration, robot.jerk)
    warm_scene = random_scene(10**6)
    set_based(robot, limits, warm_scene, OBSERVE, 0)
    tally = SceneTally()
    with contextlib.suppress(KeyboardInterrupt):  # the results so far are reported
        for seed in range(chosen.first, chosen.first + chosen.scenes):
            one_scene(robot, limits, seed, chosen.paper, tally)
    report(tally)
    compare(tally.paper)
    time_map()


def one_scene(
    robot: RobotModel, limits: ArmLimits, seed: int, paper: int, tally: SceneTally
) -> None:
    """Plan in one scene, ask the oracle, and run the paper's way in the first `paper` scenes."""
    obstructed = seed % 3 == 2
    scene = random_scene(seed, obstructed)
    if obstructed:
        q_start = low_posture(robot, scene, seed)
    else:
        q_start = OBSERVE if seed % 2 == 0 else free_posture(robot, scene, seed)
    run, found, grasp = set_based(robot, limits, scene, q_start, seed)
    possible = run.solved or exhaustive(robot, scene)
    if found is not None and grasp is not None:
        check_trajectory(found.path, limits)
        hits, looked = oracle_contacts(robot, scene, found, grasp)
        tally.collisions, tally.states = tally.collisions + hits, tally.states + looked
    if possible and len(tally.paper) < paper:
        tally.paper.append((run, paper_way(robot, limits, scene, q_start, seed)))
    if possible and not run.solved:
        print(
            f"scene {seed}: not solved ({len(scene.fruits)} other fruits, {len(scene.boxes)} boxes)"
        )
    tally.scenes, tally.obstructed = tally.scenes + 1, tally.obstructed + obstructed
    if possible:
        tally.ours.append(run)


def free_posture(robot: RobotModel, scene: PlanningScene, seed: int) -> Float64:
    """A random posture that is free of collision."""
    rng, space = np.random.default_rng(seed), scene.space(robot)
    while True:
        q: Float64 = rng.uniform(robot.lower, robot.upper)
        if space.free(q):
            return q


def low_posture(robot: RobotModel, scene: PlanningScene, seed: int) -> Float64:
    """A free posture with the gripper low over the table, as after a failed attempt; higher where it does not fit."""
    rng, space = np.random.default_rng(seed), scene.space(robot)
    height = 0.06
    while True:
        q: Float64 = rng.uniform(robot.lower, robot.upper)
        T = robot.tcp(q)
        height += 1e-4
        if T[1, 3] < -0.15 and T[2, 3] < height and T[2, 2] < 0.3 and space.free(q):
            return q


def exhaustive(robot: RobotModel, scene: PlanningScene) -> bool:
    """Whether any grasp of a fine sphere can be approached with any of very many joint solutions."""
    sphere = Sphere(tilts=10, turns=36)
    grasps, _ = sample_pre_grasps(
        scene.target, robot, scene.space(robot), OBSERVE, TABLE_Z, sphere, EXHAUSTIVE
    )
    return bool(grasps)


def set_based(
    robot: RobotModel, limits: ArmLimits, scene: PlanningScene, q_start: Float64, seed: int
) -> tuple[PlannedScene, PlanResult | None, Grasp | None]:
    """This project's way: all candidates as one goal set."""
    space = scene.space(robot)
    began = clock()
    sphere = Sphere()
    for _ in range(1 + FINER):
        grasps, _ = sample_pre_grasps(scene.target, robot, space, q_start, TABLE_Z, sphere)
        if grasps:
            break
        sphere = sphere.finer()
    goals = [(grasp, q) for grasp in grasps for q in grasp.q_pre_grasp]
    sampled = clock() - began
    if not goals:
        return PlannedScene(False, sampled), None, None
    request = PlanRequest(space, q_start, np.array([q for _, q in goals]), limits, seed=seed)
    try:
        found = plan(request)
    except PlanningFailed:
        return PlannedScene(False, clock() - began), None, None
    total = clock() - began
    first = sampled + (total - sampled) * found.first_path_s / found.total_s
    run = PlannedScene(
        True, first, found.length, found.path.duration, total, found.found_by, len(goals)
    )
    return run, found, goals[found.goal][0]


def paper_way(
    robot: RobotModel, limits: ArmLimits, scene: PlanningScene, q_start: Float64, seed: int
) -> PlannedScene:
    """The paper's way: one candidate after the other, RRT* to its one goal for a second."""
    space = scene.space(robot)
    began = clock()
    grasps, _ = sample_pre_grasps(scene.target, robot, space, q_start, TABLE_Z, rules=PAPER)
    for attempt, grasp in enumerate(grasps[:PAPER_ATTEMPTS]):
        request = PlanRequest(
            space,
            q_start,
            grasp.q_pre_grasp[:1],
            limits,
            "RRTstar",
            "",
            1.0,
            seed + attempt,
            direct=False,
        )
        try:
            found = plan(request)
        except PlanningFailed:
            continue
        line = straight_line(robot, found.path.q[-1], grasp.T_base_grasp)
        at_width = space.at_width(grasp.width)
        if line.complete and all(at_width.free(q) for q in line.q):
            return PlannedScene(True, clock() - began, found.length, found.path.duration)
    return PlannedScene(False, clock() - began)


def oracle_contacts(
    robot: RobotModel, scene: PlanningScene, found: PlanResult, grasp: Grasp
) -> tuple[int, int]:
    """States of the path and the approach in which MuJoCo finds a contact, and how many were looked at."""
    oracle = PlanningOracle(robot, TABLE_Z, (PEDESTAL, *scene.boxes), scene.fruits)
    line = straight_line(robot, found.path.q[-1], grasp.T_base_grasp).q
    touched = sum(bool(oracle.contacts(q, robot.width_max)) for q in found.path.q)
    touched += sum(bool(oracle.contacts(q, grasp.width)) for q in line)
    return touched, len(found.path.q) + len(line)


def report(tally: SceneTally) -> None:
    """The figures of this project's way."""
    solvable, solved = len(tally.ours), [run for run in tally.ours if run.solved]
    planner = [run for run in solved if run.found_by != "straight"]
    print(
        f"{tally.scenes} scenes, {tally.obstructed} of them obstructed, {solvable} with a grasp that an exhaustive "
        f"search finds.\nsolved          {len(solved)} of {solvable} ({100.0 * len(solved) / max(solvable, 1):.1f} %), "
        f"{len(solved) - len(planner)} straight, {len(planner)} by a planner\n"
        f"first path      {_times(solved)} from the refined fruit to a checked, timed trajectory "
        f"(median {np.median([r.goals for r in solved]):.0f} goals); by a planner {_times(planner)}\n"
        f"with the budget median {1e3 * np.median([r.improved_s for r in solved]):.0f} ms\n"
        f"trajectory      median {np.median([r.duration for r in solved]):.2f} s, "
        f"{np.median([r.length for r in solved]):.2f} rad\n"
        f"oracle          {tally.collisions} of {tally.states} executed states touch anything"
    )


def _times(runs: list[PlannedScene]) -> str:
    if not runs:
        return "never"
    first = 1e3 * np.array([run.seconds for run in runs])
    return f"median {np.median(first):.1f} ms, p95 {np.percentile(first, 95):.1f} ms"


def compare(pairs: list[tuple[PlannedScene, PlannedScene]]) -> None:
    """Against the paper's way, in the same run, scene by scene."""
    if not pairs:
        return
    both = [(ours, paper) for ours, paper in pairs if ours.solved and paper.solved]
    print(f"paper's way     solved {sum(paper.solved for _, paper in pairs)} of {len(pairs)}")
    if both:
        speed = np.median([paper.seconds / ours.seconds for ours, paper in both])
        length = np.median([ours.length / paper.length for ours, paper in both])
        print(
            f"                median {1e3 * np.median([p.seconds for _, p in both]):.0f} ms; this project's first path "
            f"is {speed:.0f} x faster at {length:.2f} x the length (medians over {len(both)} scenes)"
        )


def time_map() -> None:
    """One look fused into 800 000 cells of 2 cm, and their distance field."""
    lower, upper = np.array([-1.0, -1.2, -0.3]), np.array([1.0, 0.8, 1.3])
    frame, T_base_camera = table_look()
    empty = OccupancyMap.empty(lower, upper, 0.02)
    update, field = [], []
    for _ in range(12):
        began = clock()
        fused = integrate(empty, frame, T_base_camera, WORKSPACE)
        update.append(clock() - began)
        began = clock()
        _ = fused.field
        field.append(clock() - began)
    print(
        f"map             {fused.states.size} cells of 2 cm: update median {1e3 * np.median(update[2:]):.1f} ms, "
        f"distance field {1e3 * np.median(field[2:]):.1f} ms"
    )


if __name__ == "__main__":
    main()
