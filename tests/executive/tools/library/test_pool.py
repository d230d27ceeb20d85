"""Local processes: answers, exceptions, deaths and time limits."""

from __future__ import annotations

import os
import signal
from contextlib import closing
from pathlib import Path

import pytest

from pomona.tools.library.pool import ONE_THREAD, OrderLost, OrderTooLong, WorkerPool


def half(number: int) -> int:
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number // 2


def die(_number: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def die_once(mark: str) -> str:
    if not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "lived"


def wait_for_ever(_number: int) -> None:
    signal.pause()


def process(_number: int) -> int:
    return os.getpid()


def environment(name: str) -> str | None:
    return os.environ.get(name)


def test_every_order_is_answered_by_a_result_or_its_exception() -> None:
    with closing(WorkerPool(2)) as pool:
        answers = dict(pool.map(half, [(i,) for i in range(7)], 60.0))
        again = dict(pool.map(half, [(8,)], 60.0))
    assert {i: answers[i] for i in (0, 2, 4, 6)} == {0: 0, 2: 1, 4: 2, 6: 3}
    assert [str(answers[i]) for i in (1, 3, 5)] == ["1 is odd", "3 is odd", "5 is odd"]
    assert again == {0: 4}


@pytest.mark.slow
def test_an_order_whose_process_is_killed_once_is_done_by_another(tmp_path: Path) -> None:
    with closing(WorkerPool(1)) as pool:
        assert dict(pool.map(die_once, [(str(tmp_path / "mark"),)], 60.0)) == {0: "lived"}


@pytest.mark.slow
def test_an_order_that_kills_every_process_is_given_up_and_the_others_are_not() -> None:
    with closing(WorkerPool(1)) as pool:
        (index, lost), *_ = pool.map(die, [(0,)], 60.0)
        assert dict(pool.map(half, [(4,)], 60.0)) == {0: 2}
    assert index == 0
    assert isinstance(lost, OrderLost)
    assert "died (exit code -9)" in str(lost)


def test_an_order_that_takes_too_long_is_ended() -> None:
    with closing(WorkerPool(1)) as pool:
        assert isinstance(dict(pool.map(wait_for_ever, [(0,)], 0.5))[0], OrderTooLong)


def test_a_worker_computes_with_one_thread_and_this_process_keeps_its_own() -> None:
    before = dict(os.environ)
    with closing(WorkerPool(1)) as pool:
        assert dict(pool.map(environment, [(name,) for name in ONE_THREAD], 60.0)) == dict.fromkeys(
            range(6), "1"
        )
    assert dict(os.environ) == before


@pytest.mark.slow
def test_a_worker_gives_way_to_a_fresh_one_after_some_orders() -> None:
    pool = WorkerPool(1, renewed_after=2)
    processes = [answer for _, answer in pool.map(process, [(i,) for i in range(5)], 60.0)]
    pool.close()
    assert [processes.count(each) for each in dict.fromkeys(processes)] == [2, 2, 1]
