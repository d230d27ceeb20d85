"""Fruit that touches: a heap on the table, or fruit in a crate, half of it at the walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.drivers.interfaces import Box
from pomona.executive.values.arrays import Float64

SOURCE = "source"  # name of the crate in the workspace from which fruit is taken
PULLED = 1.5  # duration of the pull to a wall [s]
PULL = 0.5  # horizontal pull on a fruit, of its weight: apples roll
AT_WALL = 0.7  # probability that a drawn fruit is drawn along x, and the same along y
HEAP = 0.03  # distance from the middle of a heap within which fruit begins, before it is pushed apart [m]


@dataclass(frozen=True, slots=True, eq=False)
class Gathering:
    """Where fruit is brought together."""

    T_base_floor: Float64  # middle of the surface below the fruit, (4, 4)
    inside: Float64 | None  # half of the crate's inside along x and y, (2,) [m]; None for a heap on the table


def crate_of(fixed: tuple[Box, ...]) -> Gathering | None:
    """Return the inside of the crate `SOURCE` among fixed obstacles; None without one."""
    boxes = [box for box in fixed if box.name == SOURCE]
    if len(boxes) < 2:
        return None
    floor, wall = boxes[0], min(min(box.half_extents) for box in boxes[1:])
    T_base_floor = floor.T_base_box.copy()
    T_base_floor[:3, 3] += T_base_floor[:3, 2] * floor.half_extents[2]
    return Gathering(T_base_floor, np.array(floor.half_extents[:2]) - 2.0 * wall)


def gather(mujoco: Any, model: Any, state: Any, sizes: Float64, how: Gathering, seed: int) -> None:
    """Bring the bodies fruit_0, fruit_1 … together; in a crate half of them are drawn to its walls.

    Args:
        sizes: width and height of each fruit, shape (n, 2) [m].
    """
    rng = np.random.default_rng([seed, 7])
    bodies = [model.body(f"fruit_{i}").id for i in range(len(sizes))]
    radii, T = sizes[:, 0] / 2.0, how.T_base_floor
    limits = np.full((len(sizes), 2), np.inf) if how.inside is None else how.inside - radii[:, None]
    spots = _apart(radii, limits, rng)
    for body, spot, height in zip(bodies, spots, sizes[:, 1], strict=True):
        address = model.jnt_qposadr[model.body_jntadr[body]]
        state.qpos[address : address + 3] = T[:3, :3] @ [*spot, height / 2.0 + 0.003] + T[:3, 3]
    if how.inside is None:
        return
    sides = rng.choice([-1.0, 1.0], (len(sizes), 2)) * (rng.random((len(sizes), 2)) < AT_WALL)
    sides[rng.permutation(len(sizes))[max(2, len(sizes) // 2) :]] = 0.0
    pull = PULL * float(np.linalg.norm(model.opt.gravity)) * model.body_mass[bodies]
    for _ in range(round(PULLED / model.opt.timestep)):
        state.xfrc_applied[bodies, :3] = pull[:, None] * (sides @ T[:3, :2].T)
        mujoco.mj_step(model, state)
    state.xfrc_applied[:] = 0.0


def _apart(radii: Float64, limits: Float64, rng: np.random.Generator) -> Float64:
    """Return places of circles that do not overlap, as far as there is room, each within ± its limits (n, 2) [m]."""
    spots = rng.uniform(-1.0, 1.0, limits.shape) * np.where(np.isinf(limits), HEAP, limits)
    for _ in range(2000):
        between = spots[:, None] - spots[None]
        distance = np.linalg.norm(between, axis=2) + 1e-9
        overlap = np.maximum(1.01 * (radii[:, None] + radii[None]) - distance, 0.0)
        np.fill_diagonal(overlap, 0.0)
        if not overlap.any():
            break
        shift = (between / distance[..., None] * (0.25 * overlap[..., None])).sum(axis=1)
        spots = np.clip(spots + shift, -limits, limits)
    return spots
