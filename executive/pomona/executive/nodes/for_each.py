"""For each: the same child once for each item of a list."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import (
    BuildContext,
    CheckContext,
    FlowContext,
    OutcomeContext,
    Words,
    XmlExport,
    XmlImport,
)
from pomona.executive.nodes.ends import Ends, Names, Outcome
from pomona.executive.nodes.node_type import Modifier
from pomona.executive.nodes.surroundings import Around, ForEachCount
from pomona.executive.reasons import NoValue


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

    key, symbol = "for_each", "∀"
    value = takes.Elements("a list; the node runs once for each item")
    fields: ClassVar[takes.Fields] = {"as": takes.NewName("for_each", "item", "name of the item, 'item' by default")}
    xml_value = "items"
    xml_fields: ClassVar[Mapping[str, str]] = {"as": "item"}

    def check_layer(self, at: CheckContext) -> None:
        if at.item() in at.around.items:
            message = f"the for_each around this one has an '{at.item()}' as well"
            key = at.node.modifiers.get("as", at.node.modifiers[self.key])[0]
            at.findings.error(key, "duplicate-name", message, "name this one: 'as: other'")
        super().check_layer(at)

    def around(self, at: CheckContext, index: int) -> Around:
        around = at.around
        return replace(around, counters=around.counters | {"for_each"}, items=around.items | {at.item()})

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome(at.inside().codes)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        return Ends(before, at.inside(before.plus(*at.outputs)).failure)

    def build(self, at: BuildContext) -> Behaviour:
        count = ForEachCount()
        items, give = at.value(self.key), at.writer(self.key)
        return ForEach(at.name, at.inside(for_each=count), items, give, count)

    def xml_attributes(self, at: XmlExport) -> dict[str, str]:
        return {"items": at.text(self.key), "item": f"{{{at.text('as') or 'item'}}}"}

    def from_xml(self, element: XmlImport) -> Words:
        (child,) = element.children()
        return element.wrap(child, self.key, element.value("items"), {"as": element.get("item").strip("{}")})
