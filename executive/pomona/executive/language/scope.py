"""Meaning of the names in one definition: parameters, constants, the interface's ports and its nodes' outputs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from pomona.executive.language.expression import Expression
from pomona.executive.language.model import Definition, TreeNode
from pomona.executive.language.value_types import ValueType
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Located
from pomona.executive.values.yaml_nodes import YamlNode

Origin = Literal["parameter", "constant", "input", "written"]


@dataclass(slots=True, eq=False)
class Named:
    """One name in a definition's scope."""

    type: ValueType  # of its value
    origin: Origin  # where it comes from
    where: Located  # where it is declared or first written
    by: str = ""  # display name of the node that first writes it
    value: Any = None  # of a parameter or a constant
    may_be_none: bool = False  # an optional input of a subtree
    read: bool = False  # whether anything reads it


class Given(NamedTuple):
    """A value that is known before the run."""

    value: Any
    where: YamlNode


class ComputedValue(NamedTuple):
    """A value that an expression gives when its node starts."""

    expression: Expression
    type: ValueType
    text: str
    where: YamlNode


Value = Given | ComputedValue


class Read(NamedTuple):
    """A name that a layer of a node reads, for one of its ports or words (`slot`)."""

    slot: str
    name: str
    where: Located
    required: bool


@dataclass(slots=True, eq=False)
class Resolved:
    """A layer of a node (its type, or a modifier) with every name looked up: all that building it needs."""

    node: TreeNode
    skill: type[Skill] | None = None
    subtree: Definition | None = None
    inputs: dict[str, Value] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    settings: dict[str, Value] = field(default_factory=dict)
    reads: list[Read] = field(default_factory=list)

    def setting(self, name: str, default: Any) -> Any:
        """Return a setting that is known before the run."""
        value = self.settings.get(name)
        return value.value if isinstance(value, Given) else default


@dataclass(slots=True, eq=False)
class Scope:
    """All names of one definition."""

    definition: Definition  # the owner of the names
    names: dict[str, Named] = field(default_factory=dict)  # each with its meaning
    looks: bool = False  # whether a node evaluates a condition
    skills: Registry = field(default_factory=lambda: Registry({}))  # that the tree may use

    def written(self) -> Iterator[tuple[str, Named]]:
        return ((name, named) for name, named in self.names.items() if named.origin == "written")
