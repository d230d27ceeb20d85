"""A blocking skill is reported as such, also inside a time limit and on a simulated clock."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_runs import make

from pomona.executive.registry import Registry
from pomona.executive.running import runner as module
from pomona.executive.running.events import RunStarted, TickOverran
from pomona.executive.skill import Skill, Work
from pomona.tools.dashboard import explain as words


class Block(Skill):
    """Does its work in the tick instead of beside it."""

    def run(self) -> Work[None]:
        yield None
        sum(range(300_000))


def test_a_skill_that_blocks_under_a_timeout_is_reported_with_the_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "BLOCKED", 1e-4)
    monkeypatch.setattr(words, "BLOCKED", 1e-4)
    tree = "pomona: 1\ntree: t\nroot: {sequence: [{Block: {}, timeout: 100 ms}]}"
    runner, _cell, events = make(tree, Registry({"Block": Block}))
    assert runner.run().outcome == "success"
    told = [event for event in events if isinstance(event, TickOverran)][
        -1
    ]  # the last tick was the long one
    assert told.node.endswith("Block")
    nodes = tuple(node.facts() for node in runner.tree.nodes)
    begun = RunStarted(
        0.0, 0, "r", "t", "t", "", "", "c", "mock", "", "", 0, {}, nodes, {}, 0.0, 0.02
    )
    assert told.worked is not None
    assert told.worked > 0.0
    late = [replace(e, worked=e.duration) if isinstance(e, TickOverran) else e for e in events]
    story = " ".join(words.explain([begun, *late]))
    assert "Block kept the tick waiting" in story
    assert "nothing could interrupt it meanwhile, not even the limit of" in story
    assert "Such work belongs into" in story
    idle = [replace(e, worked=0.0) if isinstance(e, TickOverran) else e for e in events]
    story = " ".join(words.explain([begun, *idle]))
    assert "the computer had too much to do" in story
    assert "Such work belongs into" not in story
