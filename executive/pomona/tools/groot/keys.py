"""Blackboard keys of BehaviorTree.CPP → names of tree files: small letters, and no two become one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from pomona.executive.language.expression import SPECIAL
from pomona.tools.groot.names import LITERAL, free_name, in_ascii

NAME = re.compile(r"[a-z][a-z0-9_]*")
_NUMBER = re.compile(r"-?\d+\.?\d*([eE][-+]?\d+)?")


class NoEquivalentError(ValueError):
    """An element without an equivalent in a tree file; the text follows the element's name in a sentence."""

    def __init__(self, why: str, hint: str = "write it with other nodes") -> None:
        self.hint = hint
        super().__init__(why)


@dataclass(frozen=True, slots=True)
class GivenText:
    """The constant behind a key of a subtree that is called with a text instead of a key."""

    text: str

    @property
    def expression(self) -> str:
        """As a part of an expression.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        if _NUMBER.fullmatch(self.text) or self.text in ("true", "false"):
            return self.text
        if "'" in self.text:
            raise NoEquivalentError(f"uses the text {self.text}, which no expression can hold")
        return f"'{self.text}'"


def key_in(text: str, port: str) -> str | None:
    """Return the key that an attribute of BehaviorTree.CPP stands for, which `{=}` names after its port; else None."""
    if text in ("{=}", "="):
        return port
    inner = text.strip(" ")
    return inner[1:-1] if len(inner) >= 3 and inner[0] == "{" and inner[-1] == "}" else None


@dataclass(slots=True)
class KeyNames:
    """Names of the keys of one tree, and of the subtrees that are written out in it."""

    taken: set[str]  # names that no other key gets, of the whole file
    outer: KeyNames | None = None  # the caller's, for a subtree that is written out
    wires: Mapping[str, str | GivenText] = field(
        default_factory=dict
    )  # the caller's keys, constants
    shares: bool = False  # whether the other keys are the caller's, too (`_autoremap`)
    prefix: str = ""  # of this subtree's own keys
    given: dict[str, str] = field(default_factory=dict)

    def meaning(self, key: str) -> str | GivenText:
        """Return a key's name here, or the constant that stands for it."""
        if key.startswith("@"):  # of the main tree
            return self.main.meaning(key[1:])
        if self.outer is not None and key in self.wires:
            wired = self.wires[key]
            return wired if isinstance(wired, GivenText) else self.outer.meaning(wired)
        if self.outer is not None and self.shares and not key.startswith("_"):
            return self.outer.meaning(key)
        if key not in self.given:
            self.given[key] = self._fresh(key)
        return self.given[key]

    @property
    def main(self) -> KeyNames:
        """The names of the outermost tree."""
        return self if self.outer is None else self.outer.main

    def _fresh(self, key: str) -> str:
        if self.outer is None and NAME.fullmatch(key) and key not in SPECIAL:
            return key
        small = re.sub(r"[^a-z0-9_]", "_", in_ascii(key).lower()).lstrip("_0123456789") or "port"
        found = free_name(f"{self.prefix}{small}", self.taken.__contains__, "_")
        self.taken.add(found)
        return found

    def target(self, key: str) -> str:
        """Return the name that a key's value is written to.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        found = self.meaning(key)
        if isinstance(found, GivenText):
            raise NoEquivalentError(f"writes '{key}', which the caller gives as a text")
        return found

    def read(self, key: str) -> str:
        """Return a key in an expression."""
        found = self.meaning(key)
        return found.expression if isinstance(found, GivenText) else f"{{{found}}}"

    def wired(self, text: str, port: str) -> str:
        """Return an attribute with the key in it as it is called here, or the constant that stands for the key.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        key = key_in(text, port)
        found = GivenText(text) if key is None else self.meaning(key)
        if not isinstance(found, GivenText):
            return f"{{{found}}}"
        if "{" in found.text or "}" in found.text or found.text.startswith(LITERAL):
            why = (
                f"has the text '{found.text}', whose signs would mean something else in a tree file"
            )
            raise NoEquivalentError(why)
        return found.text
