"""A tree that is ready to run, and the names of its nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from py_trees.behaviour import Behaviour

from pomona.executive.board import Board
from pomona.executive.language.model import Definition, Document, TreeNode
from pomona.executive.nodes import Attempt, Retry
from pomona.executive.nodes.ask import Question
from pomona.executive.nodes.leaves import SKILL, SUBTREE
from pomona.executive.skill import Skill

Side = Literal["before", "after"]  # of a node: where a breakpoint holds the tick


@dataclass(frozen=True, slots=True)
class NodeInfo:
    """One node of a built tree, for views and records."""

    # stable id: names from the root down, `fetch/Attempt/Plan#2`. A modifier's node is called after the node that it
    # wraps: `fetch/Attempt:retry`.
    path: str
    parent: str | None  # path of the parent, None for the root
    kind: str  # skill, subtree, sequence … or the modifier's name
    name: str  # its display name
    type: str  # the skill's or subtree's name, else the kind
    description: str = ""  # description, comment: from the tree file
    comment: str = ""
    file: str = ""  # file, line, end_line: where it is written
    line: int = 0
    end_line: int = 0
    inputs: Mapping[str, str] = field(
        default_factory=dict
    )  # inputs, outputs: wiring by port, as written
    outputs: Mapping[str, str] = field(default_factory=dict)
    # of the modifier or leaf, as written: `{"retry": "{attempts}"}`
    settings: Mapping[str, str] = field(default_factory=dict)
    devices: tuple[str, ...] = ()  # names of the device interfaces that it needs
    failures: tuple[str, ...] = ()  # the skill's failure codes
    mocked: bool = False  # whether a mock stands in for the skill
    choices: tuple[str, ...] = ()  # the answers of a node that asks the operator
    leads: tuple[str, ...] = ()  # roles and words of its children

    def facts(self) -> dict[str, Any]:
        """Return plain values for the record and the dashboard, without the empty ones."""
        slots = [name for name in self.__dataclass_fields__ if name != "leads"]
        found = {name: getattr(self, name) for name in slots}
        kept = {name: value for name, value in found.items() if value not in ("", 0, (), {}, False)}
        return {
            name: list(v) if isinstance(v, tuple) else dict(v) if isinstance(v, Mapping) else v
            for name, v in kept.items()
        } | {"parent": self.parent}


@dataclass(frozen=True, slots=True, eq=False)
class BuiltTree:
    """A py_trees tree, built from a document that has no errors."""

    name: str  # the tree's
    root: Behaviour  # tick this
    nodes: tuple[NodeInfo, ...]  # every node in drawing order (a parent before its children)
    behaviours: Mapping[
        str, Behaviour
    ]  # by path; each behaviour also has its `path` as an attribute
    parameters: Mapping[str, Any]  # values of the tree's parameters
    board: Board  # the store that the nodes write to
    # that stand in the file: a node's path, and the side on which the run pauses there
    breakpoints: tuple[tuple[str, Side], ...] = ()
    document: Document | None = None  # of which it was built; None without a file
    # counters and failures that the nodes inside a node see, by its path and their name
    around: Mapping[tuple[str, str], Any] = field(default_factory=dict)
    success: str = ""  # word of the measured success; empty: the tree's end

    def find(self, name: str) -> tuple[str, ...]:
        """Return the paths of the nodes with a name: a path, the end of one, or a node's name or type.

        A name or a type means the node itself, not the modifiers around it.
        """
        found = [path for path in self.behaviours if path == name or path.endswith(f"/{name}")]
        modifiers = {info.path for info in self.nodes if info.path.endswith(f":{info.kind}")}
        named = [i.path for i in self.nodes if name in (i.name, i.type) and i.path not in modifiers]
        return tuple(dict.fromkeys([*found, *named]))

    @property
    def skills(self) -> tuple[Skill, ...]:
        """All skills (and mocks), in drawing order."""
        return tuple(b for b in self.behaviours.values() if isinstance(b, Skill))

    @property
    def questions(self) -> Mapping[str, Question]:
        """Nodes that ask a person, by path."""
        return {path: b for path, b in self.behaviours.items() if isinstance(b, Question)}

    def prepare(
        self, tell: Callable[[str, int, int], None] = lambda _name, _done, _of: None
    ) -> None:
        """Let every skill load and warm up; the callback gets (name, done, of) before each."""
        for done, skill in enumerate(self.skills):
            tell(skill.name, done, len(self.skills))
            skill.prepare()

    def on_attempt(self, listener: Callable[[str, Attempt, int], None]) -> None:
        """`listener(path, attempt, of)` is called in the tick in which an attempt of a retry ends."""
        for retry in (b for b in self.behaviours.values() if isinstance(b, Retry)):
            retry.listener = lambda node, attempt: listener(node.path, attempt, node.total)


MAX_PATHS = 10_000


class UniquePaths:
    """Path ids: a path that is taken gets a number, `Plan`, `Plan#2` …"""

    def __init__(self) -> None:
        self.taken: set[str] = set()

    def take(self, base: str) -> str:
        """Return a path that no other node has: the given one, or with a number."""
        path = base
        number = 1
        while path in self.taken:
            number += 1
            path = f"{base}#{number}"
        self.taken.add(path)
        return path


def skills_by_node(document: Document) -> dict[str, str]:
    """Skill by all that a node may be called: the skill's name, its own, its path (with and without the root)."""
    found: dict[str, str] = {}
    for definition in document.definitions():
        for node in definition.root.walk() if definition.root is not None else ():
            if node.type is SKILL:
                found.setdefault(node.key.text, node.key.text)
                found.setdefault(node.label, node.key.text)
    for path, skill in _paths(document):
        found.setdefault(path, skill)
        found.setdefault(path.partition("/")[2], skill)
    found.pop("", None)
    return found


def _paths(document: Document) -> Iterator[tuple[str, str]]:
    """Path ids of all skills, as `build` gives them."""
    paths = UniquePaths()

    def walk(
        node: TreeNode, path: str, definition: Definition, depth: int
    ) -> Iterator[tuple[str, str]]:
        if node.type is SKILL:
            yield path, node.key.text
        for child in node.children:
            yield from walk(child, paths.take(f"{path}/{child.label}"), definition, depth)
        called = definition.file.subtrees.get(node.key.text) if node.type is SUBTREE else None
        if (
            called is not None
            and called.root is not None
            and depth < 50
            and len(paths.taken) < MAX_PATHS
        ):
            yield from walk(
                called.root, paths.take(f"{path}/{called.root.label}"), called, depth + 1
            )
        for slot, part in node.parts.items():
            yield from walk(part, f"{path}:{slot}", definition, depth)

    main = document.main.main
    if main is not None and main.root is not None:
        yield from walk(main.root, paths.take(document.main.name), main, 0)
