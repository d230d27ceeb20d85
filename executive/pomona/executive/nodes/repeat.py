"""Loops: repeat while it succeeds, and for each item of a list."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import (
    Around,
    BuildContext,
    CheckContext,
    FlowContext,
    ForEachCount,
    NodeContext,
    OutcomeContext,
    RepeatCount,
)
from pomona.executive.nodes.facts import ALL, Ends, Names, Outcome
from pomona.executive.nodes.node_type import Modifier
from pomona.executive.reasons import NoValue
from pomona.executive.values.yaml_nodes import YamlScalar


class Repeat(Wrapper):
    """Runs its child until a number of successes; a failure ends it. Without a number it repeats for ever."""

    def __init__(
        self,
        name: str,
        child: Behaviour,
        rounds: Callable[[], int | None],
        count: RepeatCount | None = None,
    ) -> None:
        super().__init__(name, child)
        self._rounds, self._count = rounds, count or RepeatCount()
        self._of: int | None = 1

    def begin(self) -> Status | None:
        self._of = self._rounds()
        if self._of is not None and self._of < 1:
            raise NoValue(
                f"{self.name}: the number of rounds is {self._of}, but must be at least 1"
            )
        self._count.round = 1
        return None

    def after(self, status: Status) -> Status:
        of = "" if self._of is None else f" of {self._of}"
        self.feedback_message = f"round {self._count.round}{of}"
        if status is Status.SUCCESS and (self._of is None or self._count.round < self._of):
            self._count.round += 1
            return Status.RUNNING
        return status


class RepeatType(Modifier):
    """again while it succeeds"""

    key = "repeat"
    symbol = "↻"
    value = takes.count("number of rounds, or 'forever'", words=("forever",))
    other_names = ("Repeat", "KeepRunningUntilFailure")

    @staticmethod
    def forever(at: NodeContext) -> bool:
        """Return True if only a failure ends it."""
        written = at.written("repeat")
        return isinstance(written, YamlScalar) and written.text == "forever"

    def around(self, at: CheckContext, index: int) -> Around:
        return replace(at.around, counters=at.around.counters | {"repeat"})

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        inside = at.inside()
        return replace(inside, succeeds=False) if self.forever(at) else inside

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        return ends._replace(success=ALL) if self.forever(at) else ends

    def build(self, at: BuildContext) -> Behaviour:
        count = RepeatCount()
        child = at.inside(repeat=count)
        return Repeat(at.name, child, at.value(self.key), count)


class ForEach(Wrapper):
    """Runs its child once for each item, which it hands to the child by `give`; a failure ends it."""

    def __init__(
        self,
        name: str,
        child: Behaviour,
        items: Callable[[], Sequence[Any]],
        give: Callable[[Any], None],
        count: ForEachCount | None = None,
    ) -> None:
        super().__init__(name, child)
        self._read, self._give, self._count = items, give, count or ForEachCount()
        self._items: tuple[Any, ...] = ()

    def begin(self) -> Status | None:
        try:
            self._items = tuple(self._read())
        except TypeError as error:
            raise NoValue(f"{self.name}: the value of for_each is no list: {error}") from None
        self._count.index, self._count.of = 1, len(self._items)
        if not self._items:
            return Status.SUCCESS
        self._give(self._items[0])
        return None

    def after(self, status: Status) -> Status:
        self.feedback_message = f"item {self._count.index} of {self._count.of}"
        if status is Status.SUCCESS and self._count.index < self._count.of:
            self._count.index += 1
            self._give(self._items[self._count.index - 1])
            return Status.RUNNING
        return status

    def after_skipped(self) -> Status:
        return self.after(Status.SUCCESS)


class ForEachType(Modifier):
    """once for each item, which is written to `name` (`item` by default); an empty list succeeds"""

    key = "for_each"
    symbol = "∀"
    value = takes.Elements("a list; the node runs once for each item")
    fields: ClassVar[takes.Fields] = {
        "as": takes.NewName("for_each", "item", "name of the item, 'item' by default")
    }

    def check_layer(self, at: CheckContext) -> None:
        if at.item() in at.around.items:
            message = f"the for_each around this one has an '{at.item()}' as well"
            key = at.node.modifiers.get("as", at.node.modifiers[self.key])[0]
            at.findings.error(key, "duplicate-name", message, "name this one: 'as: other'")
        super().check_layer(at)

    def around(self, at: CheckContext, index: int) -> Around:
        around = at.around
        return replace(
            around, counters=around.counters | {"for_each"}, items=around.items | {at.item()}
        )

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome(at.inside().codes)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        return Ends(before, at.inside(before.plus(*at.outputs)).failure)

    def build(self, at: BuildContext) -> Behaviour:
        count = ForEachCount()
        items = at.value(self.key)
        give = at.writer(self.key)
        return ForEach(at.name, at.inside(for_each=count), items, give, count)
