"""Detach in the simulated wall: a true apple on its branch, the simulated arm, gripper and fingers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.harvest.detach import Detach
from pomona.applications.harvest.reachable import GraspSearch
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, StreamedArm, Workspace
from pomona.executive.cell.connect import load_cell
from pomona.executive.skill_testing import drive
from pomona.skills.motion.grasp import Grasp
from tests.skills.applications.harvest.test_pulling import Script
from tests.skills.picking_scene import apple_at

CELL = Path(__file__).resolve().parents[4] / "trees" / "cells" / "orchard.yaml"
FRUIT = 7
"""One of three apples on its spur; both rolls are free."""


EMULATED = """
name: emulated_orchard
kind: emulated
workspace: {{include: "{cells}/orchard.yaml#workspace"}}
world:
  driver: emulated-world
  cell: {cells}/orchard.yaml
  options: {{leaves: "0", behind: "0", friction: "0.8"}}
  arm: 127.0.0.1:50240
  controller: fs100
  gripper: 127.0.0.1:41000
  fingers: /tmp/pomona
  camera: 127.0.0.1:41001
devices:
  arm:
    driver: motoman
    address: 127.0.0.1:50240
    controller: fs100
    robot: {cells}/../robots/sia5f_wsg32.xml
    joints: S L E U R B T
  gripper: {{driver: wsg, tcp: "127.0.0.1:41000", finger_offset: 35 mm, speed_max: 200 mm/s}}
  fingers:
    driver: suntouch
    left: {{port: /tmp/pomona/finger_left, calibration: {cells}/emulated_fingers/left.json}}
    right: {{port: /tmp/pomona/finger_right, calibration: {cells}/emulated_fingers/right.json}}
"""
"""The wall behind the bytes of a Yaskawa controller, a WSG and SUNTouch fingers, on virtual time."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["simulated", "emulated"])
def test_an_apple_is_rolled_off_its_branch_and_held_without_a_bruise(kind: str, tmp_path: Path) -> None:
    if kind == "simulated":
        cell = load_cell(CELL, seed=3, overrides={"leaves": "0", "behind": "0", "friction": "0.8"})
        world = cell.devices["world"]
    else:
        (tmp_path / "cell.yaml").write_text(EMULATED.format(cells=CELL.parent))
        cell = load_cell(tmp_path / "cell.yaml", seed=3)
        world = cell.devices["world"]._world
    script = Script(cell)
    search, hung = GraspSearch(world.built, world.description), world.built.wall.fruits[FRUIT]
    T, q = next(search.grasps(FRUIT))
    before = T.copy()
    before[:3, 3] -= 0.08 * T[:3, 2]
    script.until(script.gripper.move(2.0 * hung.radius + 0.015, 0.1))
    script.go(search.solve(before, q))
    script.go(q)
    fruit = replace(apple_at(1, 1), T_base_fruit=hung.T_base_fruit, dimensions=hung.dimensions)
    grasp = Grasp(0, np.pi / 2.0, 0.0, before, T, 2.0 * hung.radius + 0.015, q[None], 0.01, 0.0, fruit)
    devices: dict[type, object] = {kind: cell.device(kind) for kind in (Arm, StreamedArm, Gripper, ForceSensor)}
    devices[Workspace] = cell.workspace
    end = drive(Detach(), {"grasp": grasp}, devices, clock=cell.clock, limit=20.0)
    report = world.score.report()
    story = report["fruits"][FRUIT]
    assert end.status is Status.SUCCESS, end.reason
    assert (story["place"], story["how"], story["bruised"]) == ("hand", "gripped", False)
    assert (report["detached"], report["knocked_off"], report["stems_torn"]) == (1, 0, 0)
    assert story["stem_force_n"] < 8.0
    cell.close()
