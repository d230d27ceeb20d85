"""The nodes of a record are a tree by construction: one root, each further node below an earlier one."""

from __future__ import annotations

from typing import Any

import pytest
from fake_runs import make
from hypothesis import given, strategies as st

from pomona.executive.behaviours import as_built
from pomona.executive.recording.digest import DEEPEST_NODE, MOST_NODES, tree_of
from pomona.executive.registry import Registry


def nodes(*pairs: tuple[str, str | None]) -> list[dict[str, Any]]:
    return [{"path": path, "parent": parent} for path, parent in pairs]


def chain(length: int) -> list[dict[str, Any]]:
    return nodes(("0", None), *((str(k), str(k - 1)) for k in range(1, length)))


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (nodes(("a", "b"), ("b", "a")), "the first node 'a' has a parent"),
        (nodes(("r", None), ("a", "b"), ("b", "a")), "node 'a' has no parent before it"),
        (nodes(("r", None), ("a", "a")), "node 'a' has no parent before it"),
        (nodes(("a", None), ("b", None)), "node 'b' has no parent before it"),
        (nodes(("a", None), ("b", "a"), ("b", "a")), "two nodes 'b'"),
        (
            chain(DEEPEST_NODE + 2),
            f"node '{DEEPEST_NODE + 1}' is more than {DEEPEST_NODE} levels deep",
        ),
        (nodes(("a", None)) * (MOST_NODES + 1), f"{MOST_NODES + 1} nodes stand where a tree"),
        ({"a": 1}, "stand where a tree of at most"),
        ([7], "'7' stands where a node with a path"),
        ([{"path": 7, "parent": None}], "a node with a path"),
        ([{"path": "a", "parent": None, "name": 7}], "name, type and kind of node 'a'"),
        ([{"path": "a", "parent": None, "line": True}], "the line of node 'a'"),
        ([{"path": "a", "parent": ["a"]}], "the first node 'a' has a parent"),
        (
            [{"path": "a", "parent": None}, {"path": "b", "parent": ["a"]}],
            "node 'b' has no parent before it",
        ),
    ],
)
def test_nodes_that_are_no_tree_are_refused_with_the_node(value: Any, words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words):
        tree_of(value)


def test_the_deepest_tree_and_none_are_read() -> None:
    assert len(tree_of(chain(DEEPEST_NODE + 1))) == DEEPEST_NODE + 1
    assert tree_of([]) == []


@given(
    st.lists(st.tuples(st.sampled_from("abcdef"), st.sampled_from([None, *"abcdef"])), max_size=7)
)
def test_each_way_up_from_an_accepted_node_ends_at_the_root(
    pairs: list[tuple[str, str | None]],
) -> None:
    try:
        parents = {node["path"]: node["parent"] for node in tree_of(nodes(*pairs))}
    except ValueError:
        return
    for path in parents:
        for _step in parents:
            path = parents.get(path) or path
        assert path == pairs[0][0]


TREE = """
pomona: 1
tree: t
subtrees:
  inner:
    root:
      wait: 20 ms
      repeat: 2
root:
  fallback:
    - sequence:
        - wait: 20 ms
        - ask: ready?
          timeout: 3 s
      name: Try
      retry: 3
      on_failure:
        wait: 20 ms
    - inner: {}
"""


def test_a_tree_that_can_run_is_a_tree_in_its_record() -> None:
    runner, _cell, _events = make(TREE, Registry({}))
    built = runner.tree
    assert len(tree_of([node.facts() for node in built.nodes])) == len(built.nodes) > 8
    again = as_built(built.root, built.board)
    assert len(tree_of([node.facts() for node in again.nodes])) > 8
