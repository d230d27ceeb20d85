"""Insert and Hook alone, in the physics of the simulated crate, on fruit at true places with a measurement's errors.

    python -m benchmarks.bench_manoeuvres                                    # 20 scenes of each kind
    python -m benchmarks.bench_manoeuvres --kinds between --seeds 501..510 --out runs/manoeuvres.jsonl

`between`: the first of four fruits lies at a wall, with a neighbour pressed on either side; Insert, then grip and lift.
`middle`: the same in the middle of the crate. `corner`: one fruit in a corner; Hook, then its room by geometry.
No camera looks: places err by 1.5 mm (1 σ per axis) and sizes by 2 %. Rows are appended.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pomona.applications.crates.freedom import freedom, obstacles_of
from pomona.applications.crates.hook import Hook
from pomona.applications.crates.insert import Insert
from pomona.applications.crates.sample_hook import SampleHook
from pomona.applications.crates.sample_insert import SampleInsert
from pomona.drivers.interfaces import (
    Arm,
    ForceSensor,
    Frame,
    Gripper,
    Intrinsics,
    LoadSensor,
    Workspace,
)
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.executive.cell.errors import DeviceError
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.executive.values.arrays import Float64
from pomona.skills.follow import Follow
from pomona.skills.lift import Lift
from pomona.skills.motion.grasps.gripper_shape import gripper_shape
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.plan import Plan
from pomona.skills.slip_avoid_grasp import SlipAvoidGrasp
from pomona.tools.campaign.statistics import wilson
from pomona.tools.simulation.layout import crate_of
from pomona.tools.simulation.world import SimWorld

ROOT = Path(__file__).parents[1]
KINDS = {"between": 4, "middle": 3, "corner": 1}
"""Number of fruits of each kind of scene."""
PLACE, SIZE = 1.5e-3, 0.02
"""Standard deviations of a place along each axis [m], and of a size."""
TUNED_FROM = 301
PULL, PRESSED = 0.5, 1.0
"""Pull that brings fruit together, of its weight, and its duration [s]."""


class ManoeuvreTrial:
    """One scene: a cell whose fruit was put where the kind wants it."""

    def __init__(self, kind: str, seed: int) -> None:
        others = str(KINDS[kind] - 1)
        self.cell: Cell = load_cell(
            ROOT / "trees" / "cells" / "sim_crate.yaml", seed=seed, overrides={"others": others}
        )
        self.world = next(each for each in self.cell.devices.values() if isinstance(each, SimWorld))
        self.devices: dict[type, Any] = {
            kind: self.cell.device(kind)
            for kind in (Arm, Gripper, ForceSensor, LoadSensor, Workspace)
        }
        self.robot = RobotModel.load(self.devices[Arm].description)
        self._rng = np.random.default_rng([seed, 11])
        self._put(kind)

    def _put(self, kind: str) -> None:
        """Put the fruit to its places in the crate, and press it together for a moment."""
        world, fruits = self.world, self.world.scene.fruits
        made = crate_of(world.scene.fixed)
        assert made is not None
        assert made.inside is not None
        radii = [float(each.dimensions[0]) / 2.0 for each in fruits]
        side = self._rng.choice([-1.0, 1.0])
        wall = side * (made.inside[1] - radii[0])
        spots = {
            "corner": [(self._rng.choice([-1.0, 1.0]) * (made.inside[0] - radii[0]), wall)]
        }.get(kind, [(self._rng.uniform(-0.04, 0.04), wall if kind == "between" else 0.0)])
        pulls = [
            np.sign([spots[0][0], side])
            if kind == "corner"
            else np.array([0.0, side * (kind == "between")])
        ]
        beside = ([1.0, 0.0], [-1.0, 0.0], [0.6, -0.8 * side])
        for k, way in zip(range(1, len(fruits)), map(np.array, beside), strict=False):
            spots.append(tuple(np.add(spots[0], np.multiply(way, radii[0] + radii[k] + 1e-3))))
            pulls.append(-way)
        bodies = [world.model.body(f"fruit_{i}").id for i in range(len(fruits))]
        for body, spot, fruit in zip(bodies, spots, fruits, strict=True):
            address = world.model.jnt_qposadr[world.model.body_jntadr[body]]
            z = fruit.dimensions[1] / 2.0 + 0.003
            world.state.qpos[address : address + 3] = (
                made.T_base_floor[:3, :3] @ [*spot, z] + made.T_base_floor[:3, 3]
            )
        gravity = float(np.linalg.norm(world.model.opt.gravity))
        for body, pull in zip(bodies, pulls, strict=True):
            way = made.T_base_floor[:3, :2] @ pull
            world.state.xfrc_applied[body, :3] = PULL * gravity * world.model.body_mass[body] * way
        self.cell.clock.advance(PRESSED)
        world.state.xfrc_applied[:] = 0.0
        self.cell.clock.advance(0.5)

    def measured(self, exact: bool = False) -> MeasuredFruit:
        """The first fruit as a look would measure it, with the others beside it."""
        found = []
        for each in self.world.truth()["fruits"]:  # type: ignore[attr-defined]
            T, dimensions = np.array(each["T_base_fruit"]), np.array(each["dimensions_m"])
            if not exact:
                T[:3, 3] += self._rng.normal(0.0, PLACE, 3)
                dimensions = dimensions * (1.0 + self._rng.normal(0.0, SIZE))
            found.append(_as_measured(T, dimensions, self.cell.clock.now()))
        return replace(found[0], beside=tuple(found[1:]))

    def room(self) -> float:
        """Room for the fingers of the freest grasp of the first fruit, by the truth [m]."""
        fruit = self.measured(exact=True)
        around = obstacles_of(fruit, self.devices[Workspace])
        return freedom(fruit, around, gripper_shape(self.robot), self.robot.width_max, 2e-3)[0]

    def do(self, skill: Any, **inputs: object) -> SkillEnd:
        """Let a skill run to its end."""
        return drive(skill, inputs, self.devices, clock=self.cell.clock, limit=120.0)

    def approach(self, sample: Any) -> tuple[SkillEnd, Any]:
        """Sample, plan and follow to a place over the fruit; the last end, and the place or None."""
        sampled = self.do(sample, around=self.measured())
        if sampled.reason is not None:
            return sampled, None
        planned = self.do(Plan(), to=sampled.outputs["candidates"], clearance=4e-3, budget=2.0)
        if planned.reason is not None:
            return planned, None
        place, path = planned.outputs["grasp"], planned.outputs["path"]
        followed = self.do(Follow(), path=path, grasp=place)
        return followed, place if followed.reason is None else None


def _as_measured(T_base_fruit: Float64, dimensions: Float64, now: float) -> MeasuredFruit:
    frame = Frame(
        now,
        0,
        np.zeros((2, 2, 3), np.uint8),
        None,
        Intrinsics(1.0, 1.0, 0.5, 0.5, 2, 2),
        None,
        np.eye(4),
    )
    return MeasuredFruit(
        fruit=load_fruit("apple"), T_base_fruit=T_base_fruit, T_base_camera=np.eye(4), dimensions=dimensions, mu=1.0,
        sigma=0.0, covariance=np.eye(6) * 1e-6, inlier_ratio=1.0, residual=0.0, contour=np.empty((0, 2)), frame=frame,
        method="truth",
    )  # fmt: skip


def run(kind: str, seed: int) -> dict[str, Any]:
    """Run one scene and return its row."""
    trial = ManoeuvreTrial(kind, seed)
    try:
        before, began = trial.room(), trial.cell.clock.now()
        ended, place = trial.approach(SampleHook() if kind == "corner" else SampleInsert())
        start, figures = trial.cell.clock.now(), {}
        if place is not None and kind == "corner":
            ended = trial.do(Hook(), hook=place)
            trial.cell.clock.advance(0.5)
            figures = {"room_after_m": trial.room(), **ended.outputs}
        elif place is not None:
            ended = trial.do(Insert(), insert=place)
            figures = {"push_m": -place.clearance}
            if ended.reason is None:
                grasp = ended.outputs["grasp"]
                figures |= {"felt_n": ended.outputs["felt"], "shifted_m": ended.outputs["shifted"]}
                ended = trial.do(SlipAvoidGrasp(), fruit=grasp.fruit)
                if ended.reason is None:
                    hold = ended.outputs["hold"]
                    ended = trial.do(Lift(), hold=hold, grasp=grasp, clearance=4e-3)
            else:
                figures |= dict(ended.reason.data)
        truth = trial.world.truth()
        done = (
            figures.get("room_after_m", 0.0) > 0.0016 if kind == "corner" else bool(truth["lifted"])
        )
        return {
            "kind": kind, "seed": seed, "done": done and ended.reason is None, "room_before_m": before,
            "reason": "" if ended.reason is None else f"{ended.reason.code}: {ended.reason.message}",
            "time_s": trial.cell.clock.now() - start, "plan_s": start - began, "drops": truth["drops"],
            "bruised": truth["bruised"], "largest_press": truth["largest_press"], **figures,
        }  # fmt: skip
    except DeviceError as fault:
        return {
            "kind": kind, "seed": seed, "done": False, "room_before_m": before, "reason": f"DEVICE: {fault}",
            "time_s": trial.cell.clock.now() - start, "plan_s": start - began, "drops": 0,
            "bruised": trial.world.truth()["bruised"], "largest_press": trial.world.truth()["largest_press"], **figures,
        }  # fmt: skip
    finally:
        trial.cell.close()


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the figures of each kind as text."""
    lines = [
        "kind      done of  share, 95 % interval  free before  bruised  largest press  s (median)"
    ]
    for kind in KINDS:
        own = [row for row in rows if row["kind"] == kind]
        if not own:
            continue
        part = sum(row["done"] for row in own)
        low, high = wilson(part, len(own))
        free, bruised = (
            sum(row["room_before_m"] > 0.0016 for row in own),
            sum(row["bruised"] for row in own),
        )
        press, pace = (
            max(row["largest_press"] for row in own),
            np.median([row["time_s"] for row in own]),
        )
        lines.append(
            f"{kind:8} {part:5} {len(own):2}  {part / len(own):4.0%} {low:5.0%} to {high:4.0%}  {free:11} {bruised:8} "
            f"{press:14.2f} {pace:11.1f}"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the scenes and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"of {', '.join(KINDS)}")
    parser.add_argument(
        "--seeds",
        default="1..20",
        help="first and last seed; seeds from 301 to 320 were used for tuning",
    )
    parser.add_argument("--out", type=Path, default=Path("runs/bench_manoeuvres.jsonl"))
    said = parser.parse_args()
    first, last = (int(number) for number in said.seeds.split(".."))
    said.out.parent.mkdir(parents=True, exist_ok=True)
    rows = (
        [json.loads(line) for line in said.out.read_text("utf-8").splitlines()]
        if said.out.is_file()
        else []
    )
    known = {(row["kind"], row["seed"]) for row in rows}
    for seed in range(first, last + 1):
        for kind in said.kinds.split(","):
            if (kind, seed) in known:
                continue
            rows.append(run(kind, seed))
            with said.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
            sys.stdout.write(json.dumps(rows[-1]) + "\n")
            sys.stdout.flush()
    sys.stdout.write(table(rows) + "\n")


if __name__ == "__main__":
    main()
