"""Carries of a healthy hand in the grasp's MuJoCo world: a gripper that accelerates is a gripper in another gravity.

python -m tests.skills.grip.carries [--count 400] [--seed 1]    # of each kind of carry, and what was found
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from benchmarks.grasp_mujoco import TORSION, MujocoGrasp, cone_contact, least_grasp_force_of_cone
from benchmarks.grasp_patch import GRAVITY, Fruit
from benchmarks.grasp_trial import Lifting, run_trial
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.grip import GripPhase
from pomona.skills.grip.settings import ForceLoopSettings, GripSettings

NOISE = 0.1  # of a force finger [N]
CARRIED = 2.0  # planned acceleration of a carry at full speed [m/s²]
JERK = 100.0  # with which an arm begins to brake [m/s³]
STARTS, LASTS = 0.4, 2.3  # after the lift [s]
FULL = 1.0  # speed of a carry [m/s]
PERIOD, READ = 0.002, 0.02  # of samples, and of reading the arm's joints [s]
BRAKE = 8.0  # hardest brake of a stop [m/s²]


@dataclass(frozen=True, slots=True)
class Carry:
    """One carry: the fruit, the share of the speed, the brake of a stop [m/s²], direction of the way, and a tilt [rad]."""

    fruit: Fruit
    speed: float
    brake: float
    direction: Float64
    tilt: float
    seed: int

    def acceleration(self, t: float) -> float:
        """Acceleration along the way, so long after the carry began [m/s²]; it is stopped in its middle."""
        quickest = FULL * self.speed
        rises = quickest / CARRIED + 0.1
        if t < rises:
            return CARRIED * min(t / 0.1, (rises - t) / 0.1, 1.0)
        stops = t - rises - 0.5
        ramp = min(self.brake / JERK, math.sqrt(quickest / JERK))
        lasts = quickest / (ramp * JERK) + ramp
        if not 0.0 < stops < lasts:
            return 0.0
        return -JERK * min(stops, lasts - stops, ramp)


def drawn(count: int, seed: int, most_brake: float) -> list[Carry]:
    """Draw carries at 10 % to 100 % of the speed: a quarter across the pads, of heavy fruit, at 10 %, and tilted."""
    rng = np.random.default_rng(seed)
    carries: list[Carry] = []
    while len(carries) < count:
        kind = len(carries) % 4
        fruit = Fruit(
            mass=rng.uniform(0.3, 0.4) if kind == 1 else rng.uniform(0.05, 0.3),
            width=rng.uniform(0.05, 0.09),
            mu=rng.uniform(0.5, 0.9),
            offset=(rng.uniform(-0.005, 0.005), rng.uniform(-0.01, 0.01)),
            off_centre=rng.uniform(-0.003, 0.003),
        )
        if 1.4 * least_grasp_force_of_cone(fruit) > 40.0:
            continue
        way = rng.normal(size=3) * ((0.0, 1.0, 0.0) if kind == 0 else 1.0)
        speed = 0.1 if kind == 2 else float(rng.choice((0.25, 0.5, 0.75, 1.0)))
        tilt = float(rng.uniform(-0.35, 0.35)) if kind == 3 else 0.0
        brake = float(rng.uniform(CARRIED, most_brake))
        carries.append(Carry(fruit, speed, brake, way / np.linalg.norm(way), tilt, len(carries)))
    return carries


def settings_of(carry: Carry) -> GripSettings:
    """Return the settings of a grip whose friction is known, with the uncertainty that a kind of fruit has."""
    return GripSettings(
        contact=cone_contact(carry.fruit.mu, TORSION),
        mu_uncertainty=0.15,
        offset=0.01,
        initial_force=4.0,
        loop=ForceLoopSettings(max_force=40.0),
    )


class Found(NamedTuple):
    """How a carry ends: its problem, empty without one; when it came [s]; how far the fruit truly slid at most [m]."""

    words: str
    at: float
    slip: float


def carried(
    carry: Carry,
    spoil: Callable[[Float64], Float64] | None = None,
    at: float = math.inf,
    told: bool = True,
) -> Found:
    """Carry a fruit.

    Args:
        told: the grip knows the acceleration of the hand, as its joints show it.
        spoil: changes what the fingers report, from a time after the carry began [s] on.
    """
    lifting = Lifting(height=0.05, hold=LASTS)
    began: list[float] = []
    found: list[tuple[str, float]] = []

    def since(t: float) -> float:
        return t - began[0] - lifting.duration - STARTS if began else -1.0

    def watch(t: float, controller: GripController, grasp: Any) -> None:
        if not began and controller.phase is GripPhase.HOLDING:
            began.append(t)
        now = since(t)
        if now > 0.0:
            lean = carry.tilt * min(now / 0.4, 1.0)
            gravity = -GRAVITY * np.array([0.0, math.sin(lean), math.cos(lean)])
            grasp.model.opt.gravity[:] = gravity - carry.acceleration(now) * carry.direction
            if told and round(t / PERIOD) % round(READ / PERIOD) == 0:
                controller.acceleration = abs(carry.acceleration(now - 0.5 * READ)) / GRAVITY
        problem = controller.problem
        if problem is not None and not found:
            found.append((f"{problem.code}: {problem.message}", now))

    def corrupt(n: int, t: float, wrenches: Float64) -> list[tuple[int, float, Float64]]:
        return [(n, t, spoil(wrenches) if spoil and since(t) >= at else wrenches)]

    trial = run_trial(
        carry.fruit, settings_of(carry), lifting, NOISE, carry.seed, corrupt, MujocoGrasp, watch
    )
    return Found(*(found[0] if found else ("", math.nan)), trial.slip)


def main() -> None:
    """Carry, and count what was found."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--brake", type=float, default=BRAKE)
    parser.add_argument(
        "--untold", action="store_true", help="without the acceleration of the hand"
    )
    options = parser.parse_args()
    counted: Counter[str] = Counter()
    for carry in drawn(options.count, options.seed, options.brake):
        words, at, slip = carried(carry, told=not options.untold)
        counted[words.partition(":")[0] or "nothing"] += 1
        if words:
            a = carry.acceleration(at)
            print(f"{carry.seed}: {carry.speed:.2f}, brake {carry.brake:.1f}, a {a:+.1f} · {carry.direction.round(2)}, "
                  f"{carry.fruit.mass:.2f} kg, {math.degrees(carry.tilt):.0f}°, {at:.2f} s, "
                  f"slid {1e3 * slip:.1f} mm: {words}")  # fmt: skip
    print(dict(counted))


if __name__ == "__main__":
    main()
