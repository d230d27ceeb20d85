"""Work beside the tick: results, errors, cancelling and crashing workers."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator

import pytest

from pomona.executive.running.compute import Computations, WorkerDied


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
