"""An element of XML that a word's form reads, with the attributes that have been read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from pomona.executive.ports import TIME
from pomona.tools.groot.files import Forest
from pomona.tools.groot.keys import KeyNames, ScriptError, key_in
from pomona.tools.groot.names import LITERAL
from pomona.tools.groot.xml_nodes import XmlElement
from pomona.tools.groot.yaml_text import YamlText

Words = dict[str, Any]  # a node of a tree file as plain values, ready to be written

ATTRIBUTES = ("name", "ID", "_description", "_autoremap", "_fullpath", "_uid")
PRECONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
"""In the order in which BehaviorTree.CPP evaluates them."""
AFTERWARDS = ("_onSuccess", "_onFailure", "_post")
_RESERVED = {
    _name.strip("_").lower(): _name
    for _name in (*ATTRIBUTES, *PRECONDITIONS, *AFTERWARDS, "_onHalted")
}


def is_port(name: str) -> bool:
    """Return True if BehaviorTree.CPP takes an attribute for a port."""
    return name not in ATTRIBUTES and not name.startswith(("_", "xml:", "xmlns"))


def meant(name: str) -> str:
    """Return the attribute of every node that another one looks like; empty if it looks like none."""
    found = _RESERVED.get(name.replace("_", "").lower(), "")
    return "" if found == name else found


class Importer(Protocol):
    """The reader of a whole file, as an element needs it."""

    forest: Forest
    keys: KeyNames

    def node(self, element: XmlElement) -> Words:
        """Return the node of an element."""

    def untranslated(
        self,
        element: XmlElement,
        name: str,
        attributes: Words,
        children: list[Words],
        why: str,
        hint: str = "",
    ) -> Words:
        """Return a placeholder that `check` refuses."""

    def modified(self, child: Words, name: str, value: object, more: Words) -> Words:
        """Return the child with one more modifier."""


@dataclass(slots=True)
class ElementIn:
    """An element that a word's form reads. Its children are read when they are first asked for."""

    importer: Importer
    found: XmlElement
    tag: str
    wrapped: bool = False
    asked: set[str] = field(default_factory=set)  # attributes that were read
    read: list[Words] | None = None

    @property
    def attributes(self) -> Mapping[str, str]:
        """All attributes of the XML element."""
        return self.found.attributes

    @property
    def unread(self) -> list[str]:
        """Attributes that BehaviorTree.CPP would take for ports, and that were not read."""
        return [name for name in self.found.attributes if is_port(name) and name not in self.asked]

    def get(self, name: str) -> str:
        """Return an attribute's text; empty when it is missing."""
        self.asked.add(name)
        return self.found.get(name)

    def wired(self, name: str) -> str:
        """Return an attribute's text with the keys in it as they are called here.

        Raises ScriptError: it has braces and is no key, which would mean something else in a tree file.
        """
        text, keys = self.get(name), self.importer.keys
        if self.importer.forest.is_exported(self.found):
            return keys.wired(f"{{{name}}}" if text == "{=}" else text)
        key = key_in(text, name)
        if key is not None:
            return keys.wired_key(key)
        if "{" in text or "}" in text:
            raise ScriptError(
                f"has the text '{text}', whose braces would stand for a key in a tree file"
            )
        return text

    def value(self, name: str) -> object:
        """Return an attribute in the form of tree files."""
        return value_of(self.wired(name))

    def duration(self, name: str) -> str:
        """Return an attribute in milliseconds as a duration. Raises ScriptError: it is none."""
        text = self.wired(name)
        if text.startswith("{"):
            return f"{text} * 1 ms"
        if not (text.isascii() and text.isdecimal() and len(text) <= 12):
            raise ScriptError(f'has {name}="{text}", which is no whole number of milliseconds')
        return TIME.format(int(text) * 1e-3)

    def count(self, name: str) -> object:
        """Return an attribute as a number of times. Raises ScriptError: BehaviorTree.CPP would not run the child."""
        text = self.wired(name)
        if not text.startswith("{") and not (
            text.isascii() and text.isdecimal() and text.strip("0")
        ):
            raise ScriptError(
                f'has {name}="{text}"; how often its child runs is a whole number above 0, or -1'
            )
        return text

    def children(self) -> list[Words]:
        """Return the element's children, translated."""
        if self.read is None:
            self.read = [self.importer.node(child) for child in self.found.children]
        return self.read

    def ports(self) -> Words:
        """Return all attributes that are ports."""
        return {name: self.value(name) for name in self.found.attributes if is_port(name)}

    def untranslated(self, message: str, hint: str = "write it with other nodes") -> Words:
        """Return an `untranslated` node that keeps the children and all attributes."""
        self.wrapped = False
        self.asked.update(self.found.attributes)
        kept = {
            n: v for n, v in self.found.attributes.items() if n != "name" and not n.startswith("_")
        }
        if kept.get("ID") == self.tag:
            del kept["ID"]
        return self.importer.untranslated(
            self.found, self.tag, kept, self.children(), message, hint
        )

    def wrap(self, child: Words, word: str, value: object, more: Words | None = None) -> Words:
        """Return a node with one more modifier."""
        self.wrapped = True
        return self.importer.modified(child, word, value, more or {})


def value_of(text: str) -> object:
    """Return an attribute's text, or the list or mapping that Pomona's export has written into it."""
    return YamlText(text.removeprefix(LITERAL)) if text.startswith(LITERAL) else text
