"""Trees mean their plain recursive reading: compared with an interpreter without ticks."""

from __future__ import annotations

import itertools
import random
from dataclasses import dataclass, field

import pytest

from pomona.executive.language import build, read
from pomona.executive.reasons import reason_of
from pomona.executive.skill_testing import BenchContext


@dataclass
class Node:
    """A node of the plain reading. `results` are a leaf's, by start; the last one stays."""

    kind: str
    children: list[Node] = field(default_factory=list)
    results: tuple[bool, ...] = (True,)
    modifiers: dict[str, object] = field(default_factory=dict)
    name: str = ""
    starts: int = 0

    def text(self) -> str:
        inner = (
            "MoveTo: {pose: a}"
            if self.kind == "leaf"
            else f"{self.kind}: [{', '.join(c.text() for c in self.children)}]"
        )
        return (
            f"{{{inner}, name: {self.name}"
            + "".join(f", {k}: {v}" for k, v in self.modifiers.items())
            + "}"
        )

    def walk(self):
        yield self
        for child in self.children:
            yield from child.walk()

    def run(self) -> bool | None:
        """Whether it succeeds; None when it is skipped."""
        if self.modifiers.get("when") == "'1 == 2'":
            return None
        for _ in range(self.modifiers.get("repeat", 1)):
            for _ in range(self.modifiers.get("retry", 1)):
                ended = self.one_try()
                if ended is not False:
                    break
            if not ended:
                return ended
        return True

    def one_try(self) -> bool | None:
        ended = self.plain()
        if ended is None:
            return None
        if self.modifiers.get("invert"):
            ended = not ended
        return {"success": True, "failure": False}.get(self.modifiers.get("force"), ended)

    def plain(self) -> bool | None:
        if self.kind == "leaf":
            self.starts += 1
            return self.results[min(self.starts, len(self.results)) - 1]
        decides = self.kind == "fallback"
        ends = []
        for child in self.children:
            ends.append(child.run())
            if ends[-1] is decides:
                return decides
        return None if all(end is None for end in ends) else not decides


MODIFIERS = {
    "retry": (1, 2, 3),
    "repeat": (1, 2),
    "invert": ("true",),
    "force": ("success", "failure"),
    "when": ("'1 == 1'", "'1 == 2'"),
    "guard": ("'1 == 1'",),
    "timeout": ("1 h",),
}


def random_tree(rng: random.Random, depth: int) -> Node:
    modifiers = {
        word: rng.choice(values) for word, values in MODIFIERS.items() if rng.random() < 0.25
    }
    if depth == 0 or rng.random() < 0.2:
        results = tuple(rng.random() < 0.5 for _ in range(rng.randint(1, 4)))
        return Node("leaf", results=results, modifiers=modifiers)
    kind = rng.choice(("sequence", "fallback"))
    count = rng.randint(1, 3)
    children = [random_tree(rng, depth - 1) for _ in range(count)]
    return Node(kind, children, modifiers=modifiers)


@pytest.fixture
def runs(skills):
    def run(root: Node):
        numbers = itertools.count()
        for node in root.walk():
            node.name = f"n{next(numbers)}"
        context = BenchContext()
        tree = build(
            read(f"pomona: 1\ntree: t\nroot: {root.text()}", "t.yaml"), skills, context=context
        )
        leaf = {node.name: node for node in root.walk() if node.kind == "leaf"}
        skills_by_name = {skill.name: skill for skill in tree.skills}
        for name, node in leaf.items():
            skills_by_name[name].script = tuple(None if ok else "NO_PATH" for ok in node.results)
        for _ in range(20_000):
            tree.root.tick_once()
            context.clock.advance(0.02)
            if tree.root.status.name != "RUNNING":
                return tree, skills_by_name, leaf
        raise AssertionError("still running")

    return run


@pytest.mark.parametrize("part", range(4))
def test_trees_end_as_their_plain_reading_says(runs, part):
    for number in range(100):
        root = random_tree(random.Random(f"{part}/{number}"), number % 4)
        tree, behaviours, leaf = runs(root)
        expected = root.run() is not False  # when there was nothing to do, the run has succeeded
        assert tree.root.status.name == ("SUCCESS" if expected else "FAILURE"), root.text()
        starts = {name: behaviours[name].starts for name in leaf}
        assert starts == {name: node.starts for name, node in leaf.items()}, root.text()
        if not expected:
            for cause in reason_of(tree.root).leaves():
                assert cause.node_path in tree.behaviours
                assert cause.message
