"""A person's hand comes to where the tool is: once it is noticed, the arm does not move on while it is there."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
import pytest

from pomona.executive import lease
from pomona.executive.execute import Executed, RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, NodeChanged
from pomona.executive.skill import Skill, Work
from pomona.tools.simulation.intruder import FAR, Reach
from pomona.tools.simulation.world import PhysicsWorld

pytestmark = pytest.mark.slow

WAYS = {"side": (0.75, -0.75, 0.35), "above": (0.1, -0.5, 1.1), "front": (-0.1, -1.1, 0.3)}
"""Where the hand starts, by its way [m]."""
PHASES = {
    "follow": ("Follow", 0.2, ""),
    "approach": ("Approach", 0.1, ""),
    "grasp": ("SlipAvoidGrasp", 0.0, "Approach"),
    "lift": ("Lift", 0.0, "SlipAvoidGrasp"),
    "carry": ("Release", 0.1, ""),
    "release": ("Release", np.inf, "Release"),
    "retreat": ("Attempt:on_failure", 0.0, ""),
}
"""Node during which the hand comes, and how long after its start [s]; in `release` once the hand goes down. The last is
the node in which a person was noticed before: others are watched from the start."""
ARRIVE = 0.8  # time of the hand's way [s]
MOVING = 0.02  # speed of the joints from which on the arm moves [rad/s]
DOWN = -0.05  # speed of the tool that lowers a fruit [m/s]
BRAKING = 0.45  # time in which it rests after a notice [s]: docs/safety.md


@dataclass
class Witness:
    """Sends the hand, and measures its true distance to the robot."""

    phase: str
    way: str
    stays: float
    sent: float = np.inf
    leaves: float = -np.inf
    noticed: float = np.inf
    distances: list[tuple[float, float, bool]] = field(default_factory=list)
    at: float = np.inf
    running: str = ""
    asked: str = ""
    tool: Any = None

    def watch(self, world: PhysicsWorld) -> None:
        now = float(world.state.time)
        speeds = np.abs(world.state.qvel[world.model.jnt_dofadr[world.arm_joints]])
        before, self.tool = self.tool, (now, world.state.site("tcp").xpos.copy())
        moving = bool(speeds.max() > MOVING)
        _, _, warned = PHASES[self.phase]
        if self.running == warned and (moving or warned != "Release") and not self.asked:
            for notice in list(lease._NOTICES.values()):
                notice.why = "a person was here"
        sinks = before is not None and self.tool[1][2] - before[1][2] < DOWN * (now - before[0])
        lowers = PHASES[self.phase][1] == np.inf and sinks and self.running == "Release"
        if self.sent == np.inf and (now >= self.at or (lowers and now > self.began + 1.0)):
            start = np.array(WAYS[self.way])
            speed = float(np.linalg.norm(self.tool[1] - start)) / ARRIVE
            world.intruder.send(Reach(start, self.tool[1], speed, self.stays))
            self.sent = now
            self.leaves = now + ARRIVE + self.stays
        if self.sent <= now < self.leaves:
            line = np.zeros(6)
            away = min(
                world.mujoco.mj_geomDistance(world.model, world.state, own, other, FAR, line)
                for own in world.intruder._geoms
                for other in world.intruder._robot
            )
            self.distances.append((now, float(away), moving))

    def hear(self, event: Event) -> None:
        if not isinstance(event, NodeChanged):
            return
        name = event.path.rpartition("/")[2]
        if event.status == "RUNNING" and name != self.running:
            self.running = name
            self.began = event.t
            node, delay, _ = PHASES[self.phase]
            if self.running == node and self.at == np.inf:
                self.at = event.t + delay
        blocked = event.reason is not None and event.reason.code == "PATH_BLOCKED"
        if event.t > self.sent and (blocked or event.feedback.startswith("at rest")):
            self.noticed = min(self.noticed, event.t)

    def confirm(self, _skill: Skill, why: str) -> Work[bool]:
        """An operator who sees nobody until the hand comes."""
        self.asked = why
        yield why
        return self.sent == np.inf

    def moved(self) -> list[tuple[float, float]]:
        """Times and distances at which the arm moved, while the hand was there and after it was noticed."""
        return [
            (round(at, 2), round(away, 3))
            for at, away, moving in self.distances
            if moving and at > self.noticed + BRAKING
        ]


def run(monkeypatch: pytest.MonkeyPatch, witness: Witness) -> Executed:
    look = PhysicsWorld.watch

    def watch(world: PhysicsWorld) -> None:
        look(world)
        witness.watch(world)

    settings = {"fruit": "apple_4", "place": "2", "distractors": "0"}
    if witness.phase == "retreat":
        settings |= {"mass": "0.5 kg", "friction": "0.25"}
    with monkeypatch.context() as patched:
        patched.setattr(PhysicsWorld, "watch", watch)
        patched.setattr(Skill, "confirm", lambda skill, why: witness.confirm(skill, why))
        order = RunOrder(find_tree("pick_and_place"), find_cell("sim_watched"), 3, settings)
        return execute(order, [witness.hear])


def rows() -> list[Any]:
    found = []
    for phase, way, stays in product(PHASES, WAYS, (1.0, 3.0, 8.0)):
        usual = stays == 3.0 and (phase, way) in (("grasp", "side"), ("retreat", "above"))
        marks = () if usual else (pytest.mark.long,)
        found.append(pytest.param(phase, way, stays, marks=marks, id=f"{phase}-{way}-{stays:g}s"))
    return found


@pytest.mark.parametrize(("phase", "way", "stays"), rows())
def test_once_a_hand_is_noticed_the_arm_rests_until_it_has_left(
    monkeypatch: pytest.MonkeyPatch, phase: str, way: str, stays: float
) -> None:
    witness = Witness(phase, way, stays)
    executed = run(monkeypatch, witness)
    assert witness.noticed < witness.sent + ARRIVE + BRAKING
    assert witness.moved() == []
    assert executed.result.outcome in ("success", "failure")
    assert executed.result.truth is not None
    assert executed.result.truth["drops"] == 0


@pytest.mark.long
@pytest.mark.parametrize("phase", [name for name, (_, _, warned) in PHASES.items() if warned])
def test_where_nobody_comes_again_the_run_goes_on(
    monkeypatch: pytest.MonkeyPatch, phase: str
) -> None:
    monkeypatch.setitem(PHASES, phase, ("nothing", 0.0, PHASES[phase][2]))
    witness = Witness(phase, "side", 1.0)
    executed = run(monkeypatch, witness)
    assert witness.sent == np.inf
    assert executed.result.outcome == "success"
