"""A scripted hand at the wall, through the devices' interfaces alone: it proves the cell and knows no skills."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.applications.harvest.reachable import GraspSearch, grasp_pose
from pomona.drivers.interfaces import Arm, Camera, ForceSensor, Gripper, Trajectory
from pomona.executive.cell.connect import load_cell

from .test_world import BARE, CELL


def quintic(a, b, limits, share=0.5):
    """From rest to rest in joint space, within a share of the limits."""
    way = np.abs(b - a)
    duration = max(
        0.2,
        float((1.875 * way / (share * limits.velocity)).max()),
        float(np.sqrt(5.78 * way / (share * limits.acceleration)).max()),
        float(np.cbrt(60.0 * way / (share * limits.jerk)).max()),
    )
    x = np.linspace(0.0, 1.0, 200)
    w, wd, wdd = (
        x**3 * (10 - 15 * x + 6 * x**2),
        30 * x**2 * (1 - x) ** 2,
        60 * x * (1 - x) * (1 - 2 * x),
    )
    steps = [np.outer(each, b - a) for each in (w, wd / duration, wdd / duration**2)]
    return Trajectory(x * duration, a + steps[0], steps[1], steps[2])


class Script:
    def __init__(self, cell):
        self.cell, self.world = cell, cell.devices["world"]
        self.set_point = cell.workspace.poses["home"]
        self.arm, self.gripper, self.fingers = (
            cell.device(Arm),
            cell.device(Gripper),
            cell.device(ForceSensor),
        )

    def until(self, motion, limit=10.0):
        end = self.cell.clock.now() + limit
        while not motion.settled and self.cell.clock.now() < end:
            self.cell.clock.advance(0.02)
            self.cell.check()
        assert motion.settled

    def squeeze(self, force):
        """Close slowly until both pads feel so much, and stay there."""
        for _ in range(400):
            pressed = -self.fingers.latest().wrenches[:, 2]
            if pressed.min() > force - 0.2:
                break
            self.gripper.set_speed(-0.02 if pressed.min() < 0.5 else -0.004)
            self.cell.clock.advance(0.02)
            self.cell.check()
        self.gripper.set_speed(0.0)
        assert pressed.min() > force - 0.2

    def go(self, q):
        start, self.set_point = self.set_point, np.array(q)
        self.until(self.arm.follow(quintic(start, self.set_point, self.arm.limits)))


@pytest.mark.slow
@pytest.mark.parametrize(("pull_strength", "off"), [(4.0, True), (60.0, False)])
def test_a_hand_pulls_an_apple_off_a_weak_stem_and_slips_from_a_strong_one(pull_strength, off):
    cell = load_cell(CELL, seed=3, overrides={**BARE, "friction": "0.8"})
    script, world = Script(cell), cell.devices["world"]
    search = GraspSearch(world.built, world.description)
    i = 2  # alone on its spur, and within reach
    world.built.strengths[i] = [pull_strength, 1.0, 1.0, 1e3]
    fruit = world.built.wall.fruits[i]
    T = grasp_pose(fruit.T_base_fruit[:3, 3], 0.0, 0.0, 0.0)
    q_grasp = search.solve(T)
    before = T.copy()
    before[:3, 3] -= 0.10 * T[:3, 2]
    q_before = search.solve(before, q_grasp)
    script.until(script.gripper.move(script.gripper.limits.width_max, 0.1))
    script.go(q_before)
    script.go(q_grasp)
    script.squeeze(6.0)
    assert world.score.report()["detached"] == 0
    script.go(q_before)
    script.go(cell.workspace.poses["home"])  # far enough for a branch that gives way
    report = world.score.report()
    told = report["fruits"][i]
    assert (report["detached"], told["place"]) == ((1, "hand") if off else (0, "hangs"))
    assert told["how"] == ("gripped" if off else "")
    assert report["knocked_off"] == report["fell"] == 0
    if off:
        assert told["stem_force_n"] == pytest.approx(pull_strength, rel=0.1)
    assert cell.device(Camera) is not None
    cell.close()
