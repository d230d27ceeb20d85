"""Fruit picked from a running belt in the simulated cell: picked of accepted, at several speeds, with 95 % intervals.

A fruit is accepted when the arm sets off for it, and reachable if it was not too far on when the arm was free again:
`LEAD` of its travel before the end of the arm's reach. It is picked when the belt's own score has it lifted, and the
grip holds it with the hand at rest. Afterwards it is taken away and the arm goes back to its watch pose, so that each
fruit meets the same start. Detection, tracking and encoder are those of a run; nothing reads the truth but the score.

    make bench-moving SPEEDS="0.15 0.3" COUNT=200
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pomona.applications.conveyor.await_fruit import AwaitFruit, ComingFruit
from pomona.applications.conveyor.conveyor import Conveyor
from pomona.applications.conveyor.intercept import Intercept
from pomona.applications.conveyor.track import Track
from pomona.applications.conveyor.world import ConveyorWorld
from pomona.drivers import (
    Arm,
    Camera,
    Cameras,
    Carrier,
    Cell,
    DriverError,
    ForceSensor,
    Gripper,
    Pads,
    StreamedArm,
    Workspace,
    load_cell,
)
from pomona.executive import Skill, SkillEnd, drive, find_cell
from pomona.skills.grip import take_over
from pomona.tools.library.campaign.statistics import wilson

TICK = 0.02  # [s]
FRUIT_A_CELL = 8  # fruit after which a new cell is drawn: other masses, skins, shapes and friction
BEFORE = frozenset({"OUT_OF_REACH", "TOO_UNSURE", "TOO_WIDE", "NEIGHBOUR_AT_RISK", "PATH_BLOCKED"})
"""Codes with which nothing has moved."""
PASSED = "passed meanwhile"
"""Outcome of a fruit that was too far on when the arm was free again."""
LEAD, END = 2.85, 0.40
"""Time of a pick from setting off to the closed grip with what is kept for it [s], and where the reach ends [m]."""


@dataclass
class BeltOutcomes:
    """Outcomes of all fruit at one speed."""

    outcomes: Counter[str] = field(default_factory=Counter)
    slip: list[float] = field(default_factory=list)  # [mm]
    time: list[float] = field(
        default_factory=list
    )  # from setting off to a fruit that is held at rest [s]
    peak: list[float] = field(default_factory=list)  # of one pad [N]
    collisions: int = 0

    @property
    def accepted(self) -> int:
        """Fruit for which the arm set off."""
        return sum(count for code, count in self.outcomes.items() if code not in {*BEFORE, PASSED})

    @property
    def reachable(self) -> int:
        """Fruit for which the arm was free in time."""
        return self.outcomes.total() - self.outcomes[PASSED]

    def line(self, speed: float) -> str:
        """One line of the table."""
        picked, accepted = self.outcomes["picked"], self.accepted
        low, high = wilson(picked, accepted) if accepted else (0.0, 1.0)
        slip = (
            f"{np.median(self.slip):.2f} / {np.percentile(self.slip, 95):.2f}" if self.slip else "-"
        )
        force = f"{np.median(self.peak):.1f}" if self.peak else "-"
        took = f"{np.median(self.time):.1f}" if self.time else "-"
        others = ", ".join(
            f"{count} {code}" for code, count in self.outcomes.most_common() if code != "picked"
        )
        return (
            f"{speed:4.2f} m/s  picked {picked} of {accepted} accepted ({100 * low:.0f} to {100 * high:.0f} %) "
            f"of {self.reachable} reachable  "
            f"slip {slip} mm  pad {force} N  set off to held {took} s  hit {self.collisions}  {others}"
        )


class Bench:
    """One cell with a running belt."""

    def __init__(
        self, cell: str, speed: float, seed: int, settings: Mapping[str, str], watch: str = "watch"
    ) -> None:
        self.cell: Cell = load_cell(
            find_cell(cell), seed=seed, overrides={"belt": f"{speed} m/s", **settings}
        )
        wanted = (
            Arm,
            StreamedArm,
            Gripper,
            ForceSensor,
            Camera,
            Cameras,
            Workspace,
            Conveyor,
            Carrier,
            Pads,
        )
        self.devices: dict[type, object] = {
            interface: self.cell.device(interface) for interface in wanted
        }
        world = self.cell.devices["world"]
        assert isinstance(world, ConveyorWorld)
        self.world = world
        self.watch: np.ndarray = self.cell.device(Workspace).poses[watch]
        self.set_off: float | None = None  # when the hand set off for its fruit [s]
        self.kind = world.built.fruits[0].model.name
        if watch != "watch":
            self._put_away([])
        began = self.drive(Track(), fruit=self.kind)
        if began.reason is not None:
            raise SystemExit(f"{speed:4.2f} m/s: {began.reason.message}")
        self.tracks = began.outputs["tracks"]

    def drive(self, skill: Skill, **inputs: object) -> SkillEnd:
        """Drive a skill on the cell; it is looked after in each tick."""

        def tick(_: int) -> None:
            self.cell.check()
            if not skill.feedback_message.startswith("reaching"):
                return
            self.set_off = self.cell.clock.now() if self.set_off is None else self.set_off

        self.set_off = None
        return drive(
            skill, inputs, self.devices, clock=self.cell.clock, period=TICK, each_tick=tick
        )

    def one(self, tried: BeltOutcomes) -> str:
        """Try the next fruit, and make room for another one; returns the outcome."""
        waited = self.drive(AwaitFruit(), tracks=self.tracks)
        if waited.reason is not None:
            return waited.reason.code
        target = waited.outputs["target"]
        assert isinstance(target, ComingFruit)
        end = self.drive(Intercept(), target=target, tracks=self.tracks)
        lifted = [fate for fate in self.world.score.fates if fate.lifted and not fate.ending]
        if end.reason is not None:
            print(
                f"    {target.sentence}, chosen at {target.place[0]:+.2f} m: {end.reason.message}",
                flush=True,
            )
        outcome = (
            end.reason.code if end.reason is not None else "picked" if lifted else "NOT_LIFTED"
        )
        at_first = target.place[0] - target.speed * waited.duration
        outcome = PASSED if outcome in BEFORE and at_first > END - LEAD * target.speed else outcome
        if outcome == "picked" and self.set_off is not None:
            tried.slip.append(1e3 * lifted[-1].slip)
            tried.peak.append(lifted[-1].peak)
            tried.time.append(self.cell.clock.now() - self.set_off)
        self._put_away([fate.number for fate in lifted])
        return outcome

    def _put_away(self, numbers: list[int]) -> None:
        take_over(self.cell.device(Gripper))
        for number in numbers:
            self.world.score.end(number, "picked")
            self.world.park(number)
            self.world.give_back(number)
        self.cell.device(Gripper).move(0.1, 0.2)
        self._run(0.6)
        motion = self.cell.device(StreamedArm).stream(0.3)
        while np.abs(self.cell.device(Arm).state().q - self.watch).max() > 1e-3:
            motion.aim(self.watch)
            self._run(TICK)
        motion.stop()
        while not motion.settled:
            self._run(TICK)

    def _run(self, duration: float) -> None:
        for _ in range(round(duration / TICK)):
            self.cell.clock.advance(TICK)
            self.cell.check()


def run(
    cell: str,
    speed: float,
    count: int,
    seed: int,
    settings: Mapping[str, str],
    watch: str = "watch",
) -> BeltOutcomes:
    """Try `count` reachable fruit, and those of the last cell, at a speed [m/s]."""
    tried, number = BeltOutcomes(), 0
    while tried.reachable < count:
        bench = Bench(cell, speed, seed + number, settings, watch)
        number += 1
        try:
            for _ in range(FRUIT_A_CELL):
                outcome = bench.one(tried)
                tried.outcomes[outcome] += 1
                print(f"  {speed:4.2f} m/s  seed {seed + number - 1}  {outcome}", flush=True)
                if outcome == "NOTHING_COMES":
                    break
        except DriverError as stopped:
            tried.outcomes[f"device: {stopped}"] += 1
        tried.collisions += bench.world.score.belt_hits + bench.world.score.self_hits
        bench.cell.close()
    return tried


def main() -> None:
    """Print a line for each speed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--speeds", type=float, nargs="+", default=[0.15, 0.3])
    parser.add_argument("--count", type=int, default=200, help="fruit at each speed")
    parser.add_argument("--seed", type=int, default=1000, help="of the first cell")
    parser.add_argument("--cell", default="conveyor", help="cell file with a conveyor")
    parser.add_argument(
        "--watch", default="watch", help="pose that the arm watches from: watch_2 from 0.45 m/s on"
    )
    parser.add_argument("--set", nargs="*", default=[], help="options of the cell: fruit=apple_4")
    options = parser.parse_args()
    settings = dict(each.split("=", 1) for each in options.set)
    for each in options.speeds:
        print(
            run(options.cell, each, options.count, options.seed, settings, options.watch).line(
                each
            ),
            flush=True,
        )


if __name__ == "__main__":
    main()
