"""Leaves: wait, set, succeed, fail, and the call of a skill or a subtree by name."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import LeafBehaviour
from pomona.executive.nodes.context import (
    BuildContext,
    CheckContext,
    FactContext,
    OutcomeContext,
)
from pomona.executive.nodes.facts import UNKNOWN, Facts, Outcome
from pomona.executive.nodes.node_type import Leaf, Stage
from pomona.executive.ports import Port
from pomona.executive.values.yaml_nodes import YamlScalar


class Wait(LeafBehaviour):
    """Lets a duration on the run's clock pass."""

    def __init__(self, name: str, duration: Callable[[], float], now: Callable[[], float]) -> None:
        super().__init__(name)
        self._duration = duration
        self._now = now
        self._end = 0.0

    def begin(self) -> None:
        self._end = self._now() + self._duration()

    def act(self) -> Status:
        left = self._end - self._now()
        self.feedback_message = f"{max(left, 0.0):.1f} s left"
        return Status.RUNNING if left > 1e-9 else Status.SUCCESS


class SetValues(LeafBehaviour):
    """Writes values to the board: reads all of them first."""

    def __init__(
        self, name: str, values: Mapping[Callable[[Any], None], Callable[[], Any]]
    ) -> None:
        super().__init__(name)
        self._values = tuple(values.items())

    def act(self) -> Status:
        for write, value in [(write, get()) for write, get in self._values]:
            write(value)
        return Status.SUCCESS


class Succeed(LeafBehaviour):
    """Succeeds at once."""


class Fail(LeafBehaviour):
    """Fails at once, with a code and a sentence of the author's choice."""

    def __init__(self, name: str, code: Callable[[], str], message: Callable[[], str]) -> None:
        super().__init__(name)
        self._code = code
        self._message = message

    def act(self) -> Status:
        return self.fails(self._code(), self._message() or f"{self.name} fails")


class WaitType(Leaf):
    """lets time pass"""

    key = "wait"
    symbol = "◷"
    value = takes.duration("lets time pass")
    other_names = ("Sleep",)

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        duration = at.literal(self.key)
        return Outcome(least=duration if isinstance(duration, float) else 0.0)

    makes = Wait
    gives = ("value", "now")


class SetType(Leaf):
    """writes values"""

    key = "set"
    symbol = "="
    value = takes.Assignments()
    instant = True

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.assign(known)

    def build(self, at: BuildContext) -> Behaviour:
        return SetValues(at.name, {at.writer(name): get for name, get in at.inputs().items()})


class SucceedType(Leaf):
    """ends at once with success"""

    key = "succeed"
    symbol = "✓"
    value = takes.Nothing()
    other_names = ("AlwaysSuccess",)
    instant = True

    makes = Succeed


class FailType(Leaf):
    """ends at once with a failure of the author's choice"""

    key, symbol, colour = "fail", "✗", "#a4262c"
    value = takes.Wires({"code": Port(str, default="FAILED"), "message": Port(str, default="")})
    other_names = ("AlwaysFailure",)
    instant = True

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        code = at.node.ports.get("code")
        text = code[1].text if code is not None and isinstance(code[1], YamlScalar) else "FAILED"
        return Outcome(frozenset({UNKNOWN if "{" in text else text}), succeeds=False)

    def build(self, at: BuildContext) -> Behaviour:
        inputs = at.inputs()
        return Fail(
            at.name, inputs.get("code", lambda: "FAILED"), inputs.get("message", lambda: "")
        )


class Call(Leaf):
    """What is called by its name: ports are wired, and inputs are checked against its declaration."""

    value = takes.Ports()
    calls = True

    @abstractmethod
    def look_up(self, at: CheckContext) -> None:
        """Look for it by its name; the finding is reported."""

    def declare(self, at: CheckContext, stage: Stage) -> None:
        if stage is Stage.DECLARED:
            self.look_up(at)
        elif stage is Stage.UNKNOWN:
            at.mark_outputs_unknown()

    def check_layer(self, at: CheckContext) -> None:
        at.check_call()


class SkillCall(Call):
    """a skill; names begin with a capital"""

    key, symbol, colour = "skill", "●", "#0b6e4f"

    def look_up(self, at: CheckContext) -> None:
        at.look_up_skill()

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return at.skill()

    def build(self, at: BuildContext) -> Behaviour:
        return at.skill()


class SubtreeCall(Call):
    """a subtree of this file, or of another"""

    key, symbol, colour = "subtree", "▣", "#6c4ab6"

    def look_up(self, at: CheckContext) -> None:
        at.look_up_subtree()

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return at.subtree()

    def build(self, at: BuildContext) -> Behaviour:
        return at.subtree()


SKILL = SkillCall()
SUBTREE = SubtreeCall()
