"""The experimental tree that picks a wall: it has no findings, and its bin takes the apples."""

from __future__ import annotations

from pathlib import Path

from pomona.applications.harvest.detach import Detach
from pomona.applications.harvest.sample_hanging import SampleHanging
from pomona.executive.cell.cell_file import read_cell_file
from pomona.executive.files import find_cell
from pomona.executive.language import check, format_findings, read_file
from pomona.executive.registry import Registry
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.robot import RobotModel
from pomona.tools.mock import MockArm, MockClock
from pomona.tools.mock.arm import ROBOT

TREE = Path(__file__).resolve().parents[4] / "trees" / "experimental" / "pick_tree.yaml"


def test_the_tree_that_picks_a_wall_has_no_findings() -> None:
    skills = Registry({**Registry.installed(), "Detach": Detach, "SampleHanging": SampleHanging})
    assert format_findings(check(read_file(TREE), skills)) == ""


def test_a_hand_around_a_large_apple_gets_down_to_the_floor_of_the_bin_at_every_place() -> None:
    workspace = read_cell_file(find_cell("orchard")).workspace
    assert workspace is not None
    robot = RobotModel.load(ROBOT)
    blocked = []
    for name, q in workspace.poses.items():
        if not name.startswith("place"):
            continue
        space = arm_space(MockArm(MockClock(), q), workspace, None, 0.09, 5e-3)
        T = robot.tcp(q)
        T[2, 3] = -0.075  # the apple touches the foam
        line = straight_line(robot, q, T)
        if not line.complete or space.first_blocked(line.q) is not None:
            blocked.append(name)
    assert blocked == []
