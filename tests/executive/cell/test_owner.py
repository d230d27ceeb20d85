"""The one thread that may touch a device."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from pomona.drivers.errors import DeviceFault, DeviceLost
from pomona.executive.cell import owner as owner_module
from pomona.executive.cell.owner import Owner
from pomona.executive.clock import ManualClock, SystemClock

PATIENCE = 20.0
"""Nothing here takes long; a loaded machine may let a thread wait [s]."""


class Served:
    """A device whose steps wait for a word, so that a test decides when its owner comes to the calls."""

    def __init__(self) -> None:
        self.go = threading.Semaphore(0)
        self.stepped = threading.Semaphore(0)
        self.threads: set[int] = set()
        self.failures: list[BaseException] = []
        self.failed = threading.Semaphore(0)
        self.raising: BaseException | None = None
        self.owner = Owner("thing", self.step, self.lose, SystemClock())

    def step(self) -> None:
        self.threads.add(threading.get_ident())
        assert self.go.acquire(timeout=PATIENCE)
        self.stepped.release()
        error, self.raising = self.raising, None
        if error is not None:
            raise error

    def lose(self, error: BaseException) -> None:
        self.failures.append(error)
        self.failed.release()


@pytest.fixture
def served() -> Iterator[Served]:
    served = Served()
    yield served
    served.go.release(1000)
    served.owner.close()


def test_before_the_start_any_caller_is_the_owner(served: Served) -> None:
    made: list[int] = []
    served.owner.post(lambda: made.append(threading.get_ident()))
    assert made == [threading.get_ident()]
    assert served.owner.ask(lambda: 7) == 7


def test_calls_of_many_threads_are_made_by_the_owner_alone_and_each_threads_in_order(
    served: Served,
) -> None:
    made: list[tuple[int, int]] = []

    def leave(number: int) -> None:
        for count in range(200):
            served.owner.post(lambda count=count: note(number, count))

    def note(number: int, count: int) -> None:
        served.threads.add(threading.get_ident())
        made.append((number, count))

    served.owner.start()
    callers = [threading.Thread(target=leave, args=(number,)) for number in range(4)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(PATIENCE)
    served.go.release(3)
    assert served.owner.ask(lambda: len(made), PATIENCE) == 800
    assert len(served.threads) == 1
    assert all(
        [count for n, count in made if n == number] == list(range(200)) for number in range(4)
    )


def test_a_question_gets_its_error(served: Served) -> None:
    def refuse() -> None:
        raise DeviceFault("thing", "no")

    served.owner.start()
    served.go.release(3)
    with pytest.raises(DeviceFault, match="thing: no"):
        served.owner.ask(refuse, PATIENCE)
    assert served.failures == []


def test_a_question_that_the_owner_does_not_come_to_is_not_carried_out_later(
    served: Served,
) -> None:
    made: list[str] = []
    served.owner.start()
    with pytest.raises(DeviceLost, match=r"did nothing for 0\.01 s"):
        served.owner.ask(lambda: made.append("late"), 0.01)
    served.go.release(3)
    assert served.owner.ask(lambda: list(made), PATIENCE) == []


@pytest.mark.parametrize("error", [RuntimeError("bug"), SystemExit(0), KeyboardInterrupt()])
def test_any_exception_of_a_step_is_reported_and_the_thread_goes_on(
    served: Served, error: BaseException
) -> None:
    served.raising = error
    served.owner.start()
    served.go.release(1)
    assert served.failed.acquire(timeout=PATIENCE)
    assert served.failures == [error]
    served.go.release(3)
    assert served.owner.ask(lambda: "served", PATIENCE) == "served"
    served.owner.check()


def test_a_failed_call_is_reported_and_the_next_is_made(served: Served) -> None:
    made: list[str] = []

    def fail() -> None:
        raise RuntimeError("bug")

    served.owner.post(fail)
    served.owner.post(lambda: made.append("next"))
    assert [str(error) for error in served.failures] == ["bug"]
    assert made == ["next"]


def test_a_thread_that_hangs_is_found(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    served.owner.start()
    served.owner.check()
    monkeypatch.setattr(owner_module, "HUNG", -1.0)  # as if so much time had passed
    with pytest.raises(DeviceLost, match="its thread hangs"):
        served.owner.check()


def test_closing_makes_the_calls_that_are_left(served: Served) -> None:
    made: list[str] = []
    served.owner.start()
    served.owner.post(lambda: made.append("last"))
    served.go.release(1)
    served.owner.close(PATIENCE)
    assert made == ["last"]
    served.owner.check()


class TurnClock(ManualClock):
    """Provides a thread that runs when time passes."""

    class Turns:
        def __init__(self, run: Callable[[], None]) -> None:
            self._run, self.alive = run, False

        def start(self) -> None:
            self.alive = True

        def join(self, timeout: float | None = None) -> None:
            self.alive = False
            runner = threading.Thread(target=self._run)
            runner.start()
            runner.join()

        def is_alive(self) -> bool:
            return self.alive

    def thread(self, name: str, run: Callable[[], None]) -> Turns:
        self.given = self.Turns(run)
        return self.given


def test_a_clock_that_takes_turns_gives_the_thread() -> None:
    made: list[str] = []
    clock = TurnClock()
    owner = Owner("thing", lambda: None, lambda error: None, clock)
    owner.start()
    owner.post(lambda: made.append("call"))
    assert made == []
    with pytest.raises(
        DeviceLost, match="did nothing"
    ):  # waits on the cell's clock, not on the wall's
        owner.ask(lambda: None)
    assert clock.now() >= owner_module.ANSWER
    owner.close()
    assert made == ["call"]
