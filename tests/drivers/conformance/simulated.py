"""Simulated cells for benches: the file, the model and the world at rest are the same in each, and made once."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import cache
from typing import Any
from unittest import mock

from pomona.executive.cell.cell import Cell
from pomona.executive.cell.cell_file import CellFile, read_cell_file
from pomona.executive.cell.connect import connect_cell
from pomona.tools.simulation import connect
from pomona.tools.simulation.scene import SimScene, build_scene
from pomona.tools.simulation.world import SimWorld
from tests.drivers.tools.simulation.conftest import SIM

_MADE: dict[str, Any] = {}


@cache
def _file() -> CellFile:
    return read_cell_file(SIM, {"distractors": "0"})


def _scene(layout: Any, seed: int) -> SimScene:
    """Return the scene with a model of its own, which devices change."""
    made: SimScene = _MADE.setdefault("scene", None) or build_scene(layout, seed)
    _MADE["scene"] = made
    return replace(made, model=copy.copy(made.model))


def _settle(world: SimWorld) -> None:
    """Give a world the state in which the first one came to rest."""
    if "rest" not in _MADE:
        SETTLE(world)
        _MADE["rest"] = copy.copy(world.state)
    world.mujoco.mj_copyData(world.state, world.model, _MADE["rest"])


SETTLE = SimWorld._settle


def simulated(judged: str) -> Cell:
    """Return a new simulated cell in which the judged device lives: no claim is about another, a score, or contacts."""
    with (
        mock.patch.object(connect, "build_scene", _scene),
        mock.patch.object(SimWorld, "_settle", _settle),
    ):
        cell = connect_cell(_file(), seed=1)
    world: Any = cell.devices["world"]
    for hooks in (world.before_step, world.after_step):
        hooks[:] = [hook for hook in hooks if hook.__self__ is cell.devices[judged]]
    world.watch = lambda: None
    world.model.opt.disableflags |= world.mujoco.mjtDisableBit.mjDSBL_CONTACT
    return cell
