"""Local processes: answers, exceptions, deaths and time limits."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from pomona.executive.errors import UsageError
from pomona.tools.library.campaign.engine import ONE_THREAD, OrderLost, OrderTooLong, open_engine
from pomona.tools.library.campaign.local import LocalEngine


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
    with open_engine("local", workers=2) as engine:
        answers = dict(engine.map(half, [(i,) for i in range(7)], 60.0))
        again = dict(engine.map(half, [(8,)], 60.0))
    assert {i: answers[i] for i in (0, 2, 4, 6)} == {0: 0, 2: 1, 4: 2, 6: 3}
    assert [str(answers[i]) for i in (1, 3, 5)] == ["1 is odd", "3 is odd", "5 is odd"]
    assert again == {0: 4}


@pytest.mark.slow
def test_an_order_whose_process_is_killed_once_is_done_by_another(tmp_path: Path) -> None:
    with open_engine("local", workers=1) as engine:
        assert dict(engine.map(die_once, [(str(tmp_path / "mark"),)], 60.0)) == {0: "lived"}


@pytest.mark.slow
def test_an_order_that_kills_every_process_is_given_up_and_the_others_are_not() -> None:
    with open_engine("local", workers=1) as engine:
        (index, lost), *_ = engine.map(die, [(0,)], 60.0)
        assert dict(engine.map(half, [(4,)], 60.0)) == {0: 2}
    assert index == 0
    assert isinstance(lost, OrderLost)
    assert "died 2 times" in str(lost)


def test_an_order_that_takes_too_long_is_ended() -> None:
    with open_engine("local", workers=1) as engine:
        assert isinstance(dict(engine.map(wait_for_ever, [(0,)], 0.5))[0], OrderTooLong)


def test_a_worker_computes_with_one_thread_and_this_process_keeps_its_own() -> None:
    before = dict(os.environ)
    with open_engine("local", workers=1) as engine:
        assert dict(
            engine.map(environment, [(name,) for name in ONE_THREAD], 60.0)
        ) == dict.fromkeys(range(6), "1")
    assert dict(os.environ) == before


@pytest.mark.slow
def test_a_worker_gives_way_to_a_fresh_one_after_some_orders() -> None:
    engine = LocalEngine(1, renewed_after=2)
    processes = [answer for _, answer in engine.map(process, [(i,) for i in range(5)], 60.0)]
    engine.close()
    assert [processes.count(each) for each in dict.fromkeys(processes)] == [2, 2, 1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("cloud",), "no engine 'cloud'; there are local, ray"),
        (("local", 0), "at least one process"),
        (("local", 1, "10.0.0.1:6379"), "--address is for --engine ray"),
    ],
)
def test_a_file_that_cannot_be_opened_is_refused_without_a_traceback(
    arguments: tuple[object, ...], message: str
) -> None:
    with pytest.raises(UsageError, match=message), open_engine(*arguments):  # type: ignore[arg-type]
        pass
