"""An interrupted node halts: over several ticks if necessary, and only once."""

from __future__ import annotations

import itertools

import pytest
from py_trees.common import Status

from pomona.executive.language import build, read
from pomona.executive.registry import Registry
from pomona.executive.skill import Interrupted, Skill, Work
from pomona.executive.skill_testing import BenchContext


class Swing(Skill):
    """Needs three more steps to come to rest."""

    def __init__(self, name=""):
        super().__init__(name)
        self.steps = []

    def run(self) -> Work:
        try:
            while True:
                yield "swinging"
        except Interrupted:
            for step in range(3):
                self.steps.append(step)
                yield "slowing down"
            raise


@pytest.fixture
def run():
    def make(body):
        context = BenchContext()
        tree = build(
            read("pomona: 1\ntree: t\n" + body, "t"), Registry({"Swing": Swing}), context=context
        )
        return tree, context

    return make


@pytest.mark.parametrize(
    "body",
    [
        "root: {Swing: {}, timeout: 50 ms}",
        "root: {sequence: [{Swing: {}, name: S}], timeout: 50 ms}",
        "root: {parallel: [{Swing: {}, name: S}, {sequence: [{wait: 50 ms}, {fail: {}}]}]}",
        "root: {sequence: [{set: {n: 0}}, {parallel: [{Swing: {}, name: S, guard: '{n} == 0'},"
        " {sequence: [{wait: 50 ms}, {set: {n: 1}}]}]}]}",
    ],
)
def test_an_interrupted_skill_is_handed_over_to_let_go(run, body):
    tree, context = run(body)
    for _ in range(20):
        tree.root.tick_once()
        context.clock.advance(0.02)
        if tree.root.status is not Status.RUNNING:
            break
    assert tree.root.status is Status.FAILURE
    (skill,) = tree.skills
    assert skill.steps == [0]
    ((_skill, work),) = context.halting
    with pytest.raises(Interrupted):
        list(itertools.islice(work, 5))
    assert skill.steps == [0, 1, 2]
    tree.root.stop(Status.INVALID)
    assert len(context.halting) == 1


def test_stopping_the_root_stops_everything_that_runs(run):
    tree, context = run(
        "root: {retry: 3, parallel: [{Swing: {}, name: A}, {Swing: {}, name: B, repeat: 2}]}"
    )
    tree.root.tick_once()
    tree.root.stop(Status.INVALID)
    assert {behaviour.status for behaviour in tree.behaviours.values()} == {Status.INVALID}
    assert len(context.halting) == 2


def test_a_tree_can_be_stopped_before_its_first_tick(run):
    tree, context = run("root: {sequence: [{Swing: {}, timeout: 1 s, retry: 2}]}")
    tree.root.stop(Status.INVALID)
    assert context.halting == []
