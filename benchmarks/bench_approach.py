"""Largest forces of picks whose fruit does not lie where it was measured; no camera looks.

    python -m benchmarks.bench_approach OUT.jsonl --cell sim --kinds shifted,turned
    python -m benchmarks.bench_approach OUT.jsonl --cell sim_crate --kinds crate

`shifted`: the camera was 5 to 26 mm aside, in four directions. `turned`: by 3° about each of its axes, both ways.
`crate`: crate and fruit were moved by 10, 20 and 40 mm after the look, in four directions. Each case is one try:
SampleGrasp, Plan, Follow, Approach, and Retreat or the grip. Rows are appended to OUT, known ones are left out.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.caliper_cells import Forces
from benchmarks.fault_world import Person
from pomona.drivers.interfaces import (
    Arm,
    ForceSensor,
    Frame,
    Gripper,
    Intrinsics,
    LoadSensor,
    Pads,
    Workspace,
)
from pomona.executive.cell.connect import load_cell
from pomona.executive.cell.errors import DeviceError
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.executive.values.arrays import Float64
from pomona.skills.approach import Approach
from pomona.skills.follow import Follow
from pomona.skills.lift import Lift
from pomona.skills.motion.robot import RobotModel
from pomona.skills.open_fingers import OpenFingers
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.plan import Plan
from pomona.skills.retreat import Retreat
from pomona.skills.sample_grasp import SampleGrasp
from pomona.skills.slip_avoid_grasp import SlipAvoidGrasp

ROOT = Path(__file__).parents[1]
SIDES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
AXES = np.vstack([np.eye(3), -np.eye(3)])


class ForcesOfNodes(Forces):
    """Largest force in each skill, beside those of `Forces`, and the tool's speed when Approach first touched."""

    def __init__(self, world: Any) -> None:
        super().__init__(world)
        self.of: dict[str, float] = {}
        self.trace: list[tuple[float, float, float]] = []
        self._world = world

    def step(self) -> None:
        """Note one step."""
        keep = self.pad, self.other
        self.pad = self.other = 0.0
        during, on, self.during, self.on = self.during, self.on, "", ""
        super().step()
        now, self.pad, self.other = (
            max(self.pad, self.other),
            max(keep[0], self.pad),
            max(keep[1], self.other),
        )
        if now <= max(keep):
            self.during, self.on = during, on
        self.of[self.node] = max(self.of.get(self.node, 0.0), now)
        if self.node == "Approach":
            self.trace.append(
                (self._world.clock.now(), float(self._world.state.site("tcp").xpos[2]), now)
            )

    def speed(self) -> float:
        """Return how fast the tool sank when Approach first touched something [m/s]; 0 without a touch."""
        first = next((k for k, (_, _, force) in enumerate(self.trace) if force > 0.1), 0)
        if first < 5:
            return 0.0
        (t0, z0, _), (t1, z1, _) = self.trace[first - 5], self.trace[first]
        return (z0 - z1) / (t1 - t0)


class ApproachTry:
    """One try in one cell."""

    def __init__(self, cell: str, seed: int, settings: dict[str, str]) -> None:
        path = ROOT / "trees" / "cells" / f"{cell}.yaml"
        self.cell = load_cell(path, seed=seed, overrides=settings)
        world = self.cell.devices["world"]
        self.world: Any = getattr(world, "_world", world)
        kinds = (Arm, Gripper, ForceSensor, LoadSensor, Pads, Workspace)
        self.devices: dict[type, Any] = {
            kind: device
            for kind in kinds
            if (device := self.cell.workspace if kind is Workspace else self._device(kind))
            is not None
        }
        self.robot = RobotModel.load(self.devices[Arm].description)
        self.forces = ForcesOfNodes(self.world)
        self.world.after_step.append(self.forces.step)

    def _device(self, kind: type) -> Any:
        return next(
            (
                each
                for each in self.cell.devices.values()
                if kind in getattr(each, "interfaces", ())
            ),
            None,
        )

    def measured(self) -> MeasuredFruit:
        """The first fruit and those beside it, as they truly are."""
        found = [
            as_measured(
                np.array(each["T_base_fruit"]),
                np.array(each["dimensions_m"]),
                self.cell.clock.now(),
            )
            for each in self.fruits()
        ]
        return replace(found[0], beside=tuple(found[1:]))

    def fruits(self) -> list[dict[str, Any]]:
        truth = self.world.truth()
        return (
            list(truth["fruits"])
            if "fruits" in truth
            else [{"T_base_fruit": truth["T_base_fruit"], "dimensions_m": truth["dimensions_m"]}]
        )

    def do(self, skill: Any, **inputs: object) -> SkillEnd:
        """Let a skill run to its end."""
        self.forces.node = type(skill).__name__
        return drive(skill, inputs, self.devices, clock=self.cell.clock, limit=120.0)


def as_measured(T_base_fruit: Float64, dimensions: Float64, now: float) -> MeasuredFruit:
    """Return a fruit at its true place as if a camera had measured it."""
    nothing = np.zeros((2, 2, 3), np.uint8)
    frame = Frame(now, 0, nothing, None, Intrinsics(1.0, 1.0, 0.5, 0.5, 2, 2), None, np.eye(4))
    return MeasuredFruit(
        fruit=load_fruit("apple"),
        T_base_fruit=T_base_fruit,
        T_base_camera=np.eye(4),
        dimensions=dimensions,
        mu=1.0,
        sigma=0.0,
        covariance=np.eye(6) * 1e-6,
        inlier_ratio=1.0,
        residual=0.0,
        contour=np.empty((0, 2)),
        frame=frame,
        method="truth",
    )


def moved(fruit: MeasuredFruit, T: Float64) -> MeasuredFruit:
    """Return a fruit and its neighbours as a camera sees them that is off by a transform of the base frame, (4, 4)."""
    beside = tuple(replace(each, T_base_fruit=T @ each.T_base_fruit) for each in fruit.beside)
    return replace(fruit, T_base_fruit=T @ fruit.T_base_fruit, beside=beside)


def error_of(case: dict[str, Any], trial: ApproachTry) -> Float64:
    """Return what moves true places to measured ones, (4, 4)."""
    T = np.eye(4)
    if case["kind"] == "turned":
        q = trial.devices[Workspace].poses["observe"]
        eye = trial.robot.camera(q) if hasattr(trial.robot, "camera") else trial.robot.tcp(q)
        R = Rotation.from_rotvec(
            eye[:3, :3] @ AXES[case["way"]] * np.radians(case["size"])
        ).as_matrix()
        T[:3, :3], T[:3, 3] = R, eye[:3, 3] - R @ eye[:3, 3]
    else:
        T[:3, 3] = SIDES[case["way"]] * case["size"] * 1e-3
    return T


def run(case: dict[str, Any]) -> dict[str, Any]:
    """Run one case and return its row."""
    trial = ApproachTry(case["cell"], case["seed"], case["settings"])
    ended, reason, nodes = None, "", []
    try:
        fruit = moved(
            trial.measured(), error_of(case, trial) if case["kind"] != "crate" else np.eye(4)
        )
        sampled = trial.do(SampleGrasp(), around=fruit, radius=0.09)
        reason = "" if sampled.reason is None else sampled.reason.code
        if not reason:
            planned = trial.do(Plan(), to=sampled.outputs["candidates"], clearance=4e-3, budget=2.0)
            reason = "" if planned.reason is None else planned.reason.code
        if not reason:
            grasp, path = planned.outputs["grasp"], planned.outputs["path"]
            if case["kind"] == "crate":
                person, way = Person(trial.world), SIDES[case["way"]][:2] * case["size"] * 1e-3
                person._move_crate((float(way[0]), float(way[1])))
                for i in range(len(trial.world.scene.fruits)):
                    person._put(i, way)
            for skill, inputs in (
                (OpenFingers(), {"grasp": grasp, "path": path}),
                (Follow(), {"path": path, "grasp": grasp}),
                (Approach(), {"grasp": grasp, "clearance": 4e-3, **case["approach"]}),
            ):
                start = trial.cell.clock.now()
                ended = trial.do(skill, **inputs)
                nodes.append((type(skill).__name__, trial.cell.clock.now() - start))
                if ended.reason is not None:
                    reason = f"{ended.reason.code}: {ended.reason.message}"
                    back = trial.do(Retreat(), grasp=grasp)
                    reason += (
                        ""
                        if back.reason is None
                        else f"; {back.reason.code}: {back.reason.message}"
                    )
                    break
            else:
                held = trial.do(SlipAvoidGrasp(), fruit=fruit)
                reason = "" if held.reason is None else held.reason.code
                if held.reason is None:
                    lifted = trial.do(
                        Lift(), hold=held.outputs["hold"], grasp=grasp, clearance=4e-3
                    )
                    reason = "" if lifted.reason is None else lifted.reason.code
    except DeviceError as fault:
        reason = f"DEVICE: {fault}"
    finally:
        trial.cell.close()
    forces = trial.forces
    return {
        **case, "reason": reason, "force_n": max(forces.pad, forces.other), "of": forces.of, "during": forces.during,
        "on": forces.on if forces.other >= forces.pad else "pad", "touch_speed": forces.speed(), "times": dict(nodes),
    }  # fmt: skip


def cases(
    cell: str, kinds: list[str], each: int, seed: int, unseen: float
) -> Iterator[dict[str, Any]]:
    """Yield cases: every size and direction `each` times, with a fruit and a place drawn for each."""
    for kind in kinds:
        how = {"acceleration": 1.0 if kind == "crate" else 3.0, "unseen": unseen}
        sizes = {"shifted": (26, 20, 15, 10, 5), "turned": (3,), "crate": (40, 20, 10)}[kind]
        for size in sizes:
            for way in range(6 if kind == "turned" else 4):
                for number in range(each):
                    rng = np.random.default_rng([seed, len(kind), size, way, number])
                    settings = {"fruit": f"apple_{rng.integers(1, 6)}"}
                    settings |= (
                        {"others": "5"} if kind == "crate" else {"place": str(rng.integers(1, 6))}
                    )
                    yield {
                        "cell": cell, "kind": kind, "size": size, "way": way, "number": number,
                        "seed": int(rng.integers(1_000_000)), "settings": settings, "approach": how,
                    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """Return the largest forces of each kind and size as text."""
    lines = [
        "cell      kind     size  cases  touched on the way  median  largest force [N]  above 10 N"
    ]
    for key in sorted({(row["cell"], row["kind"], row["size"]) for row in rows}):
        own = [row for row in rows if (row["cell"], row["kind"], row["size"]) == key]
        forces = [row["force_n"] for row in own]
        touched = sum(row["reason"].startswith("CONTACT") for row in own)
        lines.append(
            f"{key[0]:9.9} {key[1]:8} {key[2]:4}  {len(own):5}  {touched:18}  {np.median(forces):6.1f}"
            f"  {max(forces):17.1f}  {sum(force > 10.0 for force in forces):10}"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the cases and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--cell", default="sim")
    parser.add_argument("--kinds", default="shifted,turned")
    parser.add_argument("--each", type=int, default=1, help="cases of each size and direction")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--unseen", type=float, default=18.0, help="input of Approach [mm]")
    said = parser.parse_args()
    rows = (
        [json.loads(line) for line in said.out.read_text("utf-8").splitlines()]
        if said.out.is_file()
        else []
    )
    known = {
        json.dumps([row[key] for key in ("cell", "kind", "size", "way", "number")]) for row in rows
    }
    for case in cases(said.cell, said.kinds.split(","), said.each, said.seed, 1e-3 * said.unseen):
        if json.dumps([case[key] for key in ("cell", "kind", "size", "way", "number")]) in known:
            continue
        rows.append(run(case))
        with said.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        row = rows[-1]
        names = ("kind", "size", "way", "settings", "during", "on", "times", "reason")
        sys.stdout.write(
            f"{row['force_n']:.1f} N {1e3 * row['touch_speed']:.0f} mm/s {[row[key] for key in names]}\n"
        )
        sys.stdout.flush()
    sys.stdout.write(table(rows) + "\n")


if __name__ == "__main__":
    main()
