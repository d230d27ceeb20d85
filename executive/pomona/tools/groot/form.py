"""A word's form in XML: by default an element of Pomona with every word as an attribute."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar
from xml.etree.ElementTree import Element

from pomona.executive.nodes.node_type import NodeType
from pomona.tools.groot.element_in import ElementIn, Words

if TYPE_CHECKING:
    from pomona.tools.groot.export_xml import LayerXml


class XmlForm:
    """The form of one word.

    Attributes:
        word: the word.
        attribute: carries the word's value; unused when nodes stand there.
        names: attributes of the word's fields, where they have another name.
    """

    attribute: ClassVar[str] = "value"
    names: ClassVar[Mapping[str, str]] = {}

    def __init__(self, word: NodeType) -> None:
        self.word = word

    @property
    def own_tag(self) -> str:
        """The element that stands for the word where BehaviorTree.CPP has none."""
        return "Pomona" + "".join(part.capitalize() for part in self.word.key.split("_"))

    def to_xml(self, at: LayerXml) -> Element:
        """Return the element of a layer."""
        return at.own(self.attributes(at))

    def attributes(self, at: LayerXml) -> dict[str, str]:
        """Return a layer's words by the attributes that carry them."""
        found: dict[str, str] = {}
        for slot, taken in self.word.slots.items():
            if taken.nodes:
                continue
            if taken.wires:
                found.update(at.ports())
            elif text := at.text(slot):
                found[self.name(slot)] = text
        return found

    def name(self, slot: str) -> str:
        """Return the attribute that carries a word."""
        return self.attribute if slot == self.word.key else self.names.get(slot, slot)

    def from_xml(self, element: ElementIn) -> Words:
        """Return the words of an element of Pomona, or of one with another of the word's names."""
        words: Words = {}
        for slot, taken in self.word.fields.items():
            if not taken.nodes and (value := element.value(self.name(slot))) not in ("", None):
                words[slot] = value
        children = element.children()
        if self.word.role == "modifier":
            parts = [slot for slot, taken in self.word.fields.items() if taken.nodes]
            words.update(zip(parts, children[1:], strict=False))
            return element.wrap(children[0], self.word.key, element.value(self.attribute), words)
        field = self.word.value
        value = (
            children
            if field.nodes
            else element.ports()
            if field.wires
            else element.value(self.attribute)
        )
        return {self.word.key: value, **words}
