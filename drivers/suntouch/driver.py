"""Two SUNTouch fingers as a `ForceSensor`: asked together 500 times a second by one thread.

A sample that one finger did not answer, or that holds a spike, is left out and leaves a gap in the sequence. A lost
finger stops the gripper, stays latched, and is opened again in the background.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from drivers.device import Device
from drivers.errors import DeviceError, DeviceFault, DeviceLost
from drivers.interfaces import ForceSensor, Subscription, WrenchSample
from drivers.owner import Owner
from drivers.suntouch.codec import Reading
from drivers.suntouch.finger import Finger
from executive.clock import Clock

RECONNECT = 0.5
"""Pause between attempts to open a lost finger again [s]."""
FIRST_SAMPLE = 1.0
"""Deadline of the first sample after opening [s]."""
ANSWER = 0.004
"""A late answer is still a sample; after so long it is given up and the line started over [s]."""
CATCH_UP = 2
"""Periods that this thread may oversleep and still ask for each of them, one right after the other."""
DROPPED, AVERAGED = 10, 100
"""Samples left out before and taken for the bias."""


class _Listener:
    def __init__(self, call: Callable[[WrenchSample], None], fingers: SunTouchFingers) -> None:
        self.call, self._fingers = call, fingers

    def close(self) -> None:
        self._fingers._unsubscribe(self)


class SunTouchFingers(Device):
    """The left and the right finger.

    Attributes:
        lost_samples: periods in which no sample was delivered.
        on_lost: called once when the stream is lost, from the sensor's thread: stops the gripper.
    """

    interfaces = (ForceSensor,)

    def __init__(
        self,
        left: Finger,
        right: Finger,
        clock: Clock,
        *,
        rate: float = 500.0,
        silence: float = 0.040,
        on_lost: Callable[[], None] = lambda: None,
        name: str = "fingers",
    ) -> None:
        super().__init__(name)
        self.rate, self.on_lost = rate, on_lost
        self.lost_samples = 0
        self.fingers = (left, right)
        self._clock, self._silence = clock, silence
        self._period = 1.0 / rate
        self._owner = Owner(name, self.step, self._lose, clock)
        self._lock = threading.Lock()
        self._listeners: tuple[_Listener, ...] = ()
        self._newest: WrenchSample | None = None
        self._sequence = 0
        self._due = 0.0
        self._heard = 0.0
        self._unanswered = 0
        self._streaming = False
        self._retry_at = 0.0
        self._biasing: list[tuple[Reading, Reading]] | None = None
        self._problem: DeviceError | None = DeviceLost(name, "was never connected")

    # ---------------------------------------------------------------------------------------- connection

    def connect(self) -> None:
        """Open both lines, wait for the first sample and take the bias: nothing may touch the pads meanwhile.

        Raises:
            DeviceLost: a line cannot be opened, or a finger does not answer.
        """
        try:
            self._open()
            self.bias()
            while self._biasing is not None:
                self._sample()
        except OSError as error:
            self._close_lines()
            raise DeviceLost(self.name, str(error)) from error
        except DeviceError:
            self._close_lines()
            raise
        self._problem = None

    def start(self) -> None:
        """Stream in a thread of its own from now on."""
        self._owner.start()

    def bias(self) -> None:
        """Take the voltages of the next readings as those without contact: 10 are left out, 100 averaged."""
        self._biasing = []

    @property
    def biased(self) -> bool:
        """False while the bias is being taken."""
        return self._biasing is None

    def step(self) -> None:
        """One period; the sensor's own thread calls this without end."""
        try:
            if self._streaming:
                self._sample()
            elif self._clock.now() >= self._retry_at:
                self._open()
            else:
                self._clock.advance(min(self._retry_at - self._clock.now(), 0.05))
        except (OSError, DeviceError) as error:
            self._lose(error)

    def _open(self) -> None:
        for side, finger in zip(("left", "right"), self.fingers, strict=True):
            try:
                finger.open()
                self._first_reading(finger)
            except (OSError, DeviceLost) as error:
                raise DeviceLost(self.name, f"the {side} finger: {error}") from error
        self._due = self._heard = self._clock.now()
        self._streaming = True

    def _first_reading(self, finger: Finger) -> None:
        end = self._clock.now() + FIRST_SAMPLE
        while self._clock.now() < end:
            finger.ask()
            if finger.answer(self._clock.now() + 0.02) is not None:
                return
        raise DeviceLost(self.name, f"no reading within {FIRST_SAMPLE:g} s")

    # -------------------------------------------------------------------------------------------- stream

    def _sample(self) -> None:
        self._await_period()
        asked = self._clock.now()
        for finger in self.fingers:
            finger.ask()
        due = asked + ANSWER
        left, right = (finger.answer(due) for finger in self.fingers)
        now = self._clock.now()
        if left is None or right is None:
            self.lost_samples += 1
            self._unanswered += 1
            # Several unanswered requests, or this thread itself was held up.
            if now - self._heard > self._silence and self._unanswered >= 5:
                raise DeviceLost(self.name, f"no sample for {1e3 * (now - self._heard):.0f} ms")
            return
        self._heard, self._unanswered = now, 0
        believed = [f.spikes.accept(reading.volts) for f, reading in zip(self.fingers, (left, right), strict=True)]
        if not all(believed):
            self.lost_samples += 1
            return
        if self._biasing is not None:
            self._take_bias(left, right)
        self._deliver(asked, left, right)

    def _await_period(self) -> None:
        """Sleep until the next period; periods that were overslept by more than a moment are lost samples."""
        self._sequence += 1
        self._due += self._period
        late = self._clock.now() - self._due
        if late < 0.0:
            self._clock.advance(-late)
        elif late > CATCH_UP * self._period:
            missed = int(late / self._period)
            self._sequence += missed
            self.lost_samples += missed
            self._due += missed * self._period

    def _deliver(self, stamp: float, left: Reading, right: Reading) -> None:
        wrenches = np.stack([f.wrench(reading) for f, reading in zip(self.fingers, (left, right), strict=True)])
        sample = WrenchSample(stamp, self._sequence, wrenches, (left.saturated, right.saturated))
        self._newest = sample
        for listener in self._listeners:
            try:
                listener.call(sample)
            except Exception as error:  # whoever controls the grip by these samples no longer does
                listener.close()
                self.on_lost()
                self._problem = DeviceFault(self.name, f"a listener failed: {error!r}")

    def _take_bias(self, left: Reading, right: Reading) -> None:
        taken = self._biasing
        assert taken is not None
        taken.append((left, right))
        if len(taken) == DROPPED + AVERAGED:
            for finger, readings in zip(self.fingers, zip(*taken[DROPPED:], strict=True), strict=True):
                finger.bias = np.mean([reading.volts for reading in readings], axis=0)
            self._biasing = None

    def _lose(self, error: BaseException) -> None:
        first = self._streaming
        self._streaming = False
        self._retry_at = self._clock.now() + RECONNECT
        if first:
            words = f"a line failed: {error}" if isinstance(error, OSError) else f"the driver failed: {error!r}"
            self._problem = error if isinstance(error, DeviceError) else DeviceLost(self.name, words)
            self.on_lost()
        self._close_lines()

    def _close_lines(self) -> None:
        for finger in self.fingers:
            finger.close()

    # ------------------------------------------------------------------------------------- the interface

    def latest(self) -> WrenchSample | None:
        return self._newest

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        with self._lock:
            entry = _Listener(listener, self)
            self._listeners = (*self._listeners, entry)
        return entry

    def _unsubscribe(self, entry: _Listener) -> None:
        with self._lock:
            self._listeners = tuple(listener for listener in self._listeners if listener is not entry)

    # ---------------------------------------------------------------------------------------- the device

    def link(self) -> str:
        return "ok" if self._problem is None else self._problem.message

    def check(self) -> None:
        problem = self._problem
        if problem is not None:
            raise problem

    def acknowledge(self) -> None:
        """Accept that the stream had been lost.

        Raises:
            DeviceLost: it still is.
        """
        if not self._streaming:
            raise DeviceLost(self.name, f"is still lost: {_words(self._problem)}")
        self._problem = None

    def close(self) -> None:
        self._owner.close()
        self._close_lines()
        self._streaming = False
        self._problem = DeviceLost(self.name, "is closed")


def _words(problem: DeviceError | None) -> str:
    return problem.message if problem is not None else "no problem is known"
