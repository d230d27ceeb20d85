"""A skill that commands nothing can change no fact of its cell: a write is refused, or leaves no trace."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.drivers.interfaces import Arm, Camera, Cameras, ForceSensor, Hand, Workspace
from pomona.executive.board import Board
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.executive.clock import ManualClock
from pomona.executive.errors import NotOwnerError
from pomona.executive.language import BuiltTree
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream
from pomona.executive.skill import Skill, SkillContext, Work
from pomona.executive.values.arrays import Float64
from pomona.executive.values.read_only import own
from pomona.skills.motion.collision import RobotShape
from pomona.skills.motion.grasp import GraspCandidates
from pomona.skills.motion.robot import RobotModel
from tests.skills.picking_scene import a_grasp, seen_map
from tests.skills.reach import changes, places

MOCK = """
name: bench
kind: mock
workspace:
  table_z: 0 m
  lower: -1 -1 0 m
  upper: 1 1 1 m
  obstacles: [{name: wall, centre: 0 1 0 m, size: [2 m, 20 mm, 1 m], yaw: 90 deg}]
  zones: [{name: window, lower: 0.5 0.5 0 m, upper: 1 1 1 m}]
  poses: {home: 0 0 0 0 0 0 0 rad}
world: {driver: mock}
devices:
  arm: {driver: mock-arm, start: home}
  gripper: {driver: mock-gripper}
  fingers: {driver: mock-fingers, fruit: 80 mm}
  camera: {driver: mock-camera}
"""


class Onlooker(Skill):
    """Looks at all devices of a cell and moves none."""

    moves = ()

    def run(self) -> Work[None]:
        yield None


def mock_cell(folder: Path) -> Cell:
    (folder / "cell.yaml").write_text(MOCK)
    return load_cell(folder / "cell.yaml")


def simulated_cell(folder: Path) -> Cell:
    return load_cell(
        Path(__file__).parents[2] / "trees" / "cells" / "sim.yaml", overrides={"distractors": "0"}
    )


@pytest.fixture(params=[mock_cell, simulated_cell], ids=["mock", "simulated"])
def cell(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Cell]:
    cell = request.param(tmp_path)
    cell.clock.advance(0.1)
    yield cell
    cell.close()


class ContextMade(Exception):
    """Carries the services that a runner gives its skills."""

    def __init__(self, context: SkillContext, board: Board) -> None:
        self.context = context


def onlooker(cell: Cell) -> Onlooker:
    skill = Onlooker()
    Onlooker.devices = (*cell.interfaces(), Hand, Cameras)
    with pytest.raises(ContextMade) as made:
        Runner(give_context, cell, EventStream())
    skill.bind(made.value.context, "look", dict, lambda _name, _value: None)
    skill.context.acquire(skill)
    return skill


def give_context(context: SkillContext, board: Board) -> BuiltTree:
    raise ContextMade(context, board)


def within_reach(skill: Skill) -> dict[str, Callable[[], Any]]:
    """Devices and services of a skill; models of the robot, which all skills of a process share."""
    reach: dict[str, Callable[[], Any]] = {
        interface.__name__: lambda interface=interface: skill.device(interface)
        for interface in skill.devices
    }
    description = skill.device(Arm).description
    reach |= {"robot": lambda: RobotModel.load(description), "context": lambda: skill.context}
    return reach | {"shape": lambda: RobotShape.of(RobotModel.load(description))}


def test_nothing_that_a_skill_reaches_without_a_lease_can_be_changed(cell: Cell) -> None:
    assert changes(within_reach(onlooker(cell))) == []


def test_the_walk_reaches_limits_poses_boxes_readings_and_the_robot(cell: Cell) -> None:
    reached = {place.path for place in places(within_reach(onlooker(cell)))}
    expected = (
        "Arm.limits.velocity",
        "Workspace.poses['home']",
        "Workspace.zones[0].T_base_box",
        "Arm.state().q",
    )
    reached = (
        reached if cell.kind == "mock" else reached | {"Workspace.zones[0].T_base_box"}
    )  # it has none
    assert reached >= {
        *expected,
        "ForceSensor.latest().wrenches",
        "shape.model.geoms[0].size",
        "shape.arrays.spheres",
    }
    if cell.kind == "simulated":
        assert {
            "Cameras.all[0].latest().depth",
            "Cameras.all[0].latest().T_mount_camera",
        } <= reached


def board_values() -> dict[str, Callable[[], Any]]:
    """Values that skills exchange, as a skill reads them."""
    board, grasp = Board(ManualClock()), a_grasp()
    values = {"map": seen_map(), "candidates": GraspCandidates((grasp,), (), 1)}
    for name, value in {**values, "list": [grasp.width, {"q": grasp.q_pre_grasp.copy()}]}.items():
        board.write(name, value, "a test")
    return {name: lambda name=name: own(board.entries[name].value) for name in board.entries}


def test_no_value_of_the_board_can_be_changed_by_its_reader() -> None:
    roots = board_values()
    reached = {place.path for place in places(roots)}
    assert reached >= {"map.states", "candidates.grasps[0].fruit.T_base_fruit", "list[1]['q']"}
    assert changes(roots) == []


@dataclass(frozen=True, slots=True, eq=False)
class Planted:
    """A fact whose content is not protected."""

    array: Float64 = field(default_factory=lambda: np.zeros(2))
    poses: dict[str, int] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)


@dataclass
class Loose:
    """Not even frozen."""

    kept: set[int]


def test_the_walk_finds_each_planted_change_at_any_depth() -> None:
    loose, facts = Loose(set()), Planted()
    found = changes({"cell": lambda: {"a": (facts, loose)}.items().mapping})
    assert sorted(found) == sorted(
        [
            "cell['a'][0].array[...]",
            "cell['a'][0].names (list)",
            "cell['a'][0].poses (dict)",
            "cell['a'][1].kept (set)",
            "cell['a'][1].kept = …",
        ]
    )
    assert (facts.array == 0.0).all()
    assert not facts.names
    assert not facts.poses
    assert loose == Loose(set())


class Greedy(Skill):
    """Makes the arm five times as quick, and moves nothing."""

    devices = (Arm, Workspace)
    moves = ()

    def run(self) -> Work[None]:
        self.device(Arm).limits.velocity *= 5.0
        yield None


def test_a_skill_that_raises_the_arms_limits_ends_at_its_own_line_and_the_limits_stay(
    cell: Cell,
) -> None:
    before = cell.device(Arm).limits.velocity.copy()
    skill = onlooker(cell)
    greedy = Greedy()
    greedy.bind(skill.context, "greedy", dict, lambda _name, _value: None)
    with pytest.raises((AttributeError, ValueError)) as error:
        greedy.tick_once()
    assert any(entry.name == "run" and str(entry.path) == __file__ for entry in error.traceback)
    np.testing.assert_array_equal(cell.device(Arm).limits.velocity, before)


ATTACKS: dict[str, Callable[[Skill], Any]] = {
    "a force sensor's samples are replaced": lambda skill: setattr(
        skill.device(ForceSensor), "latest", lambda: None
    ),
    "a camera is closed": lambda skill: skill.device(Camera).close(),  # type: ignore[attr-defined]
    "a fault is injected": lambda skill: skill.device(ForceSensor).inject_fault("lost"),  # type: ignore[attr-defined]
    "a latch is released": lambda skill: skill.device(Camera).acknowledge(),  # type: ignore[attr-defined]
    "the arm's command is replaced": lambda skill: setattr(
        skill.device(Arm), "follow", lambda _path: None
    ),
    "the operator's speed is raised": lambda skill: skill.context.set_speed(1.0),  # type: ignore[attr-defined]
    "time passes": lambda skill: skill.clock.advance(60.0),
    "the clock is set": lambda skill: setattr(skill.clock, "now", lambda: 0.0),
    "a pose is moved": lambda skill: skill.device(Workspace).poses["home"].fill(1.0),
    "a pose is added": lambda skill: skill.device(Workspace).poses.update(away=np.zeros(7)),  # type: ignore[attr-defined]
    "the table is lowered": lambda skill: setattr(skill.device(Workspace), "table_z", -1.0),
    "a zone is dropped": lambda skill: skill.device(Workspace).zones.__delitem__(0),  # type: ignore[attr-defined]
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_a_skill_that_may_only_look_is_refused_at_its_own_line(attack: str, tmp_path: Path) -> None:
    cell = mock_cell(tmp_path)
    skill, before = onlooker(cell), cell.clock.now()
    with pytest.raises((AttributeError, NotOwnerError, TypeError, ValueError)):
        ATTACKS[attack](skill)
    assert cell.clock.now() == before
    assert cell.device(Workspace).table_z == 0.0
    cell.close()
