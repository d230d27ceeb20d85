"""Blackboard keys of BehaviorTree.CPP → names of tree files: small letters, and no two become one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from pomona.executive.language.expression import SPECIAL
from pomona.tools.groot.names import LITERAL, in_ascii

NAME = re.compile(r"[a-z][a-z0-9_]*")
_NUMBER = re.compile(r"-?\d+\.?\d*([eE][-+]?\d+)?")
_WIRE = re.compile(r"\{(\w+)\}")


class ScriptError(ValueError):
    """A script without an equivalent expression; the text ends a sentence about it."""


@dataclass(frozen=True, slots=True)
class GivenText:
    """The constant behind a key of a subtree that is called with a text instead of a key."""

    text: str

    @property
    def expression(self) -> str:
        """As a part of an expression. Raises ScriptError: expressions have no quotes for it."""
        if _NUMBER.fullmatch(self.text) or self.text in ("true", "false"):
            return self.text
        if "'" in self.text:
            raise ScriptError(f"uses the text {self.text}")
        return f"'{self.text}'"


def small(name: str) -> str:
    """Return a name of small letters."""
    return re.sub(r"[^a-z0-9_]", "_", in_ascii(name).lower()).lstrip("_0123456789") or "port"


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
    )  # the caller's wiring: its keys, or constants
    shares: bool = False  # whether the other keys are the caller's, too (`_autoremap`)
    private: bool = True  # whether those with `_` in front never are; version 3 shares them
    prefix: str = ""  # of this subtree's own keys
    given: dict[str, str] = field(default_factory=dict)

    def meaning(self, key: str) -> str | GivenText:
        """Return a key's name here, or the constant that stands for it."""
        if key.startswith("@"):  # of the main tree
            return self.main.meaning(key[1:])
        if self.outer is not None and key in self.wires:
            wired = self.wires[key]
            return wired if isinstance(wired, GivenText) else self.outer.meaning(wired)
        if self.outer is not None and self.shares and not (self.private and key.startswith("_")):
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
        start = f"{self.prefix}{small(key)}"
        number, found = 1, start
        while found in self.taken:
            number += 1
            found = f"{start}_{number}"
        self.taken.add(found)
        return found

    def target(self, key: str) -> str:
        """Return the name that a key's value is written to.

        Raises ScriptError: the key is a constant of the caller's.
        """
        found = self.meaning(key)
        if isinstance(found, GivenText):
            raise ScriptError(f"writes '{key}', which the caller gives as a text")
        return found

    def read(self, key: str) -> str:
        """Return a key in an expression. Raises ScriptError: expressions have no words for it."""
        found = self.meaning(key)
        return found.expression if isinstance(found, GivenText) else f"{{{found}}}"

    def wired_key(self, key: str) -> str:
        """Return an attribute that is a key: its name here in braces, or the constant that stands for it.

        Raises ScriptError: the constant has braces, which would stand for a key.
        """
        found = self.meaning(key)
        if not isinstance(found, GivenText):
            return f"{{{found}}}"
        if "{" in found.text or "}" in found.text:
            raise ScriptError(
                f"reads the text '{found.text}', whose braces would stand for a key in a tree file"
            )
        return found.text

    def wired(self, text: str) -> str:
        """Return an attribute that Pomona has written with the keys in it as they are called here."""
        if text.startswith(LITERAL):
            return text
        whole = _WIRE.fullmatch(text)
        return (
            self.wired_key(whole[1])
            if whole is not None
            else _WIRE.sub(lambda wire: self.read(wire[1]), text)
        )
