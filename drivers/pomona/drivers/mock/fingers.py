"""Force fingers with scripted wrenches."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pomona.drivers.device import Device
from pomona.drivers.errors import DeviceError
from pomona.drivers.interfaces import ForceSensor, Subscription, WrenchSample
from pomona.drivers.mock.clock import PERIOD, MockClock
from pomona.drivers.mock.gripper import MockGripper
from pomona.drivers.streams import WrenchStream
from pomona.executive.values.arrays import Float64

Script = Callable[[float], Float64]  # wrenches of both fingers, shape (2, 6), at a time [s]


def spring_fruit(gripper: MockGripper, width: float, stiffness: float = 2000.0) -> Script:
    """Return a fruit of the given width [m] between two soft pads of the given stiffness each [N/m]."""

    def feel(_now: float) -> Float64:
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -stiffness * max(width - gripper.width, 0.0) / 2.0
        return wrenches

    return feel


RIPPLE = 1e-13  # of every sample, to either side [N, N·m]: no live sensor repeats a value to the last bit


class MockForceSensor(Device):
    """A 500 Hz stream.

    Args:
        clock: that drives the stream.
        feel: the wrenches at the fingers; zero by default. May be replaced at any time.
    """

    interfaces = (ForceSensor,)
    rate = 1.0 / PERIOD

    def __init__(self, clock: MockClock, feel: Script | None = None) -> None:
        super().__init__("fingers")
        self._clock = clock
        self.feel: Script = feel or (lambda _now: np.zeros((2, 6)))
        self.saturated = (False, False)
        self._silent = 0.0
        self._sequence = 0
        self._stream = WrenchStream(clock)
        self._error: DeviceError | None = None
        clock.each_step.append(self._step)

    # ---------------------------------------------------------------------------------------------- script

    def lose(self, duration: float) -> None:
        """Deliver nothing for a duration [s]; the sequence counts on."""
        self._silent = self._clock.now() + duration

    def give(self, sample: WrenchSample) -> None:
        """Deliver one sample now, without checks."""
        self._stream.hand_on(sample)

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._error = error

    # ----------------------------------------------------------------------------------------------- device

    def latest(self) -> WrenchSample | None:
        return self._stream.newest

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        return self._stream.subscribe(listener)

    def check(self) -> None:
        problem = self._wrong()
        if problem is not None:
            raise problem

    def link(self) -> str:
        problem = self._wrong()
        return "ok" if problem is None else problem.message

    def acknowledge(self) -> None:
        self._stream.acknowledge(self.name)

    def _wrong(self) -> DeviceError | None:
        return self._error or self._stream.problem(self.name)

    def _step(self) -> None:
        self._sequence += 1
        now = self._clock.now()
        if now > self._silent:
            felt = np.array(self.feel(now), np.float64) + (RIPPLE if self._sequence % 2 else -RIPPLE)
            self._stream.deliver(WrenchSample(now, self._sequence, felt, self.saturated))
