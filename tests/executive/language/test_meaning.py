"""Trees mean what a plain recursive reading of them says: compared with an interpreter that knows nothing of ticks."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.language import build, read
from executive.reasons import reason_of
from executive.skill_testing import BenchContext


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
        return f"{{{inner}, name: {self.name}" + "".join(f", {k}: {v}" for k, v in self.modifiers.items()) + "}"

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
        if self.kind == "recovery":
            first, second = self.children
            ended = first.run()
            if ended is not False:
                return ended
            return first.run() if second.run() else False
        decides = self.kind == "fallback"
        ends = []
        for child in self.children:
            ends.append(child.run())
            if ends[-1] is decides:
                return decides
        return None if all(end is None for end in ends) else not decides


modifiers = st.fixed_dictionaries(
    {},
    optional={
        "retry": st.integers(1, 3),
        "repeat": st.integers(1, 2),
        "invert": st.just("true"),
        "force": st.sampled_from(["success", "failure"]),
        "when": st.sampled_from(["'1 == 1'", "'1 == 2'"]),
        "guard": st.just("'1 == 1'"),
        "timeout": st.just("1 h"),
    },
)
leaves = st.builds(
    Node, st.just("leaf"), results=st.lists(st.booleans(), min_size=1, max_size=4).map(tuple), modifiers=modifiers
)


def branches(children):
    many = st.builds(
        Node, st.sampled_from(["sequence", "fallback"]), st.lists(children, min_size=1, max_size=3), modifiers=modifiers
    )
    return st.one_of(many, st.builds(Node, st.just("recovery"), st.lists(children, min_size=2, max_size=2)))


@pytest.fixture
def runs(skills):
    def run(root: Node):
        numbers = itertools.count()
        for node in root.walk():
            node.name = f"n{next(numbers)}"
        context = BenchContext()
        tree = build(read(f"pomona: 1\ntree: t\nroot: {root.text()}", "t.yaml"), skills, context=context)
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


@given(data=st.data())
@settings(max_examples=250, deadline=None)
def test_trees_end_as_their_plain_reading_says(data, request):
    root = data.draw(st.recursive(leaves, branches, max_leaves=8))
    tree, behaviours, leaf = request.getfixturevalue("runs")(root)
    expected = root.run() is not False  # when there was nothing to do, the run has succeeded
    assert tree.root.status.name == ("SUCCESS" if expected else "FAILURE")
    assert {name: behaviours[name].starts for name in leaf} == {name: node.starts for name, node in leaf.items()}
    if not expected:
        for cause in reason_of(tree.root).leaves():
            assert cause.node_path in tree.behaviours
            assert cause.message
