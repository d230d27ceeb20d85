"""`lenient` in a tree."""

from __future__ import annotations

from py_trees.common import Status

from my_package.lenient import LenientType
from pomona.executive.language import build, read
from pomona.executive.nodes.catalogue import BUILTIN, NodeTypes
from pomona.executive.registry import Registry
from pomona.executive.skill_testing import BenchContext

TREE = """
pomona: 1
tree: t
root:
  fail: {}
  lenient: 2
"""


def test_two_failures_are_forgiven_and_the_third_is_not() -> None:
    types = NodeTypes([*BUILTIN, LenientType])
    tree = build(read(TREE, "t.yaml", types=types), Registry({}), context=BenchContext())
    ends: list[Status] = []
    for _ in range(3):
        tree.root.tick_once()
        ends.append(tree.root.status)
    assert ends == [Status.SUCCESS, Status.SUCCESS, Status.FAILURE]
