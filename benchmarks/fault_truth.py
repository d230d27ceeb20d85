"""The truth of a case of the fault matrix: of fruit on the table, in a crate, or on a belt.

No word of a skill is used. A claim is the success of a node: Lift and Intercept that the fruit hangs, Release that it
lies in a crate. The truth judges it in the tick in which it is made.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any, Protocol

import numpy as np

from pomona.applications.conveyor.world import ConveyorWorld
from pomona.executive.values.arrays import Float64
from pomona.tools.simulation.layout import PADS
from pomona.tools.simulation.world import SimWorld

FORCE_MAX = 14.0
"""Limit of the table's tree for both fingers together [N]: SlipAvoidGrasp's default."""
OVERSHOOT = 1.05
"""The arm's deceleration and the grip's force, as measured in the world, over their limits."""
DRAWN = 0.01
"""A fruit this far from where it lay was drawn from the wall [m]."""
HUNG = 0.05
"""A fruit this far above where it stood hangs [m]."""
PRESSED = 0.3
"""A fruit that both pads press with more is held [N]."""
SETS_OFF = 0.05
"""A joint of an arm that has set off is faster [rad/s]."""


class RowTruth(Protocol):
    """RowTruth of a case.

    Attributes:
        force_max: limit of `force` [N]; contact: largest other force so far, and on what [N].
        failing: nodes whose failure ends the case; empty: any.
        kept_from_stop: a grip must be kept from the safe stop on, not from the fault on.
        may_end_empty: a run that picks nothing may succeed: nothing came that could be caught.
        claimed: whether the claims so far were true; None without one.
    """

    force_max: float
    contact: tuple[float, str]
    failing: frozenset[str]
    kept_from_stop: bool
    may_end_empty: bool
    claimed: bool | None

    @property
    def forces(self) -> list[float]:
        """Of the pads [N]."""

    @property
    def force(self) -> float:
        """Present force that the limit holds for [N]."""

    def look(self, begun: Collection[str]) -> Iterator[str]:
        """Note a step of the world, given the nodes that have begun; yield the names of the moments that have come."""

    def judge_claim(self, node: str) -> None:
        """Compare the success of a node with the truth."""

    def troubles(self, told: Mapping[str, Any]) -> Iterator[str]:
        """Yield all that must not have happened to fruit; `told` is the world's score at the end of the run."""


class TableTruth:
    """The fruit on the table."""

    force_max = OVERSHOOT * FORCE_MAX
    failing = frozenset[str]()
    kept_from_stop = False
    may_end_empty = False

    def __init__(self, world: SimWorld) -> None:
        self._world = world
        self._wrenches = [world.sensor(f"wrench_{pad}") for pad in PADS]
        names = [world.model.sensor(i).name for i in range(world.model.nsensor)]
        touched = [name for name in names if name.startswith("robot_") and name != "robot_robot"]
        self._contacts = {name.removeprefix("robot_"): world.sensor(name) for name in touched}
        self.contact = 0.0, ""
        self.claimed: bool | None = None
        self.rest_z = self._height()

    def _height(self) -> float:
        return float(self._world.state.body("fruit_0").xpos[2])

    @property
    def raised(self) -> float:
        """Height of the fruit above where it stood [m]."""
        return self._height() - self.rest_z

    @property
    def forces(self) -> list[float]:
        return [float(np.linalg.norm(view[:3])) for view in self._wrenches]

    @property
    def force(self) -> float:
        return sum(self.forces)

    def look(self, begun: Collection[str]) -> Iterator[str]:
        for name, view in self._contacts.items():
            if view[0] > 0.0:
                self.contact = max(self.contact, (float(np.linalg.norm(view[1:4])), name))
        return iter(())

    def judge_claim(self, node: str) -> None:
        if node == "Lift":
            self.claimed = self.raised > HUNG

    def troubles(self, told: Mapping[str, Any]) -> Iterator[str]:
        if told.get("drops", 0):
            yield "dropped the fruit"


class CrateTruth(TableTruth):
    """The fruit in a crate: touched and drawn by a finger before it is gripped."""

    def __init__(self, world: SimWorld) -> None:
        super().__init__(world)
        self._rest = self._place()

    def _place(self) -> Float64:
        place: Float64 = np.array(self._world.state.body("fruit_0").xpos[:2])
        return place

    def look(self, begun: Collection[str]) -> Iterator[str]:
        super().look(begun)
        if "Hook" in begun and self._contacts["fruit_0"][0] > 0.0:
            yield "hook_touches"
        if "Hook" in begun and float(np.linalg.norm(self._place() - self._rest)) > DRAWN:
            yield "drawn"

    def judge_claim(self, node: str) -> None:
        super().judge_claim(node)
        if node == "Release":
            self.claimed = self.claimed is not False and bool(self._world.truth()["put_away"])

    def troubles(self, told: Mapping[str, Any]) -> Iterator[str]:
        yield from super().troubles(told)
        if told["bruised"]:
            yield f"bruised {told['pressed']}, with {told['largest_press']:.2f} times the force that does"


class BeltTruth:
    """Fruit on a running belt: the one that the hand holds, and the hand's contacts with the belt."""

    force_max = OVERSHOOT * FORCE_MAX
    failing = frozenset({"Track", "AwaitFruit", "MoveTo", "Intercept", "Release"})
    kept_from_stop = True
    may_end_empty = True

    def __init__(self, world: ConveyorWorld) -> None:
        self._world = world
        count = len(world.built.fruits)
        self._pads = [[world.sensor(f"{pad}_fruit_{i}") for pad in PADS] for i in range(count)]
        self._belt = world.sensor("robot_belt")
        self._qvel = world.model.jnt_dofadr[world.arm_joints]
        self.contact = 0.0, ""
        self.claimed: bool | None = None

    @property
    def forces(self) -> list[float]:
        pressed = [[float(np.linalg.norm(view[1:4])) for view in pads] for pads in self._pads]
        return max(pressed, key=sum)

    @property
    def force(self) -> float:
        return sum(self.forces)

    def look(self, begun: Collection[str]) -> Iterator[str]:
        if self._belt[0] > 0.0:
            self.contact = max(self.contact, (float(np.linalg.norm(self._belt[1:4])), "belt"))
        if "Intercept" not in begun:
            return
        if np.abs(self._world.state.qvel[self._qvel]).max() > SETS_OFF:
            yield "sets_off"
        pads = self.forces
        if max(pads) > PRESSED:
            yield "touched"
        if min(pads) > PRESSED:
            yield "gripped"
        if self._lifted:
            yield "lifted"

    @property
    def _lifted(self) -> list[int]:
        return [fate.number for fate in self._world.score.fates if fate.lifted and not fate.ending]

    def judge_claim(self, node: str) -> None:
        if node in ("Intercept", "Release"):
            at = self._lifted
            true = (
                bool(at)
                if node == "Intercept"
                else any(self._world.score.crate_of(number) for number in at)
            )
            self.claimed = true and self.claimed is not False

    def troubles(self, told: Mapping[str, Any]) -> Iterator[str]:
        now = self._world.score.report()
        if now["drops"]:
            yield "dropped the fruit"
        if now["collisions"]:
            yield "touched the belt or itself"


def truth_of(world: Any) -> TableTruth | BeltTruth:
    """Return the truth of a simulated world."""
    if isinstance(world, SimWorld) and world.scene.gathering is not None:
        return CrateTruth(world)
    return BeltTruth(world) if isinstance(world, ConveyorWorld) else TableTruth(world)
