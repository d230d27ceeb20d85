"""Work beside the tick: results, errors, cancelling and crashing workers."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from types import SimpleNamespace

import pytest

from pomona.executive.running import compute, traces
from pomona.executive.running.compute import Computations, WorkerDied
from pomona.executive.values.processes import WORDS


@pytest.fixture
def computations() -> Iterator[Computations]:
    service = Computations()
    yield service
    service.close()


def square(x: int) -> int:
    return x * x


def fail(text: str) -> None:
    raise ValueError(text)


def own_process() -> int:
    return os.getpid()


def spin() -> None:
    while True:
        pass


def crash() -> None:
    os._exit(7)


def unpicklable() -> object:
    return threading.Lock()


@pytest.mark.parametrize("isolated", [False, True])
def test_a_result_comes_back(computations: Computations, isolated: bool) -> None:
    computation = computations.submit("node", square, (7,), isolated)
    assert computations.wait(30.0)
    assert computation.result() == 49


@pytest.mark.parametrize("isolated", [False, True])
def test_an_exception_comes_back_as_it_was_raised(
    computations: Computations, isolated: bool
) -> None:
    computation = computations.submit("node", fail, ("no such pose",), isolated)
    with pytest.raises(ValueError, match="no such pose"):
        computation.result()


def test_isolated_work_runs_in_another_process_that_stays_warm(computations: Computations) -> None:
    first = computations.submit("node", own_process, (), True).result()
    second = computations.submit("node", own_process, (), True).result()
    assert first == second != os.getpid()


def test_cancelling_kills_a_worker_that_never_returns_and_the_next_call_works(
    computations: Computations,
) -> None:
    stuck = computations.submit("node", spin, (), True)
    assert not computations.wait(0.01)
    stuck.cancel()
    assert computations.wait(1.0)
    assert computations.submit("node", square, (3,), True).result() == 9


def test_a_crashed_worker_is_named_with_its_exit_code(computations: Computations) -> None:
    computation = computations.submit("node", crash, (), True)
    with pytest.raises(WorkerDied, match=r"crash died \(exit code 7\)"):
        computation.result()
    assert computations.submit("node", square, (3,), True).result() == 9


def test_a_result_that_cannot_travel_is_an_error_and_not_a_hang(computations: Computations) -> None:
    with pytest.raises(RuntimeError, match="cannot be sent back"):
        computations.submit("node", unpicklable, (), True).result()


def test_an_ended_computation_is_reported_once_with_its_node() -> None:
    ended: list[tuple[str, str]] = []
    computations = Computations(
        lambda node, function, wall: ended.append((node, function.rsplit(".")[-1]))
    )
    computations.submit("0/Plan", square, (2,), False)
    assert computations.wait(5.0)
    assert not computations.pending()
    computations.close()
    assert ended == [("0/Plan", "square")]


# ------------------------------------------------------------------------- the worker's loop, without a process


class Both(Exception):
    """An error that cannot be made from its message alone."""

    def __init__(self, code: int, message: str) -> None:
        self.code = code
        super().__init__(message)


def fail_twofold() -> None:
    raise Both(3, "two arguments")


def leave() -> None:
    raise SystemExit(4)


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[Connection]:
    """The parent's end of a worker's loop that runs in a thread here."""
    monkeypatch.setattr(compute.signal, "signal", lambda *_: None)
    monkeypatch.setattr(compute, "_end_with_parent", lambda _runs: None)
    here, there = multiprocessing.Pipe()
    loop = threading.Thread(target=compute._serve, args=(there, False))
    loop.start()
    yield here
    here.close()
    loop.join(10.0)
    assert not loop.is_alive()  # the parent's end is the loop's end


def test_a_worker_answers_each_request_and_goes_on_after_errors(served: Connection) -> None:
    for function, arguments, answer in (
        (square, (7,), (True, 49)),
        (fail, ("no such pose",), (False, "no such pose")),
        (unpicklable, (), (False, "the result cannot be sent back: ")),
        (leave, (), (False, "4")),
        (square, (3,), (True, 9)),
    ):
        served.send((function, arguments))
        assert served.poll(10.0)
        succeeded, value = served.recv()
        assert succeeded is answer[0]
        assert value == answer[1] if succeeded else str(value).startswith(str(answer[1]))


def test_an_error_travels_with_its_place_and_its_traceback(served: Connection) -> None:
    served.send((fail, ("no such pose",)))
    _, error = served.recv()
    assert type(error) is ValueError
    (note,) = error.__notes__
    assert note.startswith("in the worker process:\n")
    assert "raise ValueError(text)" in note
    assert traces.place_of(error) == traces.place_of(raised(lambda: fail("x")))
    served.send((fail_twofold, ()))
    _, error = served.recv()
    assert type(error) is RuntimeError
    assert str(error).startswith("Both: two arguments")
    assert "fail_twofold" in error.__notes__[0]


def raised(work: Callable[[], object]) -> BaseException:
    try:
        work()
    except BaseException as error:
        return error
    raise AssertionError


@pytest.mark.parametrize("runs", [False, True])
def test_a_worker_ignores_the_terminals_signals_and_one_that_runs_takes_sigterm(
    monkeypatch: pytest.MonkeyPatch, runs: bool
) -> None:
    ignored: list[int] = []
    monkeypatch.setattr(compute.signal, "signal", lambda number, how: ignored.append(number))
    monkeypatch.setattr(compute, "_end_with_parent", lambda _runs: None)
    here, there = multiprocessing.Pipe()
    here.close()
    compute._serve(there, runs)
    assert set(ignored) == {number for number in WORDS if not (runs and number == signal.SIGTERM)}


@pytest.mark.parametrize("runs", [False, True])
def test_a_worker_ends_with_its_parent_and_a_run_has_time_for_its_safe_state(
    monkeypatch: pytest.MonkeyPatch, runs: bool
) -> None:
    did: list[object] = []
    parent = SimpleNamespace(join=lambda: did.append("joined"))
    monkeypatch.setattr(compute.multiprocessing, "parent_process", lambda: parent)
    monkeypatch.setattr(compute.os, "kill", lambda *told: did.append(told))
    monkeypatch.setattr(compute.time, "sleep", did.append)
    monkeypatch.setattr(compute.os, "_exit", did.append)
    compute._end_with_parent(runs)
    stop = [(os.getpid(), signal.SIGTERM), 15.0] if runs else []
    assert did == ["joined", *stop, 1]
    did.clear()
    monkeypatch.setattr(compute.multiprocessing, "parent_process", lambda: None)
    compute._end_with_parent(runs)
    assert did == []


class Idle:
    """Stands for a worker."""

    def __init__(self, alive: bool = True) -> None:
        self.process = SimpleNamespace(is_alive=lambda: alive)
        self.killed = False

    def kill(self) -> None:
        self.killed = True


def test_workers_are_taken_again_while_they_live_and_kept_for_the_next_run_if_that_is_wanted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    new = Idle()
    monkeypatch.setattr(compute, "Worker", lambda: new)
    monkeypatch.setattr(compute, "_spare", None)  # another test may have kept one
    service, dead, alive = Computations(), Idle(False), Idle()
    service._give_back(None)
    assert service._take() is new
    service._give_back(alive)  # type: ignore[arg-type]
    service._give_back(dead)  # type: ignore[arg-type]
    assert service._take() is alive
    assert (dead.killed, alive.killed) == (True, False)
    assert service._take() is new
    service._give_back(alive)  # type: ignore[arg-type]
    service.close()
    assert alive.killed
    monkeypatch.setattr(compute.atexit, "register", lambda *_: None)
    compute.keep_workers_warm()
    compute.keep_workers_warm()
    kept, service = Idle(), Computations()
    service._give_back(kept)  # type: ignore[arg-type]
    service.close()
    assert not kept.killed
    assert Computations()._take() is kept


def test_waiting_ends_when_all_has_ended_or_the_time_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now, go = [0.0], threading.Event()
    monkeypatch.setattr(compute.time, "perf_counter", lambda: now[0])
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        now[0] += seconds

    monkeypatch.setattr(compute.time, "sleep", sleep)
    walls: list[float] = []
    service = Computations(lambda _node, _function, wall: walls.append(wall))
    assert not service.started
    assert service.wait(1.0)
    computation = service.submit("node", go.wait, (), False)
    assert service.started
    assert not service.wait(0.0012)
    assert slept == [0.0005, 0.0005, pytest.approx(0.0002)]
    go.set()
    computation.result()
    assert service.wait(1.0)
    assert walls == [pytest.approx(0.0012)]
    assert not service.started
    service.close()
