"""Inputs of each use of a skill that are known before the run: literals, parameters, constants, defaults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pomona.executive.language.check import Analysis
from pomona.executive.language.expression import Reference
from pomona.executive.language.model import Definition, TreeNode
from pomona.executive.language.scope import ComputedValue, Given, Value
from pomona.executive.ports import Ports
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Located


@dataclass(frozen=True, slots=True)
class Known:
    """A value that an input has in every run, and where it is written (the node, for a default)."""

    value: Any
    where: Located


@dataclass(frozen=True, slots=True)
class Use:
    """One skill in the tree, as one call of its subtree gives it its inputs."""

    node: TreeNode
    skill: type[Skill]
    known: Mapping[str, Known]


def uses_of_skills(analysis: Analysis) -> Iterator[Use]:
    """Yield every skill of the main tree and of the subtrees that it calls, once for each call.

    Errors in other parts of the tree do not matter, unless the tree has no end. Unreadable inputs are unknown.
    """
    main = analysis.document.main.main
    if main is not None and analysis.finite:
        yield from _uses(analysis, main, {})


def _uses(analysis: Analysis, definition: Definition, names: Mapping[str, Known]) -> Iterator[Use]:
    for node in definition.root.walk() if definition.root is not None else ():
        found = analysis.resolved.get((id(node), node.type.key))
        if found is None:
            continue
        if found.skill is not None:
            ports = found.skill.inputs
        elif found.subtree is not None:
            ports = Ports(**analysis.interfaces[id(found.subtree)].inputs)
        else:
            continue
        given = {n: _known(value, names) for n, value in found.inputs.items() if n in ports}
        known = {n: v for n, v in given.items() if v is not None and ports[n].accepts(v.value)}
        defaults = {n: Known(port.default_value, node.key) for n, port in ports.items() if n not in node.ports}
        if found.skill is not None:
            yield Use(node, found.skill, {**defaults, **known})
        elif found.subtree is not None:
            yield from _uses(analysis, found.subtree, {**defaults, **known})


def _known(value: Value, names: Mapping[str, Known]) -> Known | None:
    if isinstance(value, Given):
        return Known(value.value, value.where)
    if isinstance(value, ComputedValue) and isinstance(value.expression, Reference):
        found = names.get(value.expression.name)
        return None if found is None else Known(found.value, value.where)
    return None
