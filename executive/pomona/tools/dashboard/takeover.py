"""A changed tree file for a paused run: nodes that have begun stay, all others are built anew."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NoReturn

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator

from pomona.executive.language.built import BuiltTree, NodeInfo
from pomona.executive.language.changes import Around, ReloadRefusedError
from pomona.executive.language.model import Declared
from pomona.executive.nodes.ask import Question
from pomona.executive.nodes.behaviours import Sequence
from pomona.executive.nodes.choosing import Choice
from pomona.executive.nodes.retry import Fallback
from pomona.executive.skill import Skill
from pomona.executive.values.sentences import sentence_of
from pomona.executive.values.yaml_nodes import written


class FileTakeover:
    """The files as they are now, built for a run at rest.

    Attributes:
        fresh: the file's tree, on the run's board.
        difference: of the files, as a unified diff.
    """

    def __init__(
        self, running: BuiltTree, held: str, rebuild: Callable[[Around], BuiltTree]
    ) -> None:
        """Build the files' tree, and prepare its new skills.

        Raises:
            UsageError: the file cannot be read, or has errors.
            ReloadRefusedError: a change cannot be taken over, a new skill cannot be prepared, or there is no change.
        """
        stay = begun(running, held)
        self._held = held
        self.fresh = rebuild(
            {key: value for key, value in running.around.items() if key[0] in stay}
        )
        self.difference = difference(running, self.fresh)
        if not self.difference:
            raise ReloadRefusedError("the tree file has not changed")
        merged = MergedTree(running, self.fresh, held)
        if merged.dropped:
            self.difference += f"\n\\ an operator's change is dropped: {', '.join(merged.dropped)}"
        for skill in merged.skills:
            try:
                skill.prepare()
            except Exception as error:  # weights that do not load: the run stays as it is
                raise ReloadRefusedError(
                    f"{skill.name} cannot be prepared: {sentence_of(error)}"
                ) from error

    def apply(self, running: BuiltTree) -> BuiltTree:
        """Put its nodes into the run's tree, and return that. Raises ReloadRefusedError: it has changed meanwhile."""
        return MergedTree(running, self.fresh, self._held).apply()


def begun(tree: BuiltTree, held: str = "") -> set[str]:
    """Return the paths of the nodes that run or have run in the present pass, or keep a state between passes.

    Args:
        held: path of the node at which a breakpoint holds the tick; nodes around it have begun.
    """
    found = {
        path
        for path, b in tree.behaviours.items()
        if b.status is not Status.INVALID or _remembers(b)
    }
    node: Behaviour | None = tree.behaviours.get(held)
    while node is not None:
        found.add(node.path)  # type: ignore[attr-defined]
        node = node.parent
    return found


class MergedTree:
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
        self._was, self._now = (
            {info.path: info for info in tree.nodes} for tree in (running, fresh)
        )
        self._changes = {
            path: dict(skill.changed)
            for path, skill in running.behaviours.items()
            if isinstance(skill, Skill) and skill.changed
        }
        self._names = _changed_names(running, fresh)
        self._children: list[tuple[Behaviour, list[Behaviour]]] = []
        self._rewired: list[tuple[Skill, Skill]] = []
        self._behaviours = dict(fresh.behaviours)
        self._same = self._unchanged()
        old, new = (next(iter(tree.behaviours.values())) for tree in (running, fresh))
        if type(running.root) is not type(fresh.root) or (
            _path(old) in self._begun and _path(old) != _path(new)
        ):
            self._refuse(_path(new), "the whole tree has another form")
        self._root = running.root if self._merge(old, new) is old else fresh.root

    @property
    def skills(self) -> tuple[Skill, ...]:
        """Skills as in the changed file that the run does not have so far: they are prepared first."""
        new = (
            b for path, b in self._behaviours.items() if b is not self._running.behaviours.get(path)
        )
        return (*(b for b in new if isinstance(b, Skill)), *(skill for _, skill in self._rewired))

    @property
    def dropped(self) -> list[str]:
        """Inputs that an operator has changed and the file changes, too, or has no longer."""
        return [
            f"{path.rpartition('/')[2]}.{port}"
            for path, changed in self._changes.items()
            for port in changed.keys() - self._kept(path).keys()
        ]

    def _kept(self, path: str) -> Mapping[str, object]:
        """Return what an operator has changed of a skill that is the same in the file, by port."""
        was = self._was[path]
        now = self._now.get(path)
        same = now is not None and now.type == was.type
        return {
            port: value
            for port, value in self._changes[path].items()
            if same and now is not None and now.inputs.get(port) == was.inputs.get(port)
        }

    def apply(self) -> BuiltTree:
        """Put the nodes of the file into the run's tree, and return that."""
        old = self._running
        new = self._behaviours
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
            if isinstance(behaviour, Skill) and path in self._changes:
                behaviour.changed.update(self._kept(path))
        kept = {
            key: value
            for key, value in old.around.items()
            if new.get(key[0]) is old.behaviours[key[0]]
        }
        around = {**self._fresh.around, **kept}
        return replace(self._fresh, root=self._root, behaviours=new, board=old.board, around=around)

    def _unchanged(self) -> set[str]:
        """Return the paths of the nodes in which nothing has changed."""
        found = set[str]()
        for path in reversed([info.path for info in self._fresh.nodes]):
            old = self._running.behaviours.get(path)
            new = self._fresh.behaviours[path]
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
        if (
            isinstance(old, Skill)
            and old.status is Status.INVALID
            and self._was[path].type == self._now[path].type
        ):
            assert isinstance(new, Skill)
            self._rewired.append((old, new))
        elif path not in self._begun:
            return new
        else:
            self._children.append((old, self._merge_children(old, new)))
        self._behaviours[path] = old
        return old

    def _merge_children(self, old: Behaviour, new: Behaviour) -> list[Behaviour]:
        path = _path(new)
        name = self._now[_path(new)].name
        if word := self._difference(path):
            self._refuse(
                path, f"{word} of {name} has changed, but this node has started in the present pass"
            )
        if _remembers(old):
            self._refuse(path, f"{name} has changed, but it keeps its state in the whole run")
        was = _paths(old)
        now = _paths(new)
        passed = 1 + max((at for at, child in enumerate(was) if child in self._begun), default=-1)
        if was[:passed] != now[:passed]:
            at = next(
                (child for child, other in zip(now, was, strict=False) if child != other), path
            )
            self._refuse(
                at, f"the children of {name} have changed before the place where the run is"
            )
        if was != now and not isinstance(old, (Sequence, Fallback, Choice)):
            self._refuse(path, f"{name} has started in the present pass with other children")
        before = dict(zip(was, old.children, strict=True))
        return [
            self._merge(before[_path(child)], child) if _path(child) in before else child
            for child in new.children
        ]

    def _difference(self, path: str) -> str:
        """Return a word of the node that has changed, or that uses a changed name; empty without one."""
        was = self._was[path]
        now = self._now[path]
        for old, new in zip(_words(was), _words(now), strict=True):
            for word in {**old, **new}:
                text = new.get(word, "")
                if text != old.get(word) or self._names.intersection(
                    re.findall(r"\w+", text) if "{" in text else ()
                ):
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
        {}
        if tree.document is None
        else {file.source.path: file.source.lines for file in tree.document.files}
        for tree in (running, fresh)
    )
    lines: list[str] = []
    for name in {**old, **new}:
        lines += difflib.unified_diff(
            old.get(name, ()), new.get(name, ()), name, name, n=0, lineterm=""
        )
    return "\n".join(lines)


def _remembers(behaviour: Behaviour) -> bool:
    """Return True if the next start of a node depends on the one before."""
    if isinstance(behaviour, Sequence):
        return behaviour.keeps and behaviour._at > 0
    return getattr(behaviour, "remembers", False)


def _path(behaviour: Behaviour) -> str:
    return str(getattr(behaviour, "path", ""))


def _paths(behaviour: Behaviour) -> list[str]:
    return [_path(child) for child in behaviour.children]


def _words(info: NodeInfo) -> tuple[Mapping[str, str], ...]:
    return info.inputs, info.outputs, info.settings


def _changed_names(running: BuiltTree, fresh: BuiltTree) -> set[str]:
    """Return the names of parameters, constants, inputs and outputs that are declared otherwise than before."""
    old = _declared(running)
    new = _declared(fresh)
    return {key[-1] for key in {**old, **new} if old.get(key) != new.get(key)}


def _declared(tree: BuiltTree) -> dict[tuple[str, str, str], tuple[str | None, ...]]:
    assert tree.document is not None
    found: dict[tuple[str, str, str], tuple[str | None, ...]] = {}
    names: list[tuple[str, str, Mapping[str, Declared]]] = [
        (file.source.path, "", {**file.parameters, **file.constants})
        for file in tree.document.files
    ]
    names += [
        (d.file.source.path, d.name, {**d.inputs, **d.outputs}) for d in tree.document.definitions()
    ]
    for file, definition, words in names:
        for word, said in words.items():
            parts = (said.type, said.default, said.min, said.max, *said.choices)
            found[file, definition, word] = tuple(
                None if part is None else written(part) for part in parts
            )
    return found
