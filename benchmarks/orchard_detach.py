"""`Detach` alone at grasps that are free by the truth: ablations, and ± 50 % of the numbers that the motion depends on.

    python -m benchmarks.orchard_detach --walls 301..306 --out runs/reports/orchard_detach

No camera, map or path takes part. For each fruit the grasps of `SampleHanging` are searched, without a map, for one
whose hand, approach and roll touch nothing by the wall's truth. The arm starts at its pre-grasp. Each variant of a
fruit runs in a process of its own from the same state.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

import pomona.applications.harvest.connect as walls
import pomona.applications.harvest.detach as detach
from benchmarks.orchard_pick import ROOT, seeds_of, share
from pomona.applications.harvest.detaching import DetachSettings
from pomona.applications.harvest.hanging import (
    DRAWN,
    JUMP,
    HangingRules,
    knuckle_of,
    sample_hanging,
)
from pomona.applications.harvest.numbers import read_numbers
from pomona.applications.harvest.reachable import SPARE, GraspSearch
from pomona.drivers.interfaces import (
    Arm,
    ForceSensor,
    Frame,
    Gripper,
    Intrinsics,
    Motion,
    StreamedArm,
    Workspace,
)
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.executive.skill_testing import drive
from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import commit_here
from pomona.skills.geometry import rot_z, transform
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel, nearest_solution
from pomona.skills.perception.fruit.catalogue import load_fruit
from pomona.skills.perception.measured_fruit import MeasuredFruit

CELL = ROOT / "trees" / "cells" / "orchard.yaml"
ROLL = np.radians(140.0)
LIMIT = 25.0
"""Time after which a fruit is given up [s]."""
BATCHES, BATCH = 12, 6
"""Batches of grasps that are tried for a fruit, and their size."""
STEP, LEAST, GOOD = 10.0, 70.0, 100.0
"""Steps of the roll by the truth, the least roll of a grasp, and that which ends the search [deg]."""


@dataclass(frozen=True)
class Variant:
    """One way to run `Detach`: settings, inputs, a number of the wall with its factor, error of the position [m]."""

    name: str
    settings: Mapping[str, float]
    inputs: Mapping[str, float]
    number: tuple[str, float] | None = None
    error: float = 0.0


STRAIGHT = {
    "roll_rate": 1e-3, "roll_after": 99.0, "patience": 6.0, "first_break": -1.0, "pull_time": 3.0, "first_grip": 3.5,
}  # fmt: skip
ABLATIONS = (
    Variant("felt roll (the skill)", {}, {}),
    Variant("roll of 110° at most", {}, {"roll": np.radians(110.0)}),
    Variant("roll with 3.5 N from the start", {"first_grip": 3.5}, {}),
    Variant("roll without a pull", {"last_pull": 0.0}, {"pull": 0.0}),
    Variant("straight pull of 10 N, no roll", STRAIGHT, {"pull": 10.0}),
    Variant("position wrong by 6 mm (deviation of each axis)", {}, {}, error=6e-3),
)  # fmt: skip
NUMBERS = (
    "bend_angle",
    "twist_angle",
    "twist_median",
    "pull_median",
    "wood_modulus",
    "wood_damping",
    "fruit_friction",
)
"""Numbers of the wall that the motion may depend on; their change leaves the wall's shape as it is."""


@dataclass(frozen=True)
class TrueGrasp:
    """A grasp that is free by the truth."""

    fruit: int
    measured: MeasuredFruit
    T: Float64
    T_before: Float64
    q: Float64
    q_before: Float64
    ways: tuple[float, ...]


def measured_fruit(cell: Cell, i: int) -> MeasuredFruit:
    """Return a fruit of the wall as `Refine` would measure it without error."""
    world: Any = cell.devices["world"]
    hung = world.built.wall.fruits[i]
    frame = Frame(
        0.0,
        0,
        np.zeros((2, 2, 3), np.uint8),
        None,
        Intrinsics(1.0, 1.0, 0.5, 0.5, 2, 2),
        np.eye(4),
        np.eye(4),
    )
    return MeasuredFruit(
        fruit=load_fruit("apple"), T_base_fruit=hung.T_base_fruit, T_base_camera=np.eye(4),
        dimensions=np.array(hung.dimensions), mu=1.0, sigma=0.0, covariance=1e-6 * np.eye(6), inlier_ratio=1.0,
        residual=0.0, contour=np.empty((0, 2)), frame=frame, method="truth",
    )  # fmt: skip


def placed_grasps(cell: Cell) -> Iterator[TrueGrasp]:
    """Yield one free grasp of each fruit that has one, the first whose hand can roll by `GOOD`, else the best."""
    world: Any = cell.devices["world"]
    search = GraspSearch(world.built, world.description)
    for i in range(len(world.built.fruit_bodies)):
        found = max(_grasps(cell, search, i), key=lambda each: each[0], default=None)
        if found is not None and found[0] >= LEAST:
            yield found[1]


def _grasps(cell: Cell, search: GraspSearch, i: int) -> Iterator[tuple[float, TrueGrasp]]:
    measured, arm, workspace = measured_fruit(cell, i), cell.device(Arm), cell.workspace
    assert workspace is not None
    robot = RobotModel.load(arm.description)
    space = arm_space(arm, workspace, None, robot.width_max, 6e-3, target=measured)
    without: set[int] = set()
    search._preset(_opening(robot, measured))
    for _ in range(BATCHES):
        q_now, rules = workspace.poses["observe"], HangingRules(enough=BATCH)
        grasps, _ = sample_hanging(measured, robot, space, q_now, rules, frozenset(without))
        if not grasps:
            return
        for grasp in grasps:
            without.add(grasp.index)
            T, T_before = grasp.T_base_grasp, grasp.T_base_pre_grasp
            if not (search._hand_free(T) and search._hand_free(T_before)):
                continue
            for q_before in grasp.q_pre_grasp:
                line = straight_line(robot, q_before, T)
                if not (line.complete and search._free(line.q[-1]) and search._free(q_before)):
                    continue
                rolls = {
                    way: _free_roll(search, robot, measured, i, line.q[-1], way)
                    for way in (1.0, -1.0)
                }
                ways = tuple(
                    way for way in sorted(rolls, key=lambda way: -rolls[way]) if rolls[way] >= LEAST
                )
                yield (
                    max(rolls.values()),
                    TrueGrasp(i, measured, T, T_before, line.q[-1], q_before, ways),
                )
                if max(rolls.values()) >= GOOD:
                    return


def _free_roll(
    search: GraspSearch, robot: RobotModel, measured: MeasuredFruit, i: int, q: Float64, way: float
) -> float:
    """Return how far the hand can roll by the truth [deg]."""
    T, knuckle, reached = robot.tcp(q), knuckle_of(measured), 0.0
    lever = T[:3, :3].T @ (T[:3, 3] - knuckle)
    for angle in np.arange(STEP, 121.0, STEP):
        R = T[:3, :3] @ rot_z(way * np.radians(angle))
        goal = transform(R, knuckle + R @ lever + DRAWN * min(np.radians(angle), 1.0))
        solved = nearest_solution(robot, goal, q)
        if solved is None or np.abs(solved - q).max() > JUMP or not search._free(solved, i):
            break
        q, reached = solved, float(angle)
    return reached


def _opening(robot: RobotModel, measured: MeasuredFruit) -> float:
    return float(min(measured.dimensions.max() + SPARE, robot.width_max - 2e-3))


def run(cell: Cell, placed: TrueGrasp, variant: Variant) -> dict[str, Any]:
    """Run `Detach` at a grasp and return the fate of its fruit."""
    world: Any = cell.devices["world"]
    arm, gripper = cell.device(Arm), cell.device(Gripper)
    _put(cell, placed.q_before)
    robot = RobotModel.load(arm.description)
    width = _opening(robot, placed.measured)
    _wait(cell, gripper.move(width, 0.1))
    line = straight_line(robot, arm.state().q, placed.T)
    _wait(cell, arm.follow(time_curve(line.q, line.length, arm.limits, 0.15, 1.0, 10.0)))
    noise = np.random.default_rng([world.seed, placed.fruit, 5]).normal(0.0, variant.error, 3)
    seen = placed.measured.T_base_fruit.copy()
    seen[:3, 3] += noise
    measured = replace(placed.measured, T_base_fruit=seen)
    grasp = Grasp(
        0, 0.0, 0.0, placed.T_before, placed.T, width, placed.q[None], 0.01, 0.0, measured
    )
    devices: dict[type, object] = {
        kind: cell.device(kind) for kind in (Arm, StreamedArm, Gripper, ForceSensor)
    }
    devices[Workspace] = cell.workspace
    settings = dict(variant.settings)
    module: Any = detach
    module.DetachSettings = lambda **given: DetachSettings(**{**given, **settings})
    asked = module.Detach._rolls

    def free_ways(*args: Any) -> tuple[float, ...]:
        rolls = asked(*args)
        return tuple(roll for roll in rolls if np.sign(roll) in placed.ways) or rolls

    module.Detach._rolls = free_ways
    began = cell.clock.now()
    end = drive(
        detach.Detach(),
        {"grasp": grasp, "roll": ROLL, **variant.inputs},
        devices,
        clock=cell.clock,
        limit=LIMIT,
    )
    report = world.score.report()
    story = report["fruits"][placed.fruit]
    return {
        "off": end.reason is None and story["place"] == "hand",
        "code": end.reason.code if end.reason else "",
        "bruised": story["bruised"],
        "knocked": report["knocked_off"],
        "torn": report["stems_torn"],
        "time": cell.clock.now() - began,
        "stem": story["stem_force_n"],
    }  # fmt: skip


def _put(cell: Cell, q: Float64) -> None:
    """Put the simulated arm into a posture."""
    world: Any = cell.devices["world"]
    sim_arm: Any = cell.devices["arm"]
    world.state.qpos[world.model.jnt_qposadr[world.arm_joints]] = q
    world.state.ctrl[world.arm_actuators] = q
    sim_arm._set_point = q.copy()
    cell.clock.advance(0.2)


def _wait(cell: Cell, motion: Motion) -> None:
    end = cell.clock.now() + 10.0
    while not motion.settled and cell.clock.now() < end:
        cell.clock.advance(0.02)


def _child(pipe: Connection, cell: Cell, placed: TrueGrasp, variant: Variant) -> None:
    try:
        pipe.send(run(cell, placed, variant))
    except Exception as error:  # a run that fails in any way counts as a fruit that stays
        pipe.send(
            {
                "off": False,
                "code": type(error).__name__,
                "bruised": False,
                "knocked": 0,
                "torn": 0,
                "time": np.nan,
            }
        )


def in_a_process(cell: Cell, placed: TrueGrasp, variant: Variant) -> dict[str, Any]:
    """Run a variant in a fork, which leaves the cell as it is."""
    ours, theirs = multiprocessing.get_context("fork").Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(
        target=_child, args=(theirs, cell, placed, variant)
    )
    process.start()
    theirs.close()
    try:
        found: dict[str, Any] = ours.recv()
    except EOFError:
        found = {
            "off": False,
            "code": "ended",
            "bruised": False,
            "knocked": 0,
            "torn": 0,
            "time": np.nan,
        }
    process.join()
    return found


def load_wall(seed: int, number: tuple[str, float] | None = None) -> Cell:
    """Return the cell of a wall without leaves, with one of its numbers scaled."""

    def scaled(path: Path) -> Any:
        numbers, origins = read_numbers(path)
        return (numbers.scaled(*number) if number else numbers), origins

    module: Any = walls
    module.read_numbers = scaled
    return load_cell(CELL, seed=seed, overrides={"leaves": "0", "behind": "0"})


def measure(seed: int, varied: Sequence[str], ablations: int) -> dict[str, Any]:
    """Return the number of fruit of a wall, and the results of each variant."""
    cell = load_wall(seed)
    placed = list(placed_grasps(cell))
    results: dict[str, list[dict[str, Any]]] = {}
    world: Any = cell.devices["world"]
    count = len(world.built.fruit_bodies)
    for variant in ABLATIONS[:ablations]:
        results[variant.name] = [in_a_process(cell, each, variant) for each in placed]
    cell.close()
    for name in varied:
        for factor in (0.5, 1.5):
            cell, variant = load_wall(seed, (name, factor)), Variant(f"{name} × {factor}", {}, {})
            results[variant.name] = [in_a_process(cell, each, variant) for each in placed]
            cell.close()
    print(
        seed,
        {name: f"{sum(r['off'] for r in rows)} of {len(rows)}" for name, rows in results.items()},
        flush=True,
    )
    return {"commit": commit_here(), "apples": count, "results": results}


def page(walls: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the report of some walls, by their seeds."""
    names = list(dict.fromkeys(name for wall in walls.values() for name in wall["results"]))
    results = {
        name: [row for wall in walls.values() for row in wall["results"].get(name, [])]
        for name in names
    }
    commits = ", ".join(sorted({f"`{wall['commit']}`" for wall in walls.values()}))
    lines = [
        "# Simulated: `Detach` alone at grasps that are free by the truth",
        "",
        f"Simulated, at commit {commits} by `make orchard-detach`: walls {', '.join(sorted(walls))}, no leaves, "
        f"{sum(wall['apples'] for wall in walls.values())} apples, {len(results[names[0]])} of them with such a grasp. "
        "No camera, map or path takes part.",
        "",
        "| variant | off and in the hand | share | 95 % interval | bruised | neighbours off | stems torn | time [s] "
        "| stem force [N] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, rows in results.items():
        off = [row for row in rows if row["off"]]
        stem = np.median([row["stem"] for row in off]) if off else np.nan
        sums = [sum(row[key] for row in rows) for key in ("bruised", "knocked", "torn")]
        time = np.nanmean([row["time"] for row in rows])
        lines.append(
            f"{share(name, len(off), len(rows))} {sums[0]} | {sums[1]} | {sums[2]} | {time:.1f} | {stem:.1f} |"
        )
    return "\n".join(
        [*lines, "", "Time: mean of all tries; stem force: median of those that came off.", ""]
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--walls", default="301..306", help="seeds, 301..306 or 301,305")
    parser.add_argument(
        "--numbers", nargs="*", default=NUMBERS, help="numbers of the wall to vary by ± 50 %%"
    )
    parser.add_argument(
        "--ablations",
        type=int,
        default=len(ABLATIONS),
        help="number of variants to run, from the first",
    )
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "reports" / "orchard_detach")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "walls.json"
    walls = json.loads(kept.read_text()) if kept.exists() else {}
    for seed in seeds_of(args.walls):
        walls[str(seed)] = measure(seed, args.numbers, args.ablations)
        kept.write_text(json.dumps(walls) + "\n")
    text = page(walls)
    (args.out / "report.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
