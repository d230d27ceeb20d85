"""Behaviour cloning from end to end: demonstrations, a dataset of LeRobot, training, success on goals never shown.

    python -m benchmarks.reach [demonstrate] [train] [judge] [--demonstrations 150] [--goals 60] [--out runs/reach]

`demonstrate` lets the planner move the simulated arm to drawn goals, records the runs and exports the records as
`pomona runs export --to lerobot` does. `train` reads that dataset and nothing else. `judge` tries the clone on goals
never shown, without physics and as the skill `Policy` in the simulated cell, and measures by the simulated joints how
far from the goal the tool's point came to rest.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.applications.policy.policy_network import PolicyNetwork, read_policy, write_policy
from pomona.drivers.interfaces import Arm, Workspace
from pomona.executive.cell.connect import load_cell
from pomona.executive.errors import PomonaError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.running.events import Event, NodeChanged
from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import need
from pomona.skills.geometry import transform
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.robot.inverse_kinematics import inverse_kinematics
from pomona.skills.motion.robot.spherical_arm import as_spherical_arm
from pomona.tools.campaign.statistics import wilson
from pomona.tools.exchange.lerobot import ACTION, EXTRA, STATE, export_lerobot

CELLS = Path(__file__).parents[1] / "trees" / "cells"
ROBOT = CELLS.parent / "robots" / "sia5f_wsg32.xml"
START = "observe"
LOWER, UPPER = np.array([-0.14, -0.52, 0.04]), np.array([0.08, -0.36, 0.18])
"""Goals of the tool's point in the base frame [m]: over the table, above its fruit."""
AT_START, BESIDE = 0.02, 0.1
"""Standard deviations of a joint where demonstrations begin, at the start and beside the way from there [rad]."""
NEAR = 0.01
"""A tool's point so near to its goal has reached it [m]."""
RATE, AHEAD = 20, 12
"""Steps a second of the dataset, and how many of them the policy looks ahead."""
PART = 25
"""Demonstrations of one run."""
RESTS, REST = 5e-4, 4
"""Joints that go less than this in a step rest [rad]; a motion ends with so many such steps (trees wait six)."""
WIDTH, ROUNDS, BATCH, LEARNING, SEED = 64, 3000, 256, 5e-3, 7
DECISIONS = 80
"""Of a try without physics."""


@dataclass(frozen=True, slots=True)
class Expert:
    """Joints for a goal: one branch of the inverse kinematics, the tool plumb and the elbow where it is at the start.

    With the tool turned as at the start the box lies about a singularity of the wrist, where joints 5 and 7 of goals
    10 mm apart differ by 30 degrees: nothing that a few demonstrations show.
    """

    robot: RobotModel
    start: Float64
    nominal: Float64
    arm_angle: float
    R: Float64

    @staticmethod
    def of(robot: RobotModel, start: Float64) -> Expert:
        """For an arm and the joints (dof,) [rad] from which it begins."""
        y, z = robot.tcp(start)[:3, 1] * [1.0, 1.0, 0.0], np.array([0.0, 0.0, -1.0])
        y /= np.linalg.norm(y)
        R = np.column_stack([np.cross(y, z), y, z])
        T = transform(R, (LOWER + UPPER) / 2.0)
        nominal = inverse_kinematics(robot, T, near=start)[0]
        arm = as_spherical_arm(robot)
        assert arm is not None
        return Expert(robot, start, nominal, arm.arm_angle(nominal, T), R)

    def joints(self, goal: Float64) -> Float64:
        """Where the arm stands with the tool's point at a goal (3,) [m], shape (dof,) [rad]."""
        arm = as_spherical_arm(self.robot)
        assert arm is not None
        found = arm.solve(
            transform(self.R, goal), np.array([self.arm_angle]), self.robot.lower, self.robot.upper
        )
        nearest: Float64 = found[np.argmin(((found - self.nominal) ** 2).sum(axis=1))]
        return nearest


def simulated() -> Expert:
    """For the arm of the simulated cell, and where it stands at first."""
    cell = load_cell(CELLS / "sim.yaml")
    try:
        return Expert.of(
            RobotModel.load(cell.device(Arm).description), cell.device(Workspace).poses[START]
        )
    finally:
        cell.close()


def drawn(count: int, seed: int) -> Float64:
    """Goals, shape (count, 3) [m]."""
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (count, 3))


# ------------------------------------------------------------------------------------------ demonstrations


def beginnings(expert: Expert, count: int, seed: int) -> Float64:
    """Joints from which demonstrations begin, shape (count, dof) [rad].

    Every third lies at the start, the others beside the way from there to somewhere in the box, so that the clone
    learns to correct its errors.
    """
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        way, share = (
            expert.joints(rng.uniform(LOWER, UPPER)) - expert.start,
            0.0 if k % 3 == 0 else rng.uniform(),
        )
        found.append(
            expert.start + share * way + rng.normal(0.0, BESIDE if k % 3 else AT_START, way.size)
        )
    return np.array(found)


def demonstrate(out: Path, count: int) -> Path:
    """Records of the planner's motions to the goals, and the dataset of them."""
    expert = simulated()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    begins, ends = (
        beginnings(expert, count, seed=3),
        [expert.joints(goal) for goal in drawn(count, seed=1)],
    )
    named = {f"begin_{k}": q for k, q in enumerate(begins)} | {
        f"end_{k}": q for k, q in enumerate(ends)
    }
    cell = write_cell(out, named | {START: expert.start})
    records = []
    for first in range(0, count, PART):
        part = range(first, min(first + PART, count))
        steps = [
            f"MoveTo: {{pose: {end}_{k}, budget: 50 ms}}" for k in part for end in ("begin", "end")
        ]
        done = execute(
            RunOrder(
                write_tree(out / "demonstration.yaml", steps), cell, seed=first, record=out / "runs"
            )
        )
        if done.record is None or done.result.outcome != "success":
            because = done.result.reason
            raise SystemExit(
                f"demonstrations {part}: {because.message if because else done.result.outcome}"
            )
        records.append(done.record)
        print(
            f"demonstrations {first} … {part[-1]}: {done.result.time:.0f} s of the cell's clock",
            flush=True,
        )
    export_lerobot(records, out / "dataset", RATE, "reach the goals")
    return out / "dataset"


def write_cell(out: Path, poses: Mapping[str, Float64]) -> Path:
    """The simulated cell with other poses."""
    lines = "".join(
        f"    {name}: {' '.join(f'{x:.6f}' for x in q)} rad\n" for name, q in poses.items()
    )
    cell, sim = out / "cell.yaml", CELLS / "sim.yaml"
    cell.write_text(
        f"include: {sim}\nname: reach\nworkspace:\n  include: {sim}#workspace\n  poses:\n{lines}"
    )
    return cell


def write_tree(path: Path, steps: list[str]) -> Path:
    """A tree that takes steps one after the other, with rests between."""
    lines = "".join(f"    - {step}\n    - wait: 300 ms\n" for step in steps)
    path.write_text(
        f"pomona: 1\ntree: {path.stem}\nroot:\n  sequence:\n    - wait: 300 ms\n{lines}"
    )
    return path


# ------------------------------------------------------------------------------------------------ training


def episodes(dataset: Path) -> tuple[tuple[str, ...], list[tuple[Float64, Float64]]]:
    """The names of the joints, and of each episode states and actions, shape (n, dof) [rad]."""
    from pyarrow import parquet

    info = json.loads((dataset / "meta" / "info.json").read_text("utf-8"))
    if info["fps"] != RATE:
        raise SystemExit(f"{dataset} has {info['fps']} steps a second, not {RATE}")
    names = info["features"][STATE]["names"]
    joints = [k for k, name in enumerate(names) if "joint" in name]
    found = []
    for file in sorted((dataset / "data").glob("*/*.parquet")):
        table = parquet.read_table(file, columns=[STATE, ACTION])
        state, action = (np.array(table[key].to_pylist())[:, joints] for key in (STATE, ACTION))
        found.append((state, action))
    return tuple(names[k] for k in joints), found


def reaches(state: Float64, action: Float64) -> list[Float64]:
    """The joints of every second motion, with the rest behind it: the others go to where a demonstration begins."""
    moving = np.flatnonzero(np.abs(action - state).max(axis=1) > RESTS)
    begins = moving[np.append(True, np.diff(moving) > REST)]
    if len(begins) % 2:
        raise SystemExit(f"an episode has {len(begins)} motions: demonstrations are pairs of them")
    return [state[begin:end] for begin, end in zip(begins, [*begins[1:], len(state)], strict=True)][
        1::2
    ]


def samples(robot: RobotModel, reach: Float64) -> tuple[Float64, Float64]:
    """Return inputs and outputs at each step of a reach: (n, dof + 3) [rad, m] and (n, dof) [rad].

    The goal is where the tool's point came to rest; how far each joint goes is how far it went in the next steps.
    """
    goal = robot.tcp(reach[-1])[:3, 3]
    later = np.minimum(np.arange(len(reach)) + AHEAD, len(reach) - 1)
    return np.hstack([reach, np.tile(goal, (len(reach), 1))]), reach[later] - reach


def train(dataset: Path, weights: Path, rounds: int = ROUNDS) -> PolicyNetwork:
    """Clone the arm's motions."""
    import torch

    robot = RobotModel.load(ROBOT)
    joints, shown = episodes(dataset)
    parts = [samples(robot, reach) for state, action in shown for reach in reaches(state, action)]
    x, y = (np.concatenate(column) for column in zip(*parts, strict=True))
    scales = x.mean(0), x.std(0) + 1e-4, y.mean(0), y.std(0) + 1e-4
    torch.manual_seed(SEED)
    layers = [
        torch.nn.Linear(a, b) for a, b in ((x.shape[1], WIDTH), (WIDTH, WIDTH), (WIDTH, y.shape[1]))
    ]
    net = torch.nn.Sequential(layers[0], torch.nn.Tanh(), layers[1], torch.nn.Tanh(), layers[2])
    X = torch.tensor((x - scales[0]) / scales[1], dtype=torch.float32)
    Y = torch.tensor((y - scales[2]) / scales[3], dtype=torch.float32)
    optimiser = torch.optim.Adam(net.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, LEARNING, total_steps=rounds)
    for _ in range(rounds):
        batch = torch.randint(len(X), (BATCH,))
        loss = torch.nn.functional.mse_loss(net(X[batch]), Y[batch])
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
    learned = tuple(
        (of.weight.detach().numpy().T.astype(float), of.bias.detach().numpy().astype(float))
        for of in layers
    )
    write_policy(weights, PolicyNetwork(joints, RATE / 2.0, *scales, learned))
    size = weights.stat().st_size / 1e3
    print(
        f"trained on {len(x)} steps of {len(parts)} reaches, loss {loss.item():.5f}, {size:.0f} kB: {weights}"
    )
    return read_policy(weights)


def tried(network: PolicyNetwork, robot: RobotModel, start: Float64, goals: Float64) -> Float64:
    """How far from each goal (n, 3) [m] the tool's point comes to rest without physics, shape (n,) [m].

    The arm goes a third of the way to each set-point until the next decision.
    """
    away = []
    for goal in goals:
        q = start
        for _ in range(DECISIONS):
            q = q + (network.set_point(q, goal) - q) / 3.0
        away.append(np.linalg.norm(robot.tcp(q)[:3, 3] - goal))
    return np.array(away)


# ------------------------------------------------------------------------------------------------- judging


def judge(weights: Path, count: int, out: Path) -> None:
    """Success on goals that were never shown, each from the start."""
    expert = simulated()
    goals = drawn(count, seed=2)
    said("without physics", tried(read_policy(weights), expert.robot, expert.start, goals))
    out.mkdir(parents=True, exist_ok=True)
    away: list[float] = []
    while len(away) < count:
        part, first = goals[len(away) : len(away) + PART], len(away)
        steps = []
        for goal in part:
            x, y, z = (f"{1e3 * value:.3f} mm" for value in goal)
            aim = f"Policy: {{weights: {weights.resolve()}, x: {x}, y: {y}, z: {z}}}"
            steps += [f"MoveTo: {{pose: {START}, budget: 50 ms}}", aim]
        rests = _Rests()
        order = RunOrder(
            write_tree(out / "judged.yaml", steps), CELLS / "sim.yaml", seed=1000 + first
        )
        done = execute(order, [rests.on_event], readers=[rests.read])
        away += [
            float(np.linalg.norm(expert.robot.tcp(q)[:3, 3] - goal))
            for q, goal in zip(rests.ends, part, strict=False)
        ]
        because = done.result.reason
        if (
            done.result.outcome == "failure" and because is not None
        ):  # the goal on which it failed counts as missed
            print(f"goal {len(away)}: {because.message}")
            away.append(math.inf)
        elif done.result.outcome != "success" or len(rests.ends) != len(part):
            raise SystemExit(f"{len(rests.ends)} of {len(part)} goals: {done.result.outcome}")
        print(f"{len(away)} goals, {done.result.time:.0f} s of the cell's clock", flush=True)
    said("in the simulated cell", np.array(away))


def said(where: str, away: Float64) -> None:
    """Print how many goals were reached."""
    arrived, count = int((away <= NEAR).sum()), len(away)
    low, high = wilson(arrived, count)
    median, most, worst = (
        1e3 * np.quantile(away, share, method="lower") for share in (0.5, 0.9, 1.0)
    )
    print(
        f"{where}: within {1e3 * NEAR:.0f} mm of {arrived} of {count} goals never shown ({low:.1%} … {high:.1%}); "
        f"away: median {median:.1f} mm, 90 % {most:.1f} mm, worst {worst:.1f} mm"
    )


class _Rests:
    """Where the arm stands after each policy and the rest behind it."""

    def __init__(self) -> None:
        self.ends: list[Float64] = []
        self._q = np.zeros(0)
        self._due = False

    def on_event(self, event: Event) -> None:
        """Note the joints when the wait behind a policy is over."""
        if isinstance(event, NodeChanged) and event.status == "SUCCESS":
            node = event.path.rpartition("/")[2].partition("#")[0].lower()
            if node == "wait" and self._due:
                self.ends.append(self._q)
            self._due = node == "policy" or (self._due and node != "wait")

    def read(self, _t: float, _tick: int, readings: Mapping[str, Mapping[str, Any]]) -> None:
        """Take the newest joints."""
        arm = readings.get("arm", {})
        newest = [
            np.atleast_1d(values)[-1] for name, values in arm.items() if name.startswith("q_")
        ]
        self._q = np.array(newest) if newest else self._q


def main() -> None:
    """Do the parts that were asked for, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "parts", nargs="*", choices=["demonstrate", "train", "judge", []], default=[]
    )
    parser.add_argument("--demonstrations", type=int, default=150)
    parser.add_argument("--goals", type=int, default=60)
    parser.add_argument("--out", type=Path, default=Path("runs/reach"))
    given = parser.parse_args()
    need("pyarrow.parquet", EXTRA, "a dataset of LeRobot")  # before anything moves
    weights = given.out / "reach.npz"
    for part in given.parts or ["demonstrate", "train", "judge"]:
        began = time.perf_counter()
        if part == "demonstrate":
            demonstrate(given.out, given.demonstrations)
        elif part == "train":
            train(given.out / "dataset", weights)
        else:
            judge(weights, given.goals, given.out)
        print(f"  {part}: {time.perf_counter() - began:.0f} s", flush=True)


if __name__ == "__main__":
    try:
        main()
    except PomonaError as error:
        raise SystemExit(str(error)) from error
