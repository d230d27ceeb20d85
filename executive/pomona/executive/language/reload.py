"""Which changes of a tree file a paused run takes over, and why not the others: literal inputs of skills to come."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import NamedTuple, NoReturn

from py_trees.common import Status

from pomona.executive.errors import PomonaError
from pomona.executive.language.built import BuiltTree
from pomona.executive.language.changes import changed_input
from pomona.executive.language.model import Document
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar


class ReloadRefusedError(PomonaError):
    """A change of the file that the run does not take over; nothing was taken over."""


class InputChange(NamedTuple):
    """A new literal for an input of a skill, as the file has it."""

    path: str
    port: str
    text: str


def taken_over(running: BuiltTree, fresh: BuiltTree) -> tuple[InputChange, ...]:
    """Return the inputs to change, so that a run goes on with a changed file.

    Comments and layout may differ. Every node keeps its state, since only skills that have not started in the present
    pass get other values.

    Raises ReloadRefusedError: with file, line and reason of another change; ChangeRefusedError: a value does not fit.
    """
    old, new = running.document, fresh.document
    if old is None or new is None:
        raise ReloadRefusedError("this run has no tree file")
    inputs = {id(value) for document in (old, new) for value in _inputs(document)}
    for before, after in zip(old.files, new.files, strict=False):
        _compare(before.top, after.top, inputs)
    found = []
    for was, now in zip(running.nodes, fresh.nodes, strict=True):
        for port, text in now.inputs.items():
            given = was.inputs.get(port, "")
            if text == given:
                continue
            place = f"{now.file}:{now.line}: {port} of {now.name} has changed"
            if running.behaviours[was.path].status is not Status.INVALID:
                raise ReloadRefusedError(f"{place}, but this node has started in the present pass")
            if "{" in text + given:
                raise ReloadRefusedError(f"{place}, but a wire is taken over by a new run only")
            changed_input(running, was.path, port, text)
            found.append(InputChange(was.path, port, text))
    return tuple(found)


def difference(running: BuiltTree, fresh: BuiltTree) -> str:
    """Return the changed lines of the tree's files, as a unified diff without context; empty without a change."""
    old, new = ([] if tree.document is None else tree.document.files for tree in (running, fresh))
    lines: list[str] = []
    for before, after in zip(old, new, strict=False):
        name = before.source.path
        lines += difflib.unified_diff(before.source.lines, after.source.lines, name, name, n=0, lineterm="")
    return "\n".join(lines)


def _inputs(document: Document) -> Iterator[YamlNode]:
    """Yield the values of the ports of all skills."""
    for definition in document.definitions():
        for node in definition.root.walk() if definition.root is not None else ():
            if node.kind == "skill":
                yield from (value for _, value in node.ports.values())


def _compare(old: YamlNode | None, new: YamlNode | None, inputs: set[int]) -> None:
    """Raise at the first difference outside the values of skills' ports. Raises ReloadRefusedError."""
    if new is None or (id(old) in inputs and id(new) in inputs):
        return
    if isinstance(old, YamlMapping) and isinstance(new, YamlMapping):
        for key, (word, value) in new.entries.items():
            if key in old.entries:
                _compare(old.entries[key][1], value, inputs)
            elif id(value) not in inputs:
                _refuse(word, f"'{key}' is new")
        for key in old.entries.keys() - new.entries.keys():
            _refuse(new, f"'{key}' is gone")
    elif isinstance(old, YamlList) and isinstance(new, YamlList):
        for before, after in zip(old.items, new.items, strict=False):
            _compare(before, after, inputs)
        if len(old.items) != len(new.items):
            _refuse(new, f"{len(new.items)} items instead of {len(old.items)}")
    elif not (isinstance(old, YamlScalar) and isinstance(new, YamlScalar)):
        _refuse(new, "another node")
    elif (old.text, old.is_null) != (new.text, new.is_null):
        _refuse(new, f"'{new.text}' instead of '{old.text}'")


def _refuse(at: YamlNode, what: str) -> NoReturn:
    place = f"{at.source.path}:{at.line}:{at.column}"
    raise ReloadRefusedError(f"{place}: {what}: only literal inputs of skills are taken over, the rest by a new run")
