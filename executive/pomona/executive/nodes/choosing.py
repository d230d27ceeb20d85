"""Composites that choose one of their children: if, reactive_if, switch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from enum import Enum
from typing import Any, ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Branch
from pomona.executive.nodes.check import CheckType
from pomona.executive.nodes.context import (
    Around,
    BuildContext,
    CheckContext,
    FactContext,
    FlowContext,
    LastFailure,
    NodeContext,
    OutcomeContext,
)
from pomona.executive.nodes.facts import ALL, Ends, Facts, Names, Outcome, codes_of
from pomona.executive.nodes.node_type import Composite
from pomona.executive.ports import Port
from pomona.executive.reasons import NoValue, Reason, from_causes, path_of, reason_of


class Choice(Branch):
    """Ticks the chosen child and ends with its status. Subclasses choose (`choose`)."""

    def __init__(self, name: str, children: Sequence[Behaviour]) -> None:
        super().__init__(name, children)
        self._why: Reason | None = None
        self._chosen: Behaviour | None = None

    def explain(self) -> Reason:
        """Why the chosen child failed, or why none could be chosen."""
        if self._why is not None:
            return self._why
        return from_causes(self, () if self._chosen is None else (reason_of(self._chosen),))

    def end(self, status: Status) -> None:
        """Take a status; everything that still runs is interrupted when it is an end."""
        if status is Status.RUNNING:
            self.status = status
        else:
            self.stop(status)

    def go(self, chosen: Behaviour | None) -> Iterator[Behaviour]:
        """Tick a child instead of the one that ran before; without one the node is skipped."""
        if (
            self._chosen is not None
            and self._chosen is not chosen
            and self._chosen.status is Status.RUNNING
        ):
            self._chosen.stop(Status.INVALID)
        self._chosen = self.current_child = chosen
        if chosen is None:
            self.stop(Status.INVALID)
        else:
            yield from chosen.tick()
            self.end(chosen.status)
        yield self


class If(Choice):
    """Its first child decides: when it succeeds the second one runs, when it fails the third one.

    Args:
        reactive: whether the first child is asked again in every tick.
    """

    def __init__(
        self,
        name: str,
        children: Sequence[Behaviour],
        reactive: bool,
        last_failure: LastFailure | None = None,
    ) -> None:
        super().__init__(name, children)
        self._reactive, self._last_failure = reactive, last_failure or LastFailure()

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.reset()
            self._chosen = self._why = None
        if self._chosen is not None and not self._reactive:
            yield from self.go(self._chosen)
            return
        asked = self.children[0]
        yield from asked.tick()
        if asked.status is Status.RUNNING or asked.status is Status.INVALID:
            if self._chosen is not None and self._chosen.status is Status.RUNNING:
                self._chosen.stop(Status.INVALID)
            self.end(asked.status)
            yield self
        elif asked.status is Status.SUCCESS:
            yield from self.go(self.children[1])
        else:
            reason = reason_of(asked)
            self._last_failure.see(reason)
            if reason.code == "BAD_VALUE":  # the condition has no value
                self._why = from_causes(self, (reason,))
                self.stop(Status.FAILURE)
                yield self
            else:
                yield from self.go(self.children[2] if len(self.children) > 2 else None)


class Switch(Choice):
    """Runs the child whose word is the value; reads the value in every tick.

    Args:
        words: of the children in order; a child beyond them runs when no word fits.
    """

    def __init__(
        self,
        name: str,
        children: Sequence[Behaviour],
        words: Sequence[str],
        value: Callable[[], Any],
    ) -> None:
        super().__init__(name, children)
        self._words = tuple(words)
        self._value = value

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.reset()
            self._chosen = self._why = None
        try:
            texts = texts_of(self._value())
        except NoValue as missing:
            self._why = Reason(path_of(self), "BAD_VALUE", str(missing))
            self.stop(Status.FAILURE)
            yield self
            return
        others = self.children[len(self._words) :]
        chosen = next(
            (c for word, c in zip(self._words, self.children, strict=False) if word in texts), None
        )
        yield from self.go(chosen or (others[0] if others else None))


def texts_of(value: Any) -> tuple[str, ...]:
    """How a value may be written as a case."""
    if isinstance(value, Enum):
        return value.name, str(value.value)
    if isinstance(value, bool):
        return (str(value).lower(),)
    if isinstance(value, float):
        return (f"{value:g}", str(value))
    return ("none",) if value is None else (str(value),)


class IfType(Composite):
    """when it succeeds (a node) or holds (a condition), `then` runs, otherwise `else`; without `else` it is skipped"""

    key = "if"
    symbol = "⎇"
    value = takes.ChildOrCondition(CheckType(), "a condition or a node")
    fields: ClassVar[takes.Fields] = {
        "then": takes.Child("runs when the condition holds or the node succeeds", required=True),
        "else": takes.Child("runs otherwise"),
    }
    other_names = ("IfThenElse",)
    reactive: ClassVar[bool] = False

    def around(self, at: CheckContext, index: int) -> Around:
        return replace(at.around, failure=at.outcomes.child(0).codes) if index == 2 else at.around

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        asked, *chosen = at.children()
        if not chosen:
            return asked
        skips = asked.skips or len(chosen) < 2 or any(outcome.skips for outcome in chosen)
        least = min(outcome.least for outcome in chosen) if len(chosen) > 1 else 0.0
        codes = codes_of(chosen)
        return Outcome(
            codes, any(outcome.succeeds for outcome in chosen), skips, asked.least + least
        )

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        asked = at.child(0, before)
        if len(at.node.children) < 2:
            return asked
        chosen = at.child(1, asked.success)
        other = (
            at.child(2, asked.failure)
            if len(at.node.children) > 2
            else Ends(ALL, ALL, asked.failure)
        )
        return Ends(
            chosen.success & other.success,
            chosen.failure & other.failure,
            chosen.skipped & other.skipped & asked.skipped,
        )

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        if self.reactive or len(at.node.children) < 2:
            return super().known_facts(at, known)
        at.child(1, at.child(0, known))
        if len(at.node.children) > 2:
            at.child(2, at.after(0, known))
        return at.forget(known)

    def build(self, at: BuildContext) -> Behaviour:
        last_failure = LastFailure()
        children = [
            at.child(i, failure=last_failure) if i == 2 else at.child(i)
            for i in range(len(at.node.children))
        ]
        return If(at.name, children, self.reactive, last_failure)


class ReactiveIfType(IfType):
    """like `if`, but evaluated in every tick; interrupts the running branch when the result changes"""

    key = "reactive_if"
    symbol = "⎇"
    other_names = ("WhileDoElse",)
    reactive = True


class SwitchType(Composite):
    """runs the node whose word is the value; reads it in every tick; `default` when none fits, else it is skipped"""

    key = "switch"
    symbol = "⎇"
    value = takes.Single(Port(object), "the word, number or member that chooses; no quantity")
    fields: ClassVar[takes.Fields] = {
        "cases": takes.Cases("nodes by word", required=True),
        "default": takes.Child("runs when no word fits"),
    }
    other_names = ("Switch2", "Switch3", "Switch4", "Switch5", "Switch6")

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        chosen = at.children()
        skips = "default" not in at.node.modifiers or any(outcome.skips for outcome in chosen)
        least = min((outcome.least for outcome in chosen), default=0.0)
        return Outcome(codes_of(chosen), any(outcome.succeeds for outcome in chosen), skips, least)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        success = ALL
        failure = before if at.computes else ALL
        skipped = ALL if "default" in at.node.modifiers else before
        for index in range(len(at.node.children)):
            ends = at.child(index, before)
            success = success & ends.success
            failure = failure & ends.failure
            skipped = skipped & ends.skipped
        return Ends(success, failure, skipped)

    def words(self, at: NodeContext) -> list[str]:
        """Return the cases in order."""
        return [
            lead.removesuffix(": ")
            for lead in at.node.leads[: len(at.node.children) - self.has_default(at)]
        ]

    @staticmethod
    def has_default(at: NodeContext) -> bool:
        """Return True if something runs when no word fits."""
        return "default" in at.node.modifiers

    def build(self, at: BuildContext) -> Behaviour:
        return Switch(at.name, at.children(), self.words(at), at.value(self.key))
