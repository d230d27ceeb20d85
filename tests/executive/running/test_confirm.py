"""A skill that asks the operator before it goes on: the run pauses, and only an operator resumes it."""

from __future__ import annotations

from fake_cell import Wheel
from fake_runs import make

from pomona.executive.registry import Registry
from pomona.executive.running.events import StateChanged
from pomona.executive.running.starting import RunState
from pomona.executive.skill import Skill, Work

TREE = "pomona: 1\ntree: t\nroot:\n  Cautious: {}\n"


class Cautious(Skill):
    """Turn only after an operator's word."""

    devices = (Wheel,)
    failures = ("NOT_NOW",)

    def run(self) -> Work[None]:
        if not (yield from self.confirm("is nobody near?")):
            raise self.failure("NOT_NOW", "nobody was there to say so")
        self.device(Wheel).start()
        yield None
        self.device(Wheel).stop()
        return None


SKILLS = Registry({"Cautious": Cautious})


def test_with_an_operator_the_run_pauses_and_goes_on_when_resumed() -> None:
    looks: list[RunState] = []

    def look(runner, cell) -> None:
        looks.append(runner.state)
        if len(looks) < 10:
            assert "start" not in cell.wheel.log
        elif runner.state is RunState.PAUSED:
            runner.resume(runner.pause_number, "ada")

    runner, _cell, events = make(TREE, SKILLS, dict.fromkeys(range(1, 40), look), attended=True)
    assert runner.run().outcome == "success"
    assert looks[9] is RunState.PAUSED
    paused = [event for event in events if isinstance(event, StateChanged)]
    assert any("is nobody near?" in str(event) for event in paused)


def test_without_an_operator_it_fails_at_once() -> None:
    runner, _, _ = make(TREE, SKILLS)
    result = runner.run()
    assert result.outcome == "failure"
    assert result.reason is not None
    assert result.reason.code == "NOT_NOW"
