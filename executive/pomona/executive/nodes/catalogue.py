"""All words of the language: those that come with it, and those of other packages."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import get_args

from pomona.executive.errors import PomonaError
from pomona.executive.nodes.ask import ApproveType, AskType
from pomona.executive.nodes.check import CheckType, GuardType, WaitUntilType, WhenType
from pomona.executive.nodes.choosing import IfType, ReactiveIfType, SwitchType
from pomona.executive.nodes.composites import (
    ParallelType,
    ReactiveSequenceType,
    SequenceType,
    SequenceWithMemoryType,
)
from pomona.executive.nodes.force import ForceType, InvertType
from pomona.executive.nodes.leaves import FailType, SetType, SucceedType, WaitType
from pomona.executive.nodes.node_type import Field, Modifier, NodeType, Role
from pomona.executive.nodes.pacing import DelayType, RateType, RunOnceType, SpeedType, TimeoutType
from pomona.executive.nodes.repeat import ForEachType, RepeatType
from pomona.executive.nodes.retry import FallbackType, ReactiveFallbackType, RetryType
from pomona.executive.nodes.takes import NAME
from pomona.executive.nodes.working import BreakpointType, DisabledType
from pomona.executive.values.installation import entry_points
from pomona.executive.values.removed import import_problem

GROUP = "pomona.nodes"  # entry point group of node types: word → class

BUILTIN: tuple[type[NodeType], ...] = (
    SequenceType, ReactiveSequenceType, SequenceWithMemoryType, FallbackType, ReactiveFallbackType, ParallelType,
    IfType, ReactiveIfType, SwitchType,
    CheckType, WaitUntilType, WaitType, SetType, AskType, SucceedType, FailType,
    SpeedType, TimeoutType, ApproveType, BreakpointType, InvertType, ForceType, DelayType, RateType, RetryType,
    RepeatType, ForEachType, RunOnceType, GuardType, WhenType, DisabledType,
)  # fmt: skip
"""Modifiers stand in the order in which they wrap, from the inside to the outside."""

RESERVED = frozenset(
    {"name", "description", "skill", "subtree"}
)  # words that mean something else in every node


class NodeTypeError(PomonaError):
    """A node type that is not complete, or whose words are taken."""


class NodeTypes(Mapping[str, NodeType]):
    """Node types by their words.

    Attributes:
        problems: types that are installed and cannot be used, with the reason.
        modifiers: those that wrap others, from the inside to the outside.
    """

    def __init__(self, types: Iterable[type[NodeType]] = BUILTIN) -> None:
        self.problems: dict[str, str] = {}
        self.modifiers: list[Modifier] = []
        self._types: dict[str, NodeType] = {}
        self._owners: dict[str, list[NodeType]] = {}
        self._elsewhere: dict[str, NodeType] = {}
        for cls in types:
            self.register(cls)

    @classmethod
    @cache
    def installed(cls) -> NodeTypes:
        """Return the language's own and those that installed packages offer; a broken one is reported, not raised."""
        types = cls()
        for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
            try:
                types.register(point.load())
            except NodeTypeError as error:
                types.problems[point.name] = str(error)
            except Exception as error:  # a third party's module and class may raise anything
                types.problems[point.name] = (
                    f"{point.value} cannot be used: {import_problem(error)}"
                )
        return types

    def register(self, cls: type[NodeType]) -> None:
        """Add a type. Raises NodeTypeError: it lacks a required attribute, or a word or name of it is taken."""
        missing = incomplete(cls)
        if missing:
            raise NodeTypeError(f"node type {getattr(cls, '__name__', cls)} {missing}")
        made = cls()
        for word in made.slots:
            if word in RESERVED or word in self._types or self._ambiguous(made, word):
                raise NodeTypeError(f"node type {cls.__name__}: the word '{word}' is taken")
        for name in made.other_names:
            if name in self._elsewhere:
                raise NodeTypeError(
                    f"node type {cls.__name__}: the name '{name}' belongs to '{self._elsewhere[name].key}'"
                )
        if isinstance(made, Modifier):
            self.modifiers.insert(self._place(made), made)
        self._types[made.key] = made
        for word in made.fields:
            self._owners.setdefault(word, []).append(made)
        self._elsewhere.update(dict.fromkeys(made.other_names, made))

    def _ambiguous(self, made: NodeType, word: str) -> bool:
        """Return True if two types could claim the word: only types that exclude each other may share a field."""
        owners = self.owners(word)
        return bool(owners) and (
            word == made.key or any(isinstance(each, Modifier) for each in (made, *owners))
        )

    def _place(self, modifier: Modifier) -> int:
        if not modifier.outside_of:
            return len(self.modifiers)
        keys = [other.key for other in self.modifiers]
        if modifier.outside_of not in keys:
            raise NodeTypeError(
                f"node type {type(modifier).__name__}: no modifier named '{modifier.outside_of}'"
            )
        return keys.index(modifier.outside_of) + 1

    def __getitem__(self, word: str) -> NodeType:
        return self._types[word]

    def __iter__(self) -> Iterator[str]:
        return iter(self._types)

    def __len__(self) -> int:
        return len(self._types)

    @property
    def composites(self) -> tuple[str, ...]:
        """Words of types with children."""
        return tuple(word for word, found in self._types.items() if found.role == "composite")

    @property
    def leaves(self) -> tuple[str, ...]:
        """Words of types without."""
        return tuple(word for word, found in self._types.items() if found.role == "leaf")

    @property
    def beside(self) -> tuple[str, ...]:
        """Words that stand beside any type: modifiers and their fields."""
        fields = [word for modifier in self.modifiers for word in modifier.fields]
        return (*(modifier.key for modifier in self.modifiers), *fields)

    def owners(self, word: str) -> list[NodeType]:
        """Return the types to which a field belongs."""
        return self._owners.get(word, [])

    @property
    def fields(self) -> tuple[str, ...]:
        """Words of all fields."""
        return tuple(self._owners)

    def known_elsewhere(self, word: str) -> NodeType | None:
        """Return the type that other libraries call by this word, in capitals or not."""
        word = word.replace("_", "").lower()
        names = {name.lower(): found for name, found in self._elsewhere.items()}
        return names.get(word, self._types.get("fallback") if word == "selector" else None)


def incomplete(cls: object) -> str:
    """Describe why a class is no node type, as the end of a sentence; return an empty text if it is one."""
    if not (isinstance(cls, type) and issubclass(cls, NodeType)):
        return "is no NodeType"
    if inspect.isabstract(cls):
        return "lacks " + ", ".join(sorted(cls.__abstractmethods__))
    if hasattr(cls, "xml_tags"):
        return "has xml_tags, which are called other_names now"
    lacking = [name for name in ("key", "symbol", "role", "value") if not hasattr(cls, name)]
    if not (cls.__dict__.get("__doc__") or "").strip():
        lacking.append("a docstring")
    if lacking:
        return "lacks " + ", ".join(lacking)
    if not (isinstance(cls.key, str) and NAME.fullmatch(cls.key)):
        return f"has the word {cls.key!r}: lower-case letters, digits and _"
    if not (isinstance(cls.symbol, str) and len(cls.symbol) == 1):
        return f"has the symbol {cls.symbol!r}: a text of one character"
    if cls.role not in get_args(Role):
        return f"has the role {cls.role!r}: one of {', '.join(get_args(Role))}"
    if (cls.role == "modifier") != issubclass(cls, Modifier):
        return "is a modifier and no Modifier"
    if not (isinstance(cls.fields, Mapping) and all(isinstance(word, str) for word in cls.fields)):
        return "has fields that are no mapping from words to a Field"
    slots = {cls.key: cls.value, **cls.fields}
    wrong = [
        word
        for word, taken in slots.items()
        if not isinstance(taken, Field) or not NAME.fullmatch(word)
    ]
    if wrong:
        return f"has no Field for {', '.join(wrong)}"
    try:
        cls()
    except Exception as error:  # a third party's class may raise anything
        return f"cannot be made without arguments: {type(error).__name__}: {error}"
    return ""
