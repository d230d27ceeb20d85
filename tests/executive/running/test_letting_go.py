"""Letting go comes first: devices have one owner, and who was interrupted brings them to rest before anybody else."""

from __future__ import annotations

from fake_cell import Wheel
from fake_runs import Turn, make

from pomona.executive.ports import Outputs
from pomona.executive.registry import Registry
from pomona.executive.running.events import Event, NodeChanged, StateChanged
from pomona.executive.running.starting import RunState
from pomona.executive.skill import Skill, Work


class Seen(Outputs):
    turning: bool


class IsTurning(Skill):
    """Instant work that only looks."""

    devices = (Wheel,)

    def run(self) -> Seen:
        return Seen(self.device(Wheel).turning)


class Look(Skill):
    """Looks for a while, moves nothing."""

    devices = (Wheel,)
    moves = ()

    def run(self) -> Work:
        for _ in range(3):
            self.device(Wheel)
            yield None


REGISTRY = Registry({"Turn": Turn, "IsTurning": IsTurning, "Look": Look})


def status_of(events: list[Event], name: str) -> list[str]:
    return [e.status for e in events if isinstance(e, NodeChanged) and e.path.endswith(name)]


def ended_at(events: list[Event]) -> float:
    return [e.t for e in events if isinstance(e, StateChanged)][-1]


def test_skills_interrupted_by_the_trees_end_get_all_their_ticks() -> None:
    runner, cell, events = make(
        "pomona: 1\ntree: t\nroot:\n  parallel: [{Turn: {duration: 9 s}}, {wait: 60 ms}]\n  success_on: one",
        REGISTRY,
    )
    result = runner.run()
    assert result.outcome == "success"
    assert cell.wheel.log == ["start", "stop", "at rest"]
    assert ended_at(events) > 0.06 + 0.04  # three ticks of coasting are a part of the run


def test_a_failure_at_the_trees_end_also_waits_for_interrupted_skills() -> None:
    runner, cell, _events = make(
        "pomona: 1\ntree: t\nroot:\n  parallel: [{Turn: {duration: 9 s}}, {sequence: [{wait: 60 ms}, {fail: {}}]}]",
        REGISTRY,
    )
    result = runner.run()
    assert result.outcome == "failure"
    assert result.reason is not None
    assert result.reason.code == "FAILED"
    assert cell.wheel.log == ["start", "stop", "at rest"]


def test_a_preempted_skill_has_let_go_before_the_preempting_one_starts() -> None:
    text = """
pomona: 1
tree: t
root:
  sequence:
    - set: {n: 0}
    - parallel:
        - sequence: [{wait: 100 ms}, {set: {n: 1}}]
        - reactive_fallback:
            - sequence: [{check: "{n} == 1"}, {Turn: {duration: 100 ms}, name: Urgent}]
            - {Turn: {duration: 9 s}, name: Slow}
"""
    runner, cell, events = make(text, REGISTRY)
    assert runner.run().outcome == "success"
    assert cell.wheel.log == ["start", "stop", "at rest", "start", "stop"]
    assert status_of(events, "Slow")[-1] == "INVALID"
    assert any(
        "Slow" in e.feedback
        for e in events
        if isinstance(e, NodeChanged) and e.path.endswith("Urgent")
    )


def test_two_skills_that_move_one_device_take_turns_under_a_parallel() -> None:
    runner, cell, _events = make(
        "pomona: 1\ntree: t\nroot:\n  parallel: [{Turn: {}, name: A}, {Turn: {}, name: B}]",
        REGISTRY,
    )
    assert runner.run().outcome == "success"
    assert cell.wheel.log == ["start", "stop", "start", "stop"]
    assert runner.context.owners == {}


def test_a_skill_that_only_reads_waits_for_no_moving_one() -> None:
    text = "pomona: 1\ntree: t\nroot:\n  parallel: [{Turn: {duration: 1 s}}, {sequence: [{Look: {}}, {IsTurning: {}}]}]"
    runner, _cell, events = make(text, REGISTRY)
    runner.run()
    looked = next(
        e
        for e in events
        if isinstance(e, NodeChanged) and "IsTurning" in e.path and e.status == "SUCCESS"
    )
    assert looked.t < 0.2


def test_a_reactive_condition_that_is_a_skill_interrupts_nothing() -> None:
    text = "pomona: 1\ntree: t\nroot:\n  reactive_sequence: [{IsTurning: {}}, {Turn: {duration: 200 ms}}]"
    runner, cell, _events = make(text, REGISTRY)
    assert runner.run().outcome == "success"
    assert cell.wheel.log == ["start", "stop"]


def test_a_pause_while_the_end_lets_go_is_a_pause() -> None:
    runner, cell, _events = make(
        "pomona: 1\ntree: t\nroot:\n  parallel: [{Turn: {duration: 9 s}}, {wait: 60 ms}]\n  success_on: one",
        REGISTRY,
        {
            5: lambda runner, _cell: runner.pause("ada"),
            30: lambda runner, _cell: runner.resume(runner.pause_number, "ada"),
        },
    )
    assert runner.run().outcome == "success"
    assert runner.state is RunState.SUCCEEDED
    assert cell.wheel.log[-1] == "at rest"


def test_the_moved_devices_of_an_installed_skill_are_among_its_devices() -> None:
    registry = Registry.installed()
    for name in registry:
        skill = registry[name]
        assert set(skill.claims()) <= set(skill.devices), name
