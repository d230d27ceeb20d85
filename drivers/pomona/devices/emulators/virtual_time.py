"""Time of a simulated world in which drivers' threads take turns: as deterministic as a program of one thread.

The drivers of real devices have threads, wait for bytes and sleep. Under this clock they do so without knowing that the
time is simulated. One thread runs at a time: the run's own lets the world make a step, then every driver whose bytes
have come or whose time is up gets its turn, in the order in which they were started, until it waits again.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from pomona.executive import Clock

EPSILON = 1e-9  # times that differ by less are the same [s]


class Turn(threading.Thread):
    """A thread that runs only when it is its turn."""

    def __init__(self, name: str, run: Callable[[], None], time: VirtualTime) -> None:
        super().__init__(name=name, daemon=True)
        self.until = 0.0
        self.ready = _never
        self.polls = 0
        self._task = run
        self._time = time
        self._go, self._done = threading.Lock(), threading.Lock()
        self._go.acquire()
        self._done.acquire()
        self._out = False
        self._over = False

    def start(self) -> None:
        """Have the first turn with the next step."""
        self._time.turns.append(self)
        super().start()

    def run(self) -> None:
        """Run the task at its turn; called by `threading.Thread`."""
        self._go.acquire()
        try:
            self._task()
        finally:
            self._over = True
            self._done.release()

    def join(self, timeout: float | None = None) -> None:
        """Let the world go on until the thread has ended, for at most `timeout` of its seconds."""
        end = self._time.now() + (timeout if timeout is not None else 1e9)
        while not self._over and self._time.now() < end:
            self._time.step()
        if self._over:
            super().join()

    def give(self) -> None:
        """Let it run until it waits again; for the thread that lets the world go on."""
        if not self._out:  # else an exception in that thread, such as Ctrl-C, has left it running
            self._out = True
            self._go.release()
        self._done.acquire()
        self._out = False
        if self._over:
            self._time.turns.remove(self)

    def wait(self) -> None:
        """End this turn; for the thread itself."""
        self._done.release()
        self._go.acquire()


class VirtualTime:
    """The clock of a cell whose devices are emulated in this process."""

    simulated = True

    def __init__(self, world: Clock, period: float) -> None:
        """
        Args:
            world: the simulated world's clock; advancing it by `period` [s] is one step.
        """
        self.turns: list[Turn] = []
        self._world = world
        self._period = period
        self._owed = 0.0
        self._stepping = threading.RLock()

    def now(self) -> float:
        return self._world.now()

    def advance(self, duration: float) -> None:
        """Let time pass: for the run's thread the world goes on, a driver's thread waits for its next turn."""
        if duration <= 0.0:
            return
        if self.turn() is not None:
            self.wait(duration, _never)
            return
        self._owed += duration
        count = int(self._owed / self._period + 1e-6)
        self._owed -= count * self._period
        for _ in range(count):
            self.step()

    def thread(self, name: str, run: Callable[[], None]) -> Turn:
        """Return a thread that takes turns with the others, see `pomona.executive.cell.owner.TurnTaking`."""
        return Turn(name, run, self)

    def turn(self) -> Turn | None:
        """Return the thread whose turn it is; None for the run's own thread."""
        thread = threading.current_thread()
        return thread if isinstance(thread, Turn) else None

    def wait(self, timeout: float, ready: Callable[[], bool]) -> None:
        """Let time pass until `ready` returns True, or for `timeout` [s]."""
        turn = self.turn()
        if turn is None:
            end = self.now() + timeout
            while not ready() and self.now() < end - EPSILON:
                self.step()
            return
        turn.polls = turn.polls + 1 if timeout <= 0.0 else 0
        # Number of polls without time passing after which a thread waits for the next step, instead of polling for ever
        if ready() or (timeout <= 0.0 and turn.polls < 100):
            return
        turn.polls = 0
        turn.until = self.now() + max(timeout, EPSILON * 10.0)
        turn.ready = ready
        turn.wait()

    def step(self) -> None:
        """One step of the world, and the turns that it brings about."""
        with self._stepping:
            self._world.advance(self._period)
            now = self.now()
            for turn in tuple(self.turns):
                if now >= turn.until - EPSILON or turn.ready():
                    turn.give()


def _never() -> bool:
    return False
