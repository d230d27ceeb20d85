"""Another value for an input of a skill while its tree runs, from an operator or from the changed tree file."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Any, NamedTuple, NoReturn

from py_trees.common import Status

from pomona.executive.errors import PomonaError
from pomona.executive.language.built import BuiltTree
from pomona.executive.language.literals import LiteralError, literal
from pomona.executive.language.model import Document
from pomona.executive.language.values import out_of_range
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Findings, Source, did_you_mean
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar, read_yaml


class ChangeRefusedError(PomonaError):
    """No such skill or input, or no value for it."""


class ReloadRefusedError(PomonaError):
    """A change of the file that the run does not take over; nothing was taken over."""


class InputChange(NamedTuple):
    """A new literal for an input of a skill, as the file has it."""

    path: str
    port: str
    text: str


def changed_input(tree: BuiltTree, path: str, port: str, text: str) -> Any:
    """Return the value that `text` means for this input of the skill at this path.

    Raises ChangeRefusedError: there is no such skill or input, or this is no value for it.
    """
    skill = tree.behaviours.get(path)
    if not isinstance(skill, Skill):
        raise ChangeRefusedError(f"there is no skill at {path}")
    found = skill.inputs.get(port)
    if found is None:
        hint = did_you_mean(port, skill.inputs) or f"it has {', '.join(skill.inputs) or 'none'}"
        raise ChangeRefusedError(f"{skill.name} has no input '{port}': {hint}")
    source = Source("change", text)
    node: YamlNode | None = YamlScalar(source, 1, 1, 1, len(text) + 1, text, True)
    if text[:1] in ("[", "{"):
        node = read_yaml(source, Findings())
    if node is None:
        raise ChangeRefusedError(f"{port}: this is not YAML: {text[:60]}")
    try:
        value = literal(node, found.type, found.choices)
    except LiteralError as error:
        raise ChangeRefusedError(f"{port}: {error.message}{error.hint and f' ({error.hint})'}") from None
    if not found.accepts(value):
        raise ChangeRefusedError(f"{port} does not accept {text[:60]}")
    problem = out_of_range(value, found)
    if problem:
        raise ChangeRefusedError(f"{port} {problem}")
    return value


def change_input(tree: BuiltTree, detail: str) -> None:
    """Change an input as requested by `port = value ← path`; it applies from the skill's next start on.

    Raises ChangeRefusedError: as `changed_input`.
    """
    said, _, path = detail.rpartition(" ← ")
    port, _, text = said.partition(" = ")
    value = changed_input(tree, path, port, text)
    skill = tree.behaviours[path]
    assert isinstance(skill, Skill)
    skill.changed[port] = value


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
        given = {**was.inputs, **was.outputs}
        for port, text in {**now.inputs, **now.outputs}.items():
            if text == given.get(port):
                continue
            place = f"{now.file}:{now.line}: {port} of {now.name} has changed"
            if running.behaviours[was.path].status is not Status.INVALID:
                raise ReloadRefusedError(f"{place}, but this node has started in the present pass")
            if "{" in text + given.get(port, ""):
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
