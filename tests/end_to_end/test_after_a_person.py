"""A person's hand comes to where the tool will be: once it is noticed, the arm does not go towards it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from pomona.executive.execute import Executed, RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, NodeChanged
from pomona.tools.simulation.intruder import FAR, Reach
from pomona.tools.simulation.world import PhysicsWorld

pytestmark = pytest.mark.slow

START = np.array([0.75, -0.75, 0.35])
"""Where the hand waits, in view of the cell's fixed cameras [m]."""
MOVING = 0.02  # speed of the joints from which on the arm moves [rad/s]
BRAKING = 0.45  # time in which it rests after a notice [s]: docs/safety.md


@dataclass
class Witness:
    """Sends the hand, and measures its true distance to the robot."""

    at: float = np.inf
    goal: Any = None
    arrive: float = 0.8
    stays: float = 0.0
    ways: list[tuple[float, Any]] = field(default_factory=list)
    distances: list[tuple[float, float, bool]] = field(default_factory=list)
    began: dict[str, float] = field(default_factory=dict)
    noticed: float = np.inf

    def watch(self, world: PhysicsWorld) -> None:
        now = float(world.state.time)
        moving = np.abs(world.state.qvel[world.model.jnt_dofadr[world.arm_joints]]).max() > MOVING
        self.ways.append((now, world.state.site("tcp").xpos.copy()))
        hand = world.intruder
        if now >= self.at:
            self.at = np.inf
            speed = float(np.linalg.norm(self.goal - START)) / self.arrive
            hand.send(Reach(START, self.goal, speed, self.stays))
        if self.noticed < np.inf:
            line = np.zeros(6)
            away = min(
                world.mujoco.mj_geomDistance(world.model, world.state, own, other, FAR, line)
                for own in hand._geoms
                for other in hand._robot
            )
            self.distances.append((now, float(away), bool(moving)))

    def hear(self, event: Event) -> None:
        if isinstance(event, NodeChanged):
            name = event.path.rpartition("/")[2]
            self.began.setdefault(name, event.t)
            if event.status == "FAILURE" and event.reason and event.reason.code == "PATH_BLOCKED":
                self.noticed = min(self.noticed, event.t)


def run(monkeypatch: pytest.MonkeyPatch, tree: str, witness: Witness) -> Executed:
    look = PhysicsWorld.watch

    def watch(world: PhysicsWorld) -> None:
        look(world)
        witness.watch(world)

    with monkeypatch.context() as patched:
        patched.setattr(PhysicsWorld, "watch", watch)
        settings = {"fruit": "apple_4", "place": "2", "distractors": "0"}
        order = RunOrder(find_tree(tree), find_cell("sim_watched"), 3, settings)
        return execute(order, [witness.hear])


@pytest.fixture(scope="module")
def undisturbed() -> Witness:
    witness = Witness()
    with pytest.MonkeyPatch.context() as patch:
        run(patch, "pick_apple", witness)
    return witness


@pytest.mark.parametrize(
    ("phase", "delay"), [("Follow", 0.2), ("Approach", 0.1), ("SlipAvoidGrasp", 0.0), ("Lift", 0.0)]
)
@pytest.mark.parametrize(
    "stays",
    [pytest.param(1.0, marks=pytest.mark.long), 3.0, pytest.param(8.0, marks=pytest.mark.long)],
)
def test_once_a_hand_is_noticed_the_arm_rests_until_it_has_left(
    monkeypatch: pytest.MonkeyPatch, undisturbed: Witness, phase: str, delay: float, stays: float
) -> None:
    sent = undisturbed.began[phase] + delay
    times = np.array([at for at, _ in undisturbed.ways])
    there = int(np.argmin(np.abs(times - sent - 0.8)))
    witness = Witness(at=sent, goal=undisturbed.ways[there][1], stays=stays)
    executed = run(monkeypatch, "pick_apple", witness)
    leaves = sent + witness.arrive + stays
    moved = [
        (at, away)
        for at, away, moving in witness.distances
        if moving and witness.noticed + BRAKING < at < leaves
    ]
    if phase in ("Follow", "Approach"):  # the motions that are watched from the start
        assert witness.noticed < leaves
    assert moved == [], f"noticed at {witness.noticed:.2f} s, there until {leaves:.2f} s"
    assert executed.result.outcome in ("success", "failure")
    assert executed.result.truth is not None
    assert executed.result.truth["drops"] == 0
