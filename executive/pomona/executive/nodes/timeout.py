"""Timeout: a limit on the run's clock."""

from __future__ import annotations

from collections.abc import Callable

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import (
    BuildContext,
    CheckContext,
    FactContext,
    FlowContext,
    OutcomeContext,
    Words,
    XmlExport,
    XmlImport,
)
from pomona.executive.nodes.ends import Ends, Names, Outcome
from pomona.executive.nodes.facts import Facts
from pomona.executive.nodes.node_type import Modifier
from pomona.executive.reasons import path_of


class Timeout(Wrapper):
    """Interrupts its child when it still runs after a duration on the run's clock."""

    def __init__(self, name: str, child: Behaviour, duration: Callable[[], float], now: Callable[[], float]) -> None:
        super().__init__(name, child)
        self._duration, self._now = duration, now
        self._limit = self._end = 0.0

    def begin(self) -> Status | None:
        self._limit = self._duration()
        self._end = self._now() + self._limit
        return None

    def after(self, status: Status) -> Status:
        if status is not Status.RUNNING or self._now() < self._end - 1e-9:
            return status
        tip = self.decorated.tip() or self.decorated
        doing = f": {tip.feedback_message}" if tip.feedback_message else ""
        message = f"{tip.name} was still running after {self._limit:g} s{doing}"
        return self.fails("TIMEOUT", message, limit=self._limit, running=path_of(tip), feedback=tip.feedback_message)


class TimeoutType(Modifier):
    """interrupts one try that takes longer; fails with `TIMEOUT`"""

    key, symbol = "timeout", "◷"
    value = takes.duration("for each try")
    xml_value = "duration"
    xml_tags = ("Timeout",)

    def check_layer(self, at: CheckContext) -> None:
        super().check_layer(at)
        limit, key = at.literal(self.key), at.node.modifiers[self.key][0]
        if not isinstance(limit, float):
            return
        least = at.outcomes.inside().least
        if limit == 0.0:
            message = "a timeout of 0 s interrupts everything that does not end in its first tick"
            at.findings.warning(key, "too-short", message)
        elif least > limit:
            message = f"{at.node.label} takes {least:g} s at least and is always interrupted after {limit:g} s"
            at.findings.warning(key, "too-short", message)

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return at.inside().plus("TIMEOUT")

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        return Ends(ends.success, ends.failure & before, ends.skipped)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.inside(known)

    def build(self, at: BuildContext) -> Behaviour:
        return Timeout(at.name, at.inside(), at.value(self.key), at.now)

    def to_xml(self, at: XmlExport) -> object:
        milliseconds = at.milliseconds(self.key)
        return at.element("Timeout", {"msec": milliseconds}) if milliseconds else super().to_xml(at)

    def from_xml(self, element: XmlImport) -> Words:
        if element.tag == self.xml_tag:
            return super().from_xml(element)
        (child,) = element.children()
        limit = element.duration("msec")
        return child if limit == "0 s" else element.wrap(child, self.key, limit)  # 0 sets no timer
