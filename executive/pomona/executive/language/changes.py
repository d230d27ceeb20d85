"""Changes of a tree while it runs: another value for an input of a skill, and a changed tree file."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NoReturn

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator

from pomona.executive.errors import PomonaError
from pomona.executive.language.built import BuiltTree, NodeInfo
from pomona.executive.language.literals import LiteralError, literal
from pomona.executive.language.model import Declared
from pomona.executive.language.values import out_of_range
from pomona.executive.nodes.ask import Question
from pomona.executive.nodes.choosing import Choice
from pomona.executive.nodes.retry import Fallback
from pomona.executive.nodes.sequence import Sequence
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Findings, Source, did_you_mean
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar, read_yaml, written


class ChangeRefusedError(PomonaError):
    """No such skill or input, or no value for it."""


class ReloadRefusedError(PomonaError):
    """A change of the file that the run does not take over; nothing was taken over."""


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


def begun(tree: BuiltTree, held: str = "") -> set[str]:
    """Return the paths of the nodes that run or have run in the present pass, or keep a state between passes.

    Args:
        held: path of the node at which a breakpoint holds the tick; nodes around it have begun.
    """
    found = {path for path, b in tree.behaviours.items() if b.status is not Status.INVALID or _remembers(b)}
    node: Behaviour | None = tree.behaviours.get(held)
    while node is not None:
        found.add(node.path)  # type: ignore[attr-defined]
        node = node.parent
    return found


class Takeover:
    """A changed tree for a paused run: every node that has begun stays, with its state; all others are as in the file.

    Raises ReloadRefusedError: with file, line and reason, when a node that has begun is another one in the file.
    """

    def __init__(self, running: BuiltTree, fresh: BuiltTree, held: str = "") -> None:
        """
        Args:
            running: the run's tree, at rest.
            fresh: built from the changed file on the board of `running`, around the nodes that have begun.
            held: see `begun`.
        """
        self._running, self._fresh, self._begun = running, fresh, begun(running, held)
        self._was, self._now = ({info.path: info for info in tree.nodes} for tree in (running, fresh))
        self._names = _changed_names(running, fresh)
        self._children: list[tuple[Behaviour, list[Behaviour]]] = []
        self._rewired: list[tuple[Skill, Skill]] = []
        self._behaviours = dict(fresh.behaviours)
        self._same = self._unchanged()
        old, new = (next(iter(tree.behaviours.values())) for tree in (running, fresh))
        if type(running.root) is not type(fresh.root) or (_path(old) in self._begun and _path(old) != _path(new)):
            self._refuse(_path(new), "the whole tree has another form")
        self._root = running.root if self._merge(old, new) is old else fresh.root

    @property
    def skills(self) -> tuple[Skill, ...]:
        """Skills as in the changed file that the run does not have so far: they are prepared first."""
        new = (b for path, b in self._behaviours.items() if b is not self._running.behaviours.get(path))
        return (*(b for b in new if isinstance(b, Skill)), *(skill for _, skill in self._rewired))

    def apply(self) -> BuiltTree:
        """Put the nodes of the file into the run's tree, and return that."""
        old, new = self._running, self._behaviours
        for parent, children in self._children:
            parent.children[:] = children  # in place: a tick that is held goes on with this list
            for child in children:
                child.parent = parent
            if isinstance(parent, Decorator):
                (parent.decorated,) = children
        for skill, source in self._rewired:
            skill.rewire(source)
        for path, behaviour in new.items():
            before = old.behaviours.get(path)
            if isinstance(behaviour, (Skill, Question)) and isinstance(before, (Skill, Question)):
                behaviour.starts = before.starts
        kept = {key: value for key, value in old.around.items() if new.get(key[0]) is old.behaviours[key[0]]}
        around = {**self._fresh.around, **kept}
        return replace(self._fresh, root=self._root, behaviours=new, board=old.board, around=around)

    def _unchanged(self) -> set[str]:
        """Return the paths of the nodes in which nothing has changed."""
        found = set[str]()
        for path in reversed([info.path for info in self._fresh.nodes]):
            old, new = self._running.behaviours.get(path), self._fresh.behaviours[path]
            alike = old is not None and _paths(old) == _paths(new) and not self._difference(path)
            if alike and found.issuperset(_paths(new)):
                found.add(path)
        return found

    def _merge(self, old: Behaviour, new: Behaviour) -> Behaviour:
        """Return the behaviour that stands in the place of `new`: the run's, or the file's with all below it."""
        path = _path(new)
        if path in self._same:
            self._behaviours.update((_path(node), node) for node in old.iterate())
            return old
        if isinstance(old, Skill) and old.status is Status.INVALID and self._was[path].type == self._now[path].type:
            assert isinstance(new, Skill)
            self._rewired.append((old, new))
        elif path not in self._begun:
            return new
        else:
            self._children.append((old, self._merge_children(old, new)))
        self._behaviours[path] = old
        return old

    def _merge_children(self, old: Behaviour, new: Behaviour) -> list[Behaviour]:
        path, name = _path(new), self._now[_path(new)].name
        if word := self._difference(path):
            self._refuse(path, f"{word} of {name} has changed, but this node has started in the present pass")
        if _remembers(old):
            self._refuse(path, f"{name} has changed, but it keeps its state in the whole run")
        was, now = _paths(old), _paths(new)
        passed = 1 + max((at for at, child in enumerate(was) if child in self._begun), default=-1)
        if was[:passed] != now[:passed]:
            at = next((child for child, other in zip(now, was, strict=False) if child != other), path)
            self._refuse(at, f"the children of {name} have changed before the place where the run is")
        if was != now and not isinstance(old, (Sequence, Fallback, Choice)):
            self._refuse(path, f"{name} has started in the present pass with other children")
        before = dict(zip(was, old.children, strict=True))
        return [self._merge(before[_path(child)], child) if _path(child) in before else child for child in new.children]

    def _difference(self, path: str) -> str:
        """Return a word of the node that has changed, or that uses a changed name; empty without one."""
        was, now = self._was[path], self._now[path]
        for old, new in zip(_words(was), _words(now), strict=True):
            for word in {**old, **new}:
                text = new.get(word, "")
                if text != old.get(word) or self._names.intersection(re.findall(r"\w+", text) if "{" in text else ()):
                    return word
        same = (was.kind, was.type, was.name, was.choices, was.leads) == (
            now.kind, now.type, now.name, now.choices, now.leads
        )  # fmt: skip
        return "" if same else "type or name"

    def _refuse(self, path: str, what: str) -> NoReturn:
        now = self._now[path]
        raise ReloadRefusedError(f"{now.file}:{now.line}: {what}: a new run takes the change")


def difference(running: BuiltTree, fresh: BuiltTree) -> str:
    """Return the changed lines of the tree's files, as a unified diff without context; empty without a change."""
    old, new = (
        {} if tree.document is None else {file.source.path: file.source.lines for file in tree.document.files}
        for tree in (running, fresh)
    )
    lines: list[str] = []
    for name in {**old, **new}:
        lines += difflib.unified_diff(old.get(name, ()), new.get(name, ()), name, name, n=0, lineterm="")
    return "\n".join(lines)


def _remembers(behaviour: Behaviour) -> bool:
    return getattr(behaviour, "remembers", False)


def _path(behaviour: Behaviour) -> str:
    return str(getattr(behaviour, "path", ""))


def _paths(behaviour: Behaviour) -> list[str]:
    return [_path(child) for child in behaviour.children]


def _words(info: NodeInfo) -> tuple[Mapping[str, str], ...]:
    return info.inputs, info.outputs, info.settings


def _changed_names(running: BuiltTree, fresh: BuiltTree) -> set[str]:
    """Return the names of parameters, constants, inputs and outputs that are declared otherwise than before."""
    old, new = _declared(running), _declared(fresh)
    return {key[-1] for key in {**old, **new} if old.get(key) != new.get(key)}


def _declared(tree: BuiltTree) -> dict[tuple[str, str, str], tuple[str | None, ...]]:
    assert tree.document is not None
    found: dict[tuple[str, str, str], tuple[str | None, ...]] = {}
    names: list[tuple[str, str, Mapping[str, Declared]]] = [
        (file.source.path, "", {**file.parameters, **file.constants}) for file in tree.document.files
    ]
    names += [(d.file.source.path, d.name, {**d.inputs, **d.outputs}) for d in tree.document.definitions()]
    for file, definition, words in names:
        for word, said in words.items():
            parts = (said.type, said.default, said.min, said.max, *said.choices)
            found[file, definition, word] = tuple(None if part is None else written(part) for part in parts)
    return found
