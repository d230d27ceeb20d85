"""Signals raise while nothing moves, ask a run for its safe state, and break a tick that hangs."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from fake_cell import FakeCell
from fake_runs import Turn, make

from pomona.executive.registry import Registry
from pomona.executive.running import signals as module
from pomona.executive.running.events import Event, OperatorActed
from pomona.executive.running.runner import Runner
from pomona.executive.running.signals import RunSignals, Terminated, raising, signalled, status_of
from pomona.executive.skill import Skill, Work
from pomona.executive.values.processes import WORDS

LONG = "pomona: 1\ntree: t\nroot: {Turn: {duration: 9 s}}"


@pytest.fixture(autouse=True)
def received() -> Iterator[None]:
    """Receive signals as in a process started from a terminal."""
    before = {number: signal.getsignal(number) for number in WORDS}
    for number in before:
        signal.signal(
            number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
        )
    yield
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    for number, handler in before.items():
        signal.signal(number, handler)


def send(number: int) -> None:
    os.kill(os.getpid(), number)


def run(
    at_tick: dict[int, Callable[[Runner, FakeCell], Any]], registry: Registry | None = None
) -> tuple[Any, FakeCell, list[Event], RunSignals]:
    runner, cell, events = make(LONG, registry or Registry({"Turn": Turn}), at_tick)
    with RunSignals() as signals, signals.ask(runner):
        result = runner.run()
    return result, cell, events, signals


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_while_nothing_moves_a_signal_raises(number: int, status: int) -> None:
    with pytest.raises(KeyboardInterrupt) as raised, raising(), RunSignals():
        send(number)
    assert status_of(raised.value) == status


@pytest.mark.parametrize("number", list(WORDS))
@pytest.mark.parametrize("early", [True, False])
def test_a_signal_that_a_library_swallowed_ends_the_run_before_it_begins(
    number: signal.Signals, early: bool
) -> None:
    """Swallow an exception in a callback as ctypes does: compiling with LLVM calls back."""
    runner, cell, events = make(LONG, Registry({"Turn": Turn}), {})

    def swallow() -> None:
        with pytest.raises(KeyboardInterrupt):
            send(number)

    def begin() -> None:
        if early:
            swallow()
        with RunSignals() as signals:
            swallow()
            with signals.ask(runner):
                runner.run()

    with pytest.raises(KeyboardInterrupt) as raised, raising():
        begin()
    assert status_of(raised.value) == 128 + number
    assert events == []
    assert cell.wheel.log == []


@pytest.mark.parametrize("number", list(WORDS))
def test_a_signal_that_was_swallowed_in_a_callback_ends_whatever_goes_on(
    number: signal.Signals,
) -> None:
    """ctypes passes an exception in a callback to the unraisable hook, and continues."""
    call_back = ctypes.CFUNCTYPE(None)(lambda: send(number))
    went_on: list[bool] = []

    def compute() -> None:
        call_back()
        went_on.append(True)
        threading.Event().wait(20.0)
        went_on.append(False)

    with pytest.raises(KeyboardInterrupt) as raised, raising():
        compute()
    assert status_of(raised.value) == 128 + number
    assert went_on == [True]


def test_a_failure_after_a_swallowed_signal_is_still_that_signal() -> None:
    """As in a compiler, which then misses its input."""

    def prepare() -> None:
        with RunSignals():
            with contextlib.suppress(KeyboardInterrupt):
                send(signal.SIGTERM)
            raise RuntimeError("no compiled object yet")

    with pytest.raises(KeyboardInterrupt) as raised, raising():
        prepare()
    assert status_of(raised.value) == 143
    with pytest.raises(RuntimeError), raising(), RunSignals():
        raise RuntimeError("without a signal it is what it is")


@pytest.mark.parametrize("when", ["before a cell", "beside a cell"])
def test_output_cut_by_a_signal_prints_nothing_and_other_unraisable_errors_do(
    when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a library's destructor does, whose object was never finished."""
    told: list[str] = []
    monkeypatch.setattr("sys.unraisablehook", lambda what: told.append(str(what.exc_value)))

    class Unfinished:
        def __init__(self, words: str) -> None:
            self.words = words

        def __del__(self) -> None:
            raise AttributeError(self.words)

    def begin() -> None:
        Unfinished("before")
        with RunSignals() if when == "beside a cell" else contextlib.nullcontext():
            cut = Unfinished("cut")
            send(signal.SIGTERM)
            del cut

    with pytest.raises(KeyboardInterrupt), raising():
        begin()
    assert told == ["before"]


@pytest.mark.parametrize("number", list(WORDS))
def test_in_a_run_a_signal_is_a_safe_stop_with_its_name(number: signal.Signals) -> None:
    result, cell, events, signals = run({4: lambda *_: wait_for_latch(_[1], number)})
    assert result.outcome == "stopped"
    assert result.interrupted is (number == signal.SIGINT)
    assert cell.latched == WORDS[number]
    assert cell.wheel.log == ["start", "stop", "at rest"]
    assert [event.action for event in events if isinstance(event, OperatorActed)] == ["interrupt"]
    assert signals.number == number


def wait_for_latch(cell: FakeCell, number: int) -> None:
    stopped = threading.Event()
    safe_stop = cell.safe_stop

    def noted(reason: str) -> None:
        safe_stop(reason)
        stopped.set()

    cell.safe_stop = noted  # type: ignore[method-assign]
    send(number)
    assert stopped.wait(5.0)


def test_signals_in_quick_succession_are_one() -> None:
    def twice(_runner: Runner, cell: FakeCell) -> None:
        wait_for_latch(cell, signal.SIGINT)
        send(signal.SIGINT)
        send(signal.SIGTERM)

    result, cell, _events, signals = run({4: twice})
    assert result.interrupted
    assert cell.wheel.log[-1] == "at rest"
    assert signals.number == signal.SIGINT


def test_a_tick_that_hangs_is_broken_by_the_second_signal_and_the_cell_is_stopped_by_the_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "STUCK", 0.0)
    stopped: list[str | None] = []

    class Hang(Skill):
        """Never returns from a tick."""

        def run(self) -> Work:
            send(signal.SIGINT)
            while cell.latched is None:
                pass
            stopped.append(cell.latched)
            send(signal.SIGINT)
            while True:
                pass
            yield None

    runner, cell, events = make("pomona: 1\ntree: t\nroot: {Hang: {}}", Registry({"Hang": Hang}))
    with RunSignals() as signals, signals.ask(runner):
        result = runner.run()
    assert stopped == ["interrupted from the keyboard"]
    assert result.outcome == "stopped"
    assert result.reason is not None
    assert result.reason.code == "INTERRUPTED"
    assert "test_signals.py" in str(result.reason.data["place"])  # where it hung
    assert any("in run" in getattr(event, "traceback", "") for event in events)


def test_while_record_and_cell_are_closed_a_signal_waits() -> None:
    with RunSignals() as signals:
        signals.wait()
        send(signal.SIGTERM)
        assert signals.number == signal.SIGTERM


def test_objects_ignored_at_the_start_stay_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with raising(), RunSignals():
        send(signal.SIGHUP)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def test_outside_the_main_thread_nothing_is_installed() -> None:
    found = []

    def look() -> None:
        with RunSignals():
            found.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert found == [signal.SIG_DFL]


def test_a_terminated_process_is_an_interrupted_one_to_its_waiter() -> None:
    assert isinstance(Terminated(signal.SIGHUP), KeyboardInterrupt)
    assert "terminal was closed" in str(Terminated(signal.SIGHUP))


def test_a_signal_that_broke_the_loading_of_a_compiled_module_is_still_a_signal() -> None:
    """As MuJoCo's modules, made with pybind11, report it."""
    error = ImportError("initialization failed")
    error.__cause__ = ImportError("initialization failed")
    error.__cause__.__cause__ = Terminated(signal.SIGTERM)
    ended = signalled(error)
    assert ended is not None
    assert status_of(ended) == 143
    assert signalled(ImportError("no module named mujoco")) is None
