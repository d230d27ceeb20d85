"""Places of the names of a tree, for renaming and for going to a definition."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from pomona.executive.language.check import Analysis
from pomona.executive.language.model import Definition, Document, TreeFile, TreeNode
from pomona.executive.nodes.takes import Assignments
from pomona.executive.values.findings import Located, Spot
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar


class RenameRefused(ValueError):
    """A name that cannot be given, and why."""


def spots_of_name(analysis: Analysis, definition: Definition, name: str) -> Iterator[Spot]:
    """Yield every place of a name: in braces, where it is declared, and where callers wire it."""
    document = analysis.document
    file = definition.file
    shared = name in file.parameters and name not in definition.inputs
    inside = [d for d in document.definitions() if d.file is file] if shared else [definition]
    declared = [
        table[name].key for table in (file.parameters, file.constants) if shared and name in table
    ]
    declared += [
        t[name].key for t in (definition.inputs, definition.outputs, file.constants) if name in t
    ]
    for key in {id(key): key for key in declared}.values():
        yield _spot(key)
    for node in nodes_of(inside):
        yield from _spots_in_node(analysis, node, name)
    if declared_in(definition, name) is not None:
        for node in _calls(document, definition):
            if name in node.ports:
                yield _spot(node.ports[name][0])


def spots_in_calls(document: Document, path: str, name: str) -> Iterator[Spot]:
    """Where a document wires a port of the tree in another file."""
    for definition in document.definitions():
        if definition.main and definition.file.source.path == path:
            yield from (
                _spot(node.ports[name][0])
                for node in _calls(document, definition)
                if name in node.ports
            )


def spots_of_subtree(document: Document, name: str) -> Iterator[Spot]:
    """Yield every place of the name by which the main file calls a subtree."""
    for key, _ in _entries(document.main, name):
        yield _spot(key)
    for node in nodes_of(d for d in document.definitions() if d.file is document.main):
        if node.type.calls and node.key.text == name:
            yield _spot(node.key)


def nodes_of(definitions: Iterable[Definition]) -> Iterator[TreeNode]:
    """Yield the nodes of definitions, those that could be read."""
    for definition in definitions:
        if definition.root is not None:
            yield from definition.root.walk()


def declared_in(definition: Definition, name: str) -> YamlScalar | None:
    """Where a port is declared that callers wire; None when there is no such port."""
    tables = [definition.inputs, definition.outputs]
    if definition.main:
        tables.append(definition.file.parameters)
    return next((table[name].key for table in tables if name in table), None)


def key_of(definition: Definition) -> Located:
    """Where a subtree's name is written; of another file its beginning."""
    for key, value in _entries(definition.file, definition.name):
        if value is definition.at:
            return key
    return definition.at


def order(spot: Spot) -> tuple[str, int, int]:
    """By file and place."""
    return spot.source.path, spot.line, spot.column


def _spots_in_node(analysis: Analysis, node: TreeNode, name: str) -> Iterator[Spot]:
    """Yield the places of a name in the keys and values of one node."""
    below = {id(child.at) for child in node.below()}
    for scalar in _scalars(node.at, below):
        for number in range(scalar.line, scalar.end_line + 1):
            for found in re.finditer(
                rf"\{{\s*({name})\b(?=[^{{}}]*\}})", scalar.source.excerpt(number)
            ):
                inside = number != scalar.line or found.start(1) + 1 >= scalar.column
                if inside and (number != scalar.end_line or found.end(1) < scalar.end_column):
                    yield Spot(scalar.source, number, found.start(1) + 1, len(name))
    for layer in node.layers:
        resolved = analysis.resolved.get((id(node), layer.key))
        for slot, target in resolved.outputs.items() if resolved is not None else ():
            entry = node.entry(layer, slot)
            assigns = isinstance(layer.value, Assignments)
            own = node.ports[slot][0] if assigns and slot in node.ports else entry and entry[1]
            written = [own] if assigns else [e[1] for e in node.modifiers.values()]
            for key in written:
                if target == name and isinstance(key, YamlScalar) and key.text == name:
                    yield _spot(key)


def _spot(key: YamlScalar) -> Spot:
    return Spot(key.source, key.line, key.text_column, len(key.text))


def _entries(file: TreeFile, name: str) -> Iterator[tuple[YamlScalar, YamlNode]]:
    subtrees = None if file.top is None else file.top.get("subtrees")
    if isinstance(subtrees, YamlMapping) and name in subtrees.entries:
        yield subtrees.entries[name]


def _calls(document: Document, definition: Definition) -> Iterator[TreeNode]:
    for node in nodes_of(document.definitions()):
        if node.type.calls and document.called(node) is definition:
            yield node


def _scalars(node: YamlNode, below: set[int]) -> Iterator[YamlScalar]:
    """Scalars in a value, without those that belong to nodes below."""
    if id(node) in below:
        return
    if isinstance(node, YamlScalar):
        yield node
    elif isinstance(node, YamlList):
        for item in node.items:
            yield from _scalars(item, below)
    elif isinstance(node, YamlMapping):
        for _, value in node.entries.values():
            yield from _scalars(value, below)
