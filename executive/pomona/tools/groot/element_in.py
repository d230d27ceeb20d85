"""An element of XML that is translated, with the attributes that have been read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pomona.executive.ports import TIME
from pomona.tools.groot.keys import KeyNames, NoEquivalentError
from pomona.tools.groot.names import GENERIC
from pomona.tools.groot.xml_nodes import XmlElement
from pomona.tools.groot.yaml_text import Written

Words = dict[str, Any]  # a node of a tree file as plain values, ready to be written

PRECONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
"""In the order in which BehaviorTree.CPP evaluates them."""
AFTERWARDS = ("_onSuccess", "_onFailure", "_post")
KNOWN = (
    "name",
    "_description",
    "_autoremap",
    "_fullpath",
    "_uid",
    "_onHalted",
    *PRECONDITIONS,
    *AFTERWARDS,
)
"""Attributes of every node."""


def is_port(name: str) -> bool:
    """Return True if BehaviorTree.CPP takes an attribute for a port."""
    return not name.startswith(("_", "xml:", "xmlns")) and name != "name"


@dataclass(slots=True)
class ElementIn:
    """An element that is translated. Its children are translated when they are first asked for."""

    found: XmlElement
    keys: KeyNames
    translate: Callable[[XmlElement], Words]
    asked: set[str] = field(default_factory=set)  # attributes that were read
    read: list[Words] | None = None

    @property
    def tag(self) -> str:
        """The name of the node."""
        return self.get("ID") if self.found.tag in GENERIC else self.found.tag

    def get(self, name: str, default: str = "") -> str:
        """Return an attribute's text."""
        self.asked.add(name)
        return self.found.get(name) or default

    def value(self, name: str, default: str = "") -> Written:
        """Return an attribute with the key in it as it is called here."""
        return Written(self.keys.wired(self.get(name, default), name))

    def duration(self, name: str) -> Written:
        """Return an attribute in milliseconds as a duration.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        text = self.value(name)
        if text.startswith("{"):
            return Written(f"{text} * 1 ms")
        if not (text.isascii() and text.isdecimal() and len(text) <= 12):
            raise NoEquivalentError(
                f'has {name}="{text}", which is no whole number of milliseconds', "correct it"
            )
        return Written(TIME.format(int(text) * 1e-3))

    def count(self, name: str) -> Written:
        """Return an attribute as a number of times.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        text = self.value(name)
        if not text.startswith("{") and not (
            text.isascii() and text.isdecimal() and text.strip("0")
        ):
            raise NoEquivalentError(
                f'has {name}="{text}"; how often its child runs is a whole number above 0, or -1',
                "correct it",
            )
        return text

    def flag(self, name: str) -> bool:
        """Return an attribute that is true or false.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        text = self.get(name, "false")
        if text.lower() not in ("true", "false", "1", "0"):
            raise NoEquivalentError(
                f'has {name}="{text}", which is neither true nor false', "correct it"
            )
        return text.lower() in ("true", "1")

    def children(self, *numbers: int) -> list[Words]:
        """Return the element's children, translated. Raises NoEquivalentError: there are others than these numbers."""
        if self.read is None:
            self.read = [self.translate(child) for child in self.found.children]
        count = len(self.read)
        if count not in numbers if numbers else not count:
            raise NoEquivalentError(
                f"has {count} children instead of {' or '.join(map(str, numbers)) or 'some'}",
                "correct it",
            )
        return self.read

    def ports(self) -> Words:
        """Return all attributes that are ports."""
        names = [n for n in self.found.attributes if is_port(n) and n != "ID"]
        return {name: self.value(name) for name in names}

    def require_no_more(self) -> None:
        """Refuse attributes that were not read and that BehaviorTree.CPP would take for ports.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        unknown = [
            name for name in self.found.attributes if is_port(name) and name not in self.asked
        ]
        if unknown:
            known = ", ".join(sorted(name for name in self.asked if is_port(name))) or "none"
            raise NoEquivalentError(
                f"has no port '{unknown[0]}'; it takes {known}",
                "remove it, or write its right name",
            )
