"""Pushes of a fruit on a LuGre contact that shares no code with the calibration."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from benchmarks.grasp_patch import Fruit, PatchGrasp
from pomona.skills.grip.limit_surface import SoftContact
from pomona.tools.grip_calibration.calibration import Push

TRUE = SoftContact(mu=0.55, delta=0.0050, gamma=0.30)


def push(lever: float, force: float, seed: int = 0, noise: float = 0.05) -> tuple[Push, Push]:
    """Squeeze a fruit slowly up to a grasp force, then pull it down until it slides: (squeeze, push)."""
    fruit = Fruit(mass=0.05, mu=TRUE.mu, delta=TRUE.delta, gamma=TRUE.gamma, offset=(lever, 0.0))
    grasp = PatchGrasp(fruit)
    rng = np.random.default_rng(seed)
    wrenches, widths, squeezed = [], [], 0
    for i in range(6000):
        true = grasp.step()
        wrenches.append(true + rng.normal(0.0, noise, (2, 6)) * [1, 1, 1, 0.005, 0.005, 0.005])
        widths.append(grasp.width)
        if squeezed == 0:
            grasp.command = -0.024 if grasp.f_n == 0.0 else -0.004
            if grasp.f_n >= force:
                squeezed, grasp.command = i, 0.0
        else:
            grasp.climb = 0.02 if i < squeezed + 500 and grasp.height < 0.01 else 0.0
            if grasp.climb == 0.0:
                grasp.pull = (0.0, grasp.pull[1] - 0.004)
            if abs(grasp.place[1]) > 0.003 or abs(grasp.turn) > 0.3:
                break
    both, width = np.array(wrenches), np.array(widths)
    return Push(both[:squeezed], width[:squeezed]), Push(both[squeezed:], width[squeezed:])


@lru_cache(maxsize=1)
def all_pushes() -> tuple[tuple[Push, ...], Push]:
    tasks = [
        (0.0, 2.0),
        (0.0, 5.0),
        (0.008, 2.0),
        (0.008, 4.0),
        (0.008, 8.0),
        (0.015, 3.0),
        (0.015, 7.0),
    ]
    made = [push(lever, force, seed) for seed, (lever, force) in enumerate(tasks)]
    return tuple(p for _, p in made), made[4][0]


def middle(span: str) -> float:
    """Return the middle of a range as a file has it: `0.7..0.9`."""
    low, high = span.split("..")
    return 0.5 * (float(low) + float(high))
