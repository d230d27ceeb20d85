"""Speed of the fruit wall on one core, with arm, hand and every stream, by the number of leaves, and its costs.

python -m benchmarks.orchard_speed
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pomona.applications.harvest.world import FruitWallWorld
from pomona.drivers.interfaces import ForceSensor
from pomona.executive.cell.connect import load_cell
from pomona.tools.simulation.scene import TIMESTEP

CELL = Path(__file__).parents[1] / "trees" / "cells" / "orchard.yaml"
PARTS = (
    "mj_kinematics",
    "mj_comPos",
    "mj_makeM",
    "mj_factorM",
    "mj_collision",
    "mj_fwdVelocity",
    "mj_fwdConstraint",
)
"""Of a step, called by themselves."""


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seeds", type=int, default=1)
    options.add_argument(
        "--seconds", type=float, default=2.0, help="of the wall's time, of each measurement"
    )
    said = options.parse_args()
    print(
        f"{'leaves':>7} {'wind':>5} {'seed':>4} {'fruit':>5} {'plates':>6} {'dof':>4} {'step µs':>8} {'x real':>7}"
    )
    for seed in range(said.seeds):
        for leaves, wind in ((0.0, 0), (0.5, 0), (1.0, 0), (1.0, 1)):
            _measure(leaves, wind, seed, said.seconds)
    for name in TRIES:
        _try(name, said.seconds)


TRIES: Mapping[str, Callable[[Any, Any], None]] = {
    "as it is": lambda mujoco, option: None,
    "sleeping islands": lambda mujoco, option: _set(
        option, "enableflags", int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    ),
    "dense jacobian": lambda mujoco, option: _set(
        option, "jacobian", int(mujoco.mjtJacobian.mjJAC_DENSE)
    ),
    "implicit, not implicitfast": lambda mujoco, option: _set(
        option, "integrator", int(mujoco.mjtIntegrator.mjINT_IMPLICIT)
    ),
    "CG, not Newton": lambda mujoco, option: _set(option, "solver", int(mujoco.mjtSolver.mjSOL_CG)),
    "no contacts at all": lambda mujoco, option: _set(
        option, "disableflags", int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    ),
}
"""Other variants with the full foliage."""


def _measure(leaves: float, wind: int, seed: int, seconds: float) -> None:
    world, close = _open(leaves, wind, seed)
    step = _step(world, seconds)
    wall = world.built.wall
    print(
        f"{leaves:>7} {wind:>5} {seed:>4} {len(wall.fruits):>5} {len(wall.leaves):>6} {world.model.nv:>4} "
        f"{1e6 * step:>8.0f} {TIMESTEP / step:>7.2f}",
        flush=True,
    )
    if leaves == 1.0 and wind == 0 and seed == 0:
        for name in PARTS:
            part = partial(getattr(world.mujoco, name), world.model, world.state)
            print(f"        {name:<28} {1e6 * _mean(part, 100):>6.0f} µs")
        hooks = (*world.before_step, *world.after_step)
        print(
            f"        {'devices and score':<28} {1e6 * _mean(lambda: [hook() for hook in hooks], 100):>6.0f} µs"
        )
    close()


def _try(name: str, seconds: float) -> None:
    world, close = _open(1.0, 0, 0)
    TRIES[name](world.mujoco, world.model.opt)
    step = _step(world, seconds)
    print(
        f"        {name:<28} {1e6 * step:>6.0f} µs a step, {TIMESTEP / step:.2f} x real time",
        flush=True,
    )
    close()


def _open(leaves: float, wind: int, seed: int) -> tuple[FruitWallWorld, Callable[[], None]]:
    cell = load_cell(
        CELL, seed=seed, overrides={"leaves": str(leaves), "wind": str(wind), "behind": "0"}
    )
    world = cell.devices["world"]
    assert isinstance(world, FruitWallWorld)
    felt: list[Any] = []
    cell.device(ForceSensor).subscribe(felt.append)
    world.clock.advance(0.1)
    return world, cell.close


def _set(option: Any, name: str, flag: int) -> None:
    setattr(option, name, getattr(option, name) | flag if name.endswith("flags") else flag)


def _step(world: FruitWallWorld, seconds: float) -> float:
    return _mean(lambda: world.clock.advance(TIMESTEP), round(seconds / TIMESTEP))


def _mean(function: Callable[[], Any], times: int) -> float:
    """Return the processor time of a call [s], the median of ten means: other load does not count."""
    means = []
    for _ in range(10):
        began = time.thread_time()
        for _ in range(max(1, times // 10)):
            function()
        means.append((time.thread_time() - began) / max(1, times // 10))
    return float(np.median(means))


if __name__ == "__main__":
    main()
