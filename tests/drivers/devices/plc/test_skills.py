"""WaitSignal, SetSignal and Handshake on a mock PLC: success, each failure code, interruption, wrong names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from py_trees.common import Status

from pomona.devices.plc.signals import SignalNames, Signals
from pomona.devices.plc.skills import Handshake, SetPartial, SetSignal, WaitSignal
from pomona.executive import ManualClock, SkillEnd, drive
from pomona.executive.account import HELD_FRUIT, Account, AccountEntry
from pomona.executive.skill_testing import BenchContext
from tests.drivers.devices.plc.mock_signals import MockSignals

EDGES = {"request": "change", "accepted": "taken", "done": "ready"}


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def plc(clock: ManualClock) -> MockSignals:
    return MockSignals(
        clock, {"start": False, "mass": 1.5, "taken": False, "ready": False}, ("change", "busy")
    )


def code(end: SkillEnd) -> str:
    assert end.reason is not None
    assert len(end.reason.message) > 15
    return end.reason.code


def wait(
    plc: MockSignals,
    clock: ManualClock,
    script: Callable[[int], None] | None = None,
    **inputs: object,
) -> SkillEnd:
    return drive(WaitSignal(), inputs, {Signals: plc}, clock=clock, each_tick=script)


def test_a_signal_is_waited_for(plc: MockSignals, clock: ManualClock) -> None:
    end = wait(
        plc, clock, lambda tick: plc.values.update(start=tick >= 50), signal="start", within=2.0
    )
    assert end.status is Status.SUCCESS
    assert end.outputs == {"value": 1.0}
    assert end.duration == pytest.approx(1.0, abs=0.03)


def test_a_switch_that_is_on_already_starts_nothing(plc: MockSignals, clock: ManualClock) -> None:
    plc.values.update(start=True)
    end = wait(plc, clock, signal="start", within=2.0)
    assert code(end) == "SIGNAL_TIMEOUT"
    assert "'start' was not on anew within 2 s; it is on" in end.reason.message
    again = lambda tick: plc.values.update(start=tick != 50)  # noqa: E731
    end = wait(plc, clock, again, signal="start", within=2.0)
    assert end.duration == pytest.approx(1.02, abs=0.03)
    assert wait(plc, clock, signal="start", level=True, within=2.0).duration == 0.0
    assert wait(plc, clock, signal="start", within=0.0).status is Status.SUCCESS


@pytest.mark.parametrize(("before", "counts"), [(0.1, True), (2.0, False)])
def test_a_switch_that_rose_just_before_it_was_waited_for_counts(
    plc: MockSignals, clock: ManualClock, before: float, counts: bool
) -> None:
    assert code(wait(plc, clock, signal="taken", within=0.1)) == "SIGNAL_TIMEOUT"
    plc.values.update(start=True)
    clock.advance(before)
    end = wait(plc, clock, signal="start", within=0.1)
    assert (end.status is Status.SUCCESS) is counts


def test_a_number_is_waited_for_within_limits(plc: MockSignals, clock: ManualClock) -> None:
    assert wait(plc, clock, signal="mass", least=1.0, most=2.0).outputs == {"value": 1.5}
    assert code(wait(plc, clock, signal="mass", least=2.0, within=0.1)) == "SIGNAL_TIMEOUT"


def test_a_signal_that_does_not_come_fails_at_its_deadline_with_its_value(
    plc: MockSignals, clock: ManualClock
) -> None:
    end = wait(plc, clock, signal="start", within=0.5)
    assert code(end) == "SIGNAL_TIMEOUT"
    assert "'start' was not on within 0.5 s; it is off" in end.reason.message
    assert end.reason.data["value"] is False
    assert end.duration == pytest.approx(0.5, abs=0.03)
    assert wait(plc, clock, signal="start", within=0.0).duration == 0.0


def test_an_unknown_value_is_not_off(plc: MockSignals, clock: ManualClock) -> None:
    assert wait(plc, clock, signal="start", state=False, within=0.0).status is Status.SUCCESS
    plc.inject_fault("stopped")
    clock.advance(0.3)
    end = wait(plc, clock, signal="start", state=False, within=0.0)
    assert code(end) == "SIGNAL_UNKNOWN"
    assert "300 ms old" in end.reason.message


def test_a_name_that_the_plc_lacks_is_named_with_those_that_it_has(
    plc: MockSignals, clock: ManualClock
) -> None:
    for skill, inputs in (
        (WaitSignal, {"signal": "busy"}),
        (SetSignal, {"signal": "start"}),
        (Handshake, {**EDGES, "request": "taken"}),
        (Handshake, {**EDGES, "done": "change"}),
    ):
        end = drive(skill(), inputs, {Signals: plc}, clock=clock)
        assert code(end) == "NO_SIGNAL"
        assert "it has" in end.reason.message
    assert plc.rises("change", -1.0, 1e9) == []


def test_a_wrong_name_is_found_before_the_run_with_a_hint() -> None:
    class PlcCell:
        name = "bench"

        def known(self, what: type) -> object:
            return SignalNames(("start", "taken"), ("change",)) if what is SignalNames else None

        def place(self, interface: type) -> None:
            return None

    (problem,) = WaitSignal.judge({"signal": "stat"}, PlcCell())
    assert (problem.key, problem.hint) == ("signal", "did you mean 'start'?")
    assert "has no input 'stat'" in problem.message
    assert [one.key for one in Handshake.judge({**EDGES, "request": "start"}, PlcCell())] == [
        "done",
        "request",
    ]
    assert list(SetSignal.judge({"signal": "change"}, PlcCell())) == []
    assert tuple(SetSignal.offers("signal", PlcCell())) == ("change",)
    assert tuple(Handshake.offers("done", PlcCell())) == ("start", "taken")


def test_an_author_says_whether_a_switch_that_is_on_already_counts() -> None:
    wait = {"signal": "start", "state": True, "within": 5.0, "level": None}
    (problem,) = WaitSignal.judge(wait, None)
    assert problem.warning
    assert "level: true" in problem.hint
    for said in ({"level": False}, {"state": False}, {"within": 0.0}, {"least": 1.0}):
        assert list(WaitSignal.judge({**wait, **said}, None)) == []


def test_an_output_is_set_and_stays(plc: MockSignals, clock: ManualClock) -> None:
    assert (
        drive(SetSignal(), {"signal": "busy"}, {Signals: plc}, clock=clock).status is Status.SUCCESS
    )
    assert plc.read("busy").value is True
    drive(SetSignal(), {"signal": "busy", "state": False}, {Signals: plc}, clock=clock)
    assert plc.read("busy").value is False


def told_of_orders(
    plc: MockSignals, clock: ManualClock, account: Account, orders: Any
) -> list[Any]:
    """What SetPartial tells after each order, of which each is a press, what it lacks, and its evidence."""
    context = BenchContext(clock, {Signals: plc})
    skill = SetPartial()
    skill.bind(context, "SetPartial", lambda: {"signal": "busy"}, {}.__setitem__)
    told = []
    for press, lacking, evidence in orders:
        account.add(AccountEntry("the pads", "pressed", press))
        account.add(AccountEntry("fruit 1", lacking))
        if evidence:
            account.add(AccountEntry(evidence, "pads 2.0 N"))
        context.lacking = (
            account.verified,
            account.bruises,
            *filter(None, account.lacking.values()),
        )
        skill.tick_once()
        while skill.status is Status.RUNNING:
            clock.advance(0.02)
            skill.tick_once()
        assert skill.status is Status.SUCCESS
        told.append(plc.read("busy").value)
    return told


def test_an_order_that_bruised_its_fruit_is_told_as_done_in_part_and_the_next_one_is_not(
    plc: MockSignals, clock: ManualClock
) -> None:
    orders = [(p, "", "") for p in (0.9, 1.2, 0.5, 1.1)] + [(0.5, "left", ""), (0.5, "left", "")]
    told = told_of_orders(plc, clock, Account(), orders)
    assert told == [False, True, False, True, True, False]


def test_two_orders_that_lack_the_same_are_both_told_as_done_in_part(
    plc: MockSignals, clock: ManualClock
) -> None:
    account = Account("put_away")
    told = []
    for words in ("it has turned", "it has turned", ""):
        account.add(AccountEntry(HELD_FRUIT, words))
        told += told_of_orders(plc, clock, account, [(0.5, "", "put_away")])
    assert told == [True, True, False]


def test_an_order_whose_success_nothing_measured_is_told_as_done_in_part(
    plc: MockSignals, clock: ManualClock
) -> None:
    orders = [(0.5, "", evidence) for evidence in ("put_away", "held", "put_away", "", "put_away")]
    told = told_of_orders(plc, clock, Account("put_away"), orders)
    assert told == [False, True, False, True, False]


def test_an_output_that_the_plc_does_not_take_fails_at_its_deadline(
    plc: MockSignals, clock: ManualClock
) -> None:
    plc.inject_fault("deaf")
    end = drive(SetSignal(), {"signal": "busy", "within": 0.3}, {Signals: plc}, clock=clock)
    assert code(end) == "SIGNAL_NOT_TAKEN"
    assert end.duration == pytest.approx(0.3, abs=0.03)


def test_a_value_that_does_not_fit_or_a_latched_plc_is_refused(
    plc: MockSignals, clock: ManualClock
) -> None:
    assert (
        code(drive(SetSignal(), {"signal": "busy", "number": 3.0}, {Signals: plc}, clock=clock))
        == "SIGNAL_REFUSED"
    )
    plc.safe_stop("the operator")
    assert (
        code(drive(SetSignal(), {"signal": "busy"}, {Signals: plc}, clock=clock))
        == "SIGNAL_REFUSED"
    )
    assert code(drive(Handshake(), EDGES, {Signals: plc}, clock=clock)) == "SIGNAL_REFUSED"


def answering(plc: MockSignals, clock: ManualClock, stuck: str = "") -> Callable[[int], None]:
    """A PLC that accepts after 100 ms and is done after 300 ms; `stuck` is the edge that it leaves out."""

    def each_tick(tick: int) -> None:
        now = clock.now()
        asked = bool(plc.written_at("change", now - 0.1))
        if stuck != "accepted":
            plc.values["taken"] = asked or (stuck == "released" and plc.values["taken"])
        if stuck != "done":
            plc.values["ready"] = bool(plc.written_at("change", now - 0.3))

    return each_tick


def shake(plc: MockSignals, clock: ManualClock, stuck: str = "", **how: object) -> SkillEnd:
    script = answering(plc, clock, stuck)
    return drive(
        Handshake(),
        {**EDGES, "done_within": 2.0},
        {Signals: plc},
        clock=clock,
        each_tick=script,
        **how,
    )


def test_a_handshake_passes_its_four_edges(plc: MockSignals, clock: ManualClock) -> None:
    end = shake(plc, clock)
    assert end.status is Status.SUCCESS, end.reason
    assert plc.read("change").value is False
    assert len(plc.rises("change", -1.0, 1e9)) == 1
    assert end.duration == pytest.approx(0.6, abs=0.1)


@pytest.mark.parametrize(
    ("edge", "signal", "after"),
    [("accepted", "taken", 1.0), ("done", "ready", 2.1), ("released", "taken", 1.3)],
)
def test_a_missed_edge_is_named_and_the_request_is_withdrawn(
    plc: MockSignals, clock: ManualClock, edge: str, signal: str, after: float
) -> None:
    end = shake(plc, clock, stuck=edge)
    assert code(end) == "EDGE_MISSED"
    assert (end.reason.data["edge"], end.reason.data["signal"]) == (edge, signal)
    assert end.duration == pytest.approx(after, abs=0.1)
    assert plc.read("change").value is False


def test_a_line_that_is_not_free_is_a_missed_request_and_nothing_is_asked(
    plc: MockSignals, clock: ManualClock
) -> None:
    plc.values["ready"] = True
    end = drive(Handshake(), EDGES, {Signals: plc}, clock=clock)
    assert code(end) == "EDGE_MISSED"
    assert (end.reason.data["edge"], end.reason.data["signal"]) == ("request", "ready")
    assert plc.rises("change", -1.0, 1e9) == []


def test_a_request_that_the_plc_does_not_take_is_a_missed_request(
    plc: MockSignals, clock: ManualClock
) -> None:
    plc.inject_fault("deaf")
    end = drive(Handshake(), EDGES, {Signals: plc}, clock=clock)
    assert (code(end), end.reason.data["edge"], end.reason.data["signal"]) == (
        "EDGE_MISSED",
        "request",
        "change",
    )


def test_an_unknown_value_ends_a_handshake_at_its_edge(
    plc: MockSignals, clock: ManualClock
) -> None:
    script = answering(plc, clock, stuck="done")

    def stopping(tick: int) -> None:
        script(tick)
        if tick == 20:
            plc.inject_fault("stopped")

    end = drive(Handshake(), EDGES, {Signals: plc}, clock=clock, each_tick=stopping)
    assert (code(end), end.reason.data["edge"]) == ("SIGNAL_UNKNOWN", "done")
    assert plc.read("change").value is False


@pytest.mark.parametrize("ticks", [2, 10, 20])
def test_an_interrupted_handshake_withdraws_its_request(
    plc: MockSignals, clock: ManualClock, ticks: int
) -> None:
    end = shake(plc, clock, interrupt_after=ticks)
    assert end.status is Status.INVALID
    assert plc.read("change").value is False
    assert len(plc.rises("change", -1.0, 1e9)) == 1
