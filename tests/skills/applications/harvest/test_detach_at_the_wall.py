"""Detach in the simulated wall: a true apple on its branch, the simulated arm, gripper and fingers."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.harvest.detach import Detach
from pomona.applications.harvest.reachable import GraspSearch
from pomona.drivers.interfaces import Arm, ArmLimits, ForceSensor, Gripper, StreamedArm, Workspace
from pomona.executive.cell.connect import load_cell
from pomona.executive.skill_testing import drive
from pomona.executive.values.arrays import Float64
from pomona.skills.motion.grasp import Grasp
from tests.skills.applications.harvest.test_pulling import Script
from tests.skills.picking_scene import apple_at

CELL = Path(__file__).resolve().parents[4] / "trees" / "cells" / "orchard.yaml"
FRUIT = 7
"""One of three apples on its spur; both rolls are free."""
FRUIT_OF_UR = 3
"""The same before a UR5e, whose straight way in joint space to its second grasp is free."""


EMULATED = """
name: emulated_orchard
kind: emulated
workspace: {{include: "{cells}/{cell}.yaml#workspace"}}
world:
  driver: emulated-world
  cell: {cells}/{cell}.yaml
  options: {{leaves: "0", behind: "0", friction: "0.8"}}
  arm: {address}
  controller: {controller}
  gripper: 127.0.0.1:41000
  fingers: /tmp/pomona
  camera: 127.0.0.1:41001
devices:
  arm: {arm}
  gripper: {{driver: wsg, tcp: "127.0.0.1:41000", finger_offset: 35 mm, speed_max: 200 mm/s}}
  fingers:
    driver: suntouch
    left: {{port: /tmp/pomona/finger_left, calibration: {cells}/emulated_fingers/left.json}}
    right: {{port: /tmp/pomona/finger_right, calibration: {cells}/emulated_fingers/right.json}}
"""
"""The wall behind the bytes of a controller, a WSG and SUNTouch fingers, on virtual time."""

ROBOTS = CELL.parents[1] / "robots"
BEHIND_BYTES = {
    "emulated": {
        "cell": "orchard",
        "address": "127.0.0.1:50240",
        "controller": "fs100",
        "arm": "{driver: motoman, address: '127.0.0.1:50240', controller: fs100, joints: S L E U R B T, "
        f"robot: {ROBOTS}/sia5f_wsg32.xml}}",
    },
    "emulated_ur5e": {
        "cell": "orchard_ur5e",
        "address": "127.0.0.1",
        "controller": "universal-robots",
        "arm": f"{{driver: universal-robots, address: 127.0.0.1, model: ur5e, robot: {ROBOTS}/ur5e_wsg32.xml}}",
    },
}


def without_turns(q: Float64, near: Float64, limits: ArmLimits) -> Float64:
    """The same joints within half a turn of others, where the limits allow it, (dof,) [rad]."""
    turned = q + 2.0 * np.pi * np.round((near - q) / (2.0 * np.pi))
    return np.where((turned >= limits.lower) & (turned <= limits.upper), turned, q)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["simulated", *BEHIND_BYTES])
def test_an_apple_is_rolled_off_its_branch_and_held_without_a_bruise(
    kind: str, tmp_path: Path
) -> None:
    if kind == "simulated":
        cell = load_cell(CELL, seed=3, overrides={"leaves": "0", "behind": "0", "friction": "0.8"})
        world = cell.devices["world"]
    else:
        (tmp_path / "cell.yaml").write_text(
            EMULATED.format(cells=CELL.parent, **BEHIND_BYTES[kind])
        )
        cell = load_cell(tmp_path / "cell.yaml", seed=3)
        world = cell.devices["world"]._world
    script = Script(cell)
    apple, grasp_number = (FRUIT_OF_UR, 1) if kind == "emulated_ur5e" else (FRUIT, 0)
    search, hung = GraspSearch(world.built, world.description), world.built.wall.fruits[apple]
    T, q = next(islice(search.grasps(apple), grasp_number, None))
    q = without_turns(q, script.set_point, script.arm.limits)
    before = T.copy()
    before[:3, 3] -= 0.08 * T[:3, 2]
    script.until(script.gripper.move(2.0 * hung.radius + 0.015, 0.1))
    script.go(search.solve(before, q))
    script.go(q)
    fruit = replace(apple_at(1, 1), T_base_fruit=hung.T_base_fruit, dimensions=hung.dimensions)
    grasp = Grasp(
        0, np.pi / 2.0, 0.0, before, T, 2.0 * hung.radius + 0.015, q[None], 0.01, 0.0, fruit
    )
    devices: dict[type, object] = {
        kind: cell.device(kind) for kind in (Arm, StreamedArm, Gripper, ForceSensor)
    }
    devices[Workspace] = cell.workspace
    end = drive(Detach(), {"grasp": grasp}, devices, clock=cell.clock, limit=20.0)
    report = world.score.report()
    story = report["fruits"][apple]
    assert end.status is Status.SUCCESS, end.reason
    assert (story["place"], story["how"], story["bruised"]) == ("hand", "gripped", False)
    assert (report["detached"], report["knocked_off"], report["stems_torn"]) == (1, 0, 0)
    assert story["stem_force_n"] < 8.0
    cell.close()
