"""A skill is polled by its tree: when it starts, asks for its devices, ends, is interrupted, and starts again."""

from __future__ import annotations

import gc
import logging
import os
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import pytest
from py_trees.common import Status

from pomona.executive import skill as skill_module
from pomona.executive.errors import NotOwnerError, SkillError
from pomona.executive.lease import command
from pomona.executive.ports import Outputs, Ports
from pomona.executive.skill import (
    POLLED,
    Failure,
    Interrupted,
    Skill,
    SkillFailure,
    Work,
    continue_here,
    leave_if_forked,
    run_in_progress,
)
from pomona.executive.skill_testing import BenchContext, drive


class Belt(Protocol):
    """A device that moves."""

    @command
    def go(self) -> None: ...


class Lamp(Protocol):
    """A device that a cell may lack."""

    def lit(self) -> bool: ...


class Steel:
    """A belt."""

    def __init__(self) -> None:
        self.log: list[str] = []

    def go(self) -> None:
        self.log.append("go")


class Counted(Outputs):
    count: int


class Count(Skill):
    """Count up, one a tick."""

    failures = ("TOO_MANY",)

    def run(self, to: int = 2, limit: int = 5) -> Work[Counted]:
        for number in range(1, to + 1):
            if number > limit:
                raise self.failure("TOO_MANY", f"{number} are too many", number=number)
            yield f"at {number}"
        return Counted(to)


class Instant(Skill):
    """Return at once."""

    devices = (Belt,)

    def run(self, number: int = 1) -> Counted:
        return Counted(number)


class Drive(Skill):
    """Move the belt in every tick, and note how it ends."""

    devices = (Belt,)
    optional_devices = (Lamp,)
    halting = 0

    def run(self) -> Work[None]:
        self.notes: list[str] = []
        belt = self.device(Belt)
        try:
            while True:
                belt.go()
                yield "driving"
        except Interrupted:
            self.notes.append("stopping")
            for _ in range(self.halting):
                yield "stopping"
            raise
        finally:
            self.notes.append("ended")


class Context(BenchContext):
    """Counts how often skills ask for their devices and give them back."""

    def __init__(self, **fields: Any) -> None:
        super().__init__(**fields)
        self.log: list[str] = []
        self.obstacle: str | None = None

    def acquire(self, skill: Skill) -> str | None:
        self.log.append("acquire")
        return self.obstacle or super().acquire(skill)

    def release(self, skill: Skill) -> None:
        self.log.append("release")
        super().release(skill)


def bound(
    skill: Skill, context: Context | None = None, **inputs: object
) -> tuple[Context, dict[str, object]]:
    """A skill in a context, with the outputs that it writes."""
    context = context or Context(devices={Belt: Steel()})
    written: dict[str, object] = {}
    skill.bind(context, "/tree/it", lambda: inputs, written.__setitem__)
    return context, written


def statuses(skill: Skill, ticks: int) -> list[str]:
    return [(skill.tick_once(), skill.status.name)[1] for _ in range(ticks)]


# ------------------------------------------------------------------------------------------- from start to end


def test_each_yield_is_a_tick_that_runs_and_the_return_succeeds_with_outputs():
    skill = Count()
    context, written = bound(skill, to=2)
    assert skill.starts == 0
    skill.tick_once()
    assert (skill.status, skill.feedback_message, written) == (Status.RUNNING, "at 1", {})
    skill.tick_once()
    assert (skill.status, skill.feedback_message, written) == (Status.RUNNING, "at 2", {})
    assert context.log == ["acquire"]
    skill.tick_once()
    assert (skill.status, written) == (Status.SUCCESS, {"count": 2})
    assert context.log == ["acquire", "release"]
    assert (skill.starts, skill.reason, skill.broke) == (1, None, False)


def test_a_yield_without_a_line_leaves_the_last_one():
    class Quiet(Skill):
        def run(self) -> Work[None]:
            yield "the only line"
            yield None
            yield ""

    skill = Quiet()
    bound(skill)
    lines = [(skill.tick_once(), skill.feedback_message)[1] for _ in range(4)]
    assert lines == ["the only line", "the only line", "", ""]


def test_a_skill_starts_again_with_new_inputs_no_reason_and_an_empty_line():
    skill = Count()
    inputs = {"to": 2, "limit": 1}
    context = Context()
    skill.bind(context, "/it", lambda: inputs, lambda _name, _value: None)
    assert statuses(skill, 2) == ["RUNNING", "FAILURE"]
    assert skill.feedback_message == "TOO_MANY: 2 are too many"
    inputs["limit"] = 5
    skill.initialise()
    assert (skill.reason, skill.feedback_message, skill.starts) == (None, "", 2)
    assert statuses(skill, 3) == ["RUNNING", "RUNNING", "SUCCESS"]
    assert skill.starts == 3


def test_instant_work_ends_in_its_first_tick():
    skill = Instant()
    context, written = bound(skill, number=7)
    skill.tick_once()
    assert (skill.status, written) == (Status.SUCCESS, {"count": 7})
    assert context.log == ["acquire", "release"]


def test_an_input_that_was_changed_replaces_the_wired_one():
    skill = Instant()
    _context, written = bound(skill, number=7)
    skill.changed["number"] = 8
    skill.tick_once()
    assert written == {"count": 8}


def test_rewired_it_has_the_other_nodes_ports_and_no_changed_inputs():
    skill, other = Instant(), Instant()
    _context, written = bound(skill, number=1)
    _context, written_by_other = bound(other, number=2)
    skill.changed["number"] = 8
    skill.rewire(other)
    skill.tick_once()
    assert (written, written_by_other, skill.changed) == ({}, {"count": 2}, {})


def test_while_its_devices_are_taken_it_runs_without_starting_and_tells_why():
    skill = Instant()
    context, written = bound(skill)
    context.obstacle = "waits for the belt"
    assert statuses(skill, 2) == ["RUNNING", "RUNNING"]
    assert (skill.feedback_message, written) == ("waits for the belt", {})
    context.obstacle = None
    assert statuses(skill, 1) == ["SUCCESS"]
    assert context.log == ["acquire", "acquire", "acquire", "release"]


def test_interrupted_before_it_has_started_there_is_nothing_to_halt():
    skill = Drive()
    context, _written = bound(skill)
    context.obstacle = "waits for the belt"
    skill.tick_once()
    skill.stop(Status.INVALID)
    assert context.halting == []
    assert not hasattr(skill, "notes")


# ------------------------------------------------------------------------------------------------- failures


def test_a_failure_has_code_sentence_and_data():
    skill = Count()
    context, written = bound(skill, to=2, limit=1)
    assert statuses(skill, 2) == ["RUNNING", "FAILURE"]
    assert skill.reason == Failure("TOO_MANY", "2 are too many", {"number": 2})
    assert (written, skill.broke) == ({}, False)
    assert context.log == ["acquire", "release"]


def test_a_failure_without_data_has_an_empty_mapping():
    assert Failure("A", "b").data == {}


@pytest.mark.parametrize(
    ("code", "message", "says"),
    [
        ("OTHER", "a sentence", "failure code OTHER is not declared in its `failures`"),
        ("TOO_MANY", 3, "the message of TOO_MANY is no text but int"),
    ],
)
def test_an_undeclared_code_or_a_message_that_is_no_text_is_a_bug_of_the_skill(code, message, says):
    with pytest.raises(SkillError, match=says) as raised:
        Count().failure(code, message)
    assert raised.value.skill == "Count"


def test_an_exception_ends_the_run_and_gives_the_devices_back():
    class Broken(Skill):
        def run(self) -> Work[None]:
            yield None
            raise ZeroDivisionError("a bug")

    skill = Broken()
    context, _written = bound(skill)
    skill.tick_once()
    with pytest.raises(ZeroDivisionError, match="a bug"):
        skill.tick_once()
    assert (skill.broke, skill.reason) == (True, None)
    assert context.log == ["acquire", "release"]


def test_interrupted_that_no_tree_has_raised_is_a_bug_of_the_skill():
    class Confused(Skill):
        def run(self) -> Work[None]:
            yield None
            raise Interrupted

    skill = Confused()
    context, _written = bound(skill)
    skill.tick_once()
    with pytest.raises(SkillError, match="Confused: raised Interrupted without an interruption"):
        skill.tick_once()
    assert skill.broke
    assert context.log[-1] == "release"


@pytest.mark.parametrize(
    ("returned", "says"),
    [
        (None, r"must return the outputs \['count'\], returned \[\]"),
        ({"count": 1, "more": 2}, r"must return the outputs \['count'\], returned \['count', 'mo"),
        ({"count": "one"}, "output count is a str"),
        ({"count": True}, "output count is a bool"),
    ],
)
def test_outputs_other_than_the_declared_ones_are_a_bug_of_the_skill(returned, says):
    class Odd(Skill):
        outputs = Ports(count=int)

        def run(self, **inputs: object) -> Any:
            return returned

    skill = Odd()
    _context, written = bound(skill)
    with pytest.raises(SkillError, match=says):
        skill.tick_once()
    assert written == {}


def test_a_skill_without_a_body_is_a_bug():
    skill = Skill("bare")
    bound(skill)
    with pytest.raises(SkillError, match=r"Skill: defines no run\(\)"):
        skill.tick_once()


# --------------------------------------------------------------------------------------------- interruption


def test_interrupted_its_body_is_handed_over_to_halt_and_moves_nothing_more():
    skill = Drive()
    skill.halting = 2
    context, _written = bound(skill)
    belt = context.devices[Belt]
    assert statuses(skill, 3) == ["RUNNING"] * 3
    skill.stop(Status.INVALID)
    assert belt.log == ["go"] * 3
    assert (skill.status, skill.notes) == (Status.INVALID, ["stopping"])
    ((halted, work),) = context.halting
    assert halted is skill
    assert next(work) == "stopping"
    with pytest.raises(Interrupted):
        next(work)
    assert skill.notes == ["stopping", "ended"]
    assert belt.log == ["go"] * 3


def test_a_skill_that_has_ended_is_not_interrupted():
    skill = Count()
    context, _written = bound(skill, to=0)
    skill.tick_once()
    skill.stop(Status.INVALID)
    assert (context.halting, context.log) == ([], ["acquire", "release"])


def test_interrupted_twice_it_is_halted_once():
    skill = Drive()
    skill.halting = 5
    context, _written = bound(skill)
    skill.tick_once()
    skill.stop(Status.INVALID)
    skill.stop(Status.INVALID)
    assert len(context.halting) == 1


def test_after_an_interruption_a_new_start_is_a_new_body():
    skill = Count()
    _context, written = bound(skill, to=1)
    skill.tick_once()
    skill.stop(Status.INVALID)
    assert statuses(skill, 2) == ["RUNNING", "SUCCESS"]
    assert (skill.starts, written) == (2, {"count": 1})


# ------------------------------------------------------------------------------------------ work beside the tick


class Compute(Skill):
    """Compute one thing."""

    function: Callable[..., Any] = staticmethod(lambda a, b: a - b)
    isolated: bool | None = None

    def run(self) -> Work[Counted]:
        how = {} if self.isolated is None else {"isolated": self.isolated}
        result = yield from self.compute(self.function, 5, 3, **how)
        return Counted(result)


@pytest.mark.parametrize("computing", [0, 1, 3])
def test_a_result_is_there_in_the_next_tick_at_the_earliest(computing):
    ended = drive(Compute(), computing=computing, period=1.0)
    assert ended.outputs == {"count": 2}
    assert ended.duration == 1.0 + computing
    assert ended.cancelled == 0


def test_an_exception_of_a_computation_is_raised_in_the_body():
    skill = Compute()
    skill.function = lambda a, b: a / 0
    with pytest.raises(ZeroDivisionError):
        drive(skill)


def test_an_interrupted_computation_is_given_up():
    ended = drive(Compute(), computing=10, interrupt_after=3)
    assert (ended.status, ended.cancelled) == (Status.INVALID, 1)


@pytest.mark.parametrize(("asked", "isolated"), [(None, False), (False, False), (True, True)])
def test_a_computation_is_isolated_only_where_that_is_asked(asked, isolated):
    seen: list[tuple[str, bool]] = []

    class Watching(Context):
        def compute(self, node, function, *arguments, isolated):
            seen.append((node, isolated))
            return super().compute(node, function, *arguments, isolated=isolated)

    skill = Compute()
    skill.isolated = asked
    bound(skill, Watching())
    skill.tick_once()
    assert seen == [("/tree/it", isolated)]


@pytest.mark.parametrize(
    ("duration", "period", "ticks"),
    [(0.0, 1.0, 1), (0.5, 1.0, 2), (1.0, 1.0, 2), (1.5, 1.0, 3), (0.8, 0.1, 9)],
    ids=["none", "half", "one", "more", "eight tenths, whose sum is less than 0.8"],
)
def test_a_wait_ends_in_the_first_tick_at_or_after_its_time(duration, period, ticks):
    class Pause(Skill):
        def run(self) -> Work[None]:
            yield from self.wait(duration)

    skill = Pause()
    context, _written = bound(skill)
    seen = 0
    while skill.status is not Status.SUCCESS:
        skill.tick_once()
        context.clock.advance(period)
        seen += 1
    assert seen == ticks


# ------------------------------------------------------------------------------------------------- services


def test_what_it_publishes_is_recorded_under_its_path():
    class Show(Skill):
        def run(self) -> None:
            self.publish("width", 3)

    class Listening(Context):
        def publish(self, node, topic, value):
            self.log.append(f"{node} {topic} {value}")

    skill = Show()
    context, _written = bound(skill, Listening())
    skill.tick_once()
    assert "/tree/it width 3" in context.log


def test_its_random_numbers_depend_on_run_node_and_start_alone():
    class Roll(Skill):
        def run(self) -> Counted:
            return Counted(int(self.rng().integers(1 << 60)))

    def rolled(path: str, run_seed: int) -> list[object]:
        skill, found = Roll(), []
        context = Context(run_seed=run_seed)
        skill.bind(context, path, dict, lambda _name, value: found.append(value))
        statuses(skill, 2)
        return found

    first = rolled("/a", 1)
    assert first == rolled("/a", 1)
    assert len({*first, *rolled("/b", 1), *rolled("/a", 2)}) == 6


def test_devices_and_the_clock_are_those_of_the_run():
    skill = Drive()
    context, _written = bound(skill)
    assert skill.context is context
    assert skill.clock is context.clock
    assert skill.optional_device(Lamp) is None
    context.devices = {**context.devices, Lamp: object()}
    assert skill.optional_device(Lamp) is not None
    assert skill.optional_device(Belt) is not None


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda skill: skill.device(Lamp), "uses Lamp, which is not in its `devices`"),
        (
            lambda skill: skill.optional_device(Steel),
            "uses Steel, which is not in its `optional_devices`",
        ),
    ],
)
def test_a_device_that_is_not_declared_is_refused(ask, says):
    skill = Drive()
    bound(skill)
    with pytest.raises(SkillError, match=says):
        ask(skill)


def test_a_skill_outside_of_a_run_has_no_services():
    with pytest.raises(SkillError, match="Drive: is not bound to a run"):
        Drive().device(Belt)


def test_a_command_after_its_end_is_refused():
    class Keep(Skill):
        devices = (Belt,)

        def run(self) -> Work[None]:
            self.belt = self.device(Belt)
            self.belt.go()
            yield None

    skill = Keep()
    context, _written = bound(skill)
    assert statuses(skill, 2) == ["RUNNING", "SUCCESS"]
    with pytest.raises(NotOwnerError, match="the skill has ended"):
        skill.belt.go()
    assert context.devices[Belt].log == ["go"]


def test_a_known_input_may_be_read_before_the_run():
    skill = Instant()
    assert skill.known("number") is None
    bound(skill, number=3)
    assert skill.known("number") == 3
    assert skill.known("other") is None

    def unknown() -> dict[str, object]:
        raise SkillFailure(Failure("UNSET", "only known in the run"))

    skill.bind(Context(), "/it", unknown, lambda _name, _value: None)
    assert skill.known("number") is None


def test_the_path_of_the_skill_that_is_polled_is_known_only_meanwhile():
    class Look(Skill):
        def run(self) -> None:
            self.seen = POLLED.get()

    skill = Look()
    bound(skill)
    skill.tick_once()
    assert (skill.seen, POLLED.get()) == ("/tree/it", "")


def test_the_time_that_a_poll_kept_the_tick_waiting_is_measured(monkeypatch):
    times = iter([10.0, 10.25])
    monkeypatch.setattr(skill_module.time, "perf_counter", lambda: next(times))
    skill = Instant()
    bound(skill)
    assert skill.blocked == 0.0
    skill.tick_once()
    assert skill.blocked == 0.25


# ------------------------------------------------------------------------------------------- declarations


def test_by_default_a_skill_moves_all_its_devices_and_instant_work_none():
    class Looks(Drive):
        moves = ()

    class One(Drive):
        devices = (Belt, Lamp)
        moves = (Belt,)

    assert [kind.claims() for kind in (Drive, Instant, Looks, One, Skill)] == [
        (Belt,), (), (), (Belt,), (),
    ]  # fmt: skip


def test_what_a_skill_is_without_declarations():
    assert (Skill.devices, Skill.optional_devices, Skill.failures) == ((), (), ())
    assert (dict(Skill.inputs), dict(Skill.outputs), Skill.own_speed) == ({}, {}, False)
    assert (Skill.moves, dict(Skill.renamed_failures)) == (None, {})
    assert list(Skill.judge({}, None)) == list(Skill.offers("port", None)) == []
    skill = Count()
    assert (skill.name, skill.path, Count("own").name) == ("Count", "Count", "own")


def test_ports_are_declared_once():
    with pytest.raises(SkillError, match="inputs, outputs are declared by the signature"):

        class Twice(Skill):
            inputs = Ports(number=int)
            outputs = Ports(count=int)

            def run(self, number: int) -> Counted:
                return Counted(number)


def test_a_subclass_has_the_ports_of_its_base_and_takes_no_keywords():
    class Faster(Count):
        pass

    with pytest.raises(TypeError):

        class Keyed(Count, key=1):
            pass

    assert (Faster.inputs, Faster.outputs) == (Count.inputs, Count.outputs)


@pytest.mark.parametrize(
    ("own", "slowed_by", "expected"), [(False, (), 0.5), (False, (0.5, 0.2), 0.05), (True, (0.5,), 1.0)]
)  # fmt: skip
def test_its_speed_is_the_operators_share_of_the_trees_shares(own, slowed_by, expected):
    class Move(Skill):
        own_speed = own

    skill = Move()
    skill.slowed_by += [lambda share=share: share for share in slowed_by]
    assert skill.speed(0.5) == pytest.approx(expected)


def test_its_log_drops_lines_below_info(caplog):
    with caplog.at_level(logging.DEBUG):
        Count().logger.debug("each stop")
        Count().logger.info("once")
    assert [record.message for record in caplog.records] == ["once"]


# ------------------------------------------------------------------------------------------- a run's process


@pytest.fixture
def gc_as_before() -> Iterator[None]:
    yield
    gc.enable()


@pytest.mark.usefixtures("gc_as_before")
def test_in_a_run_nothing_is_collected_and_afterwards_it_is_again():
    gc.enable()
    with run_in_progress():
        assert not gc.isenabled()
        with run_in_progress():
            leave_if_forked()
        assert skill_module._process == os.getpid()
    assert gc.isenabled()
    assert skill_module._process is None


@pytest.mark.parametrize(
    ("come_back", "status"),
    [("poll", 3), ("leave", 3), ("go on", 0)],
)
def test_a_forked_child_is_ended_where_it_comes_back_into_the_run(come_back, status, capfd):
    child = 0
    with run_in_progress():
        child = os.fork()
        if child == 0 and come_back != "leave":
            if come_back == "go on":
                continue_here()
            leave_if_forked()
            os._exit(0)
    if child == 0:  # it has left the run without being ended
        os._exit(4)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == status
    assert ("came back into it, and was ended" in capfd.readouterr().err) == (status == 3)
