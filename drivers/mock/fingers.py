"""Force fingers that feel what a script says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drivers.device import Device
from drivers.errors import DeviceError
from drivers.interfaces import Float64, ForceSensor, Subscription, WrenchSample
from drivers.mock.clock import PERIOD, MockClock
from drivers.mock.gripper import MockGripper

Script = Callable[[float], Float64]
"""Wrenches of both fingers, shape (2, 6), at a time [s]."""


def spring_fruit(gripper: MockGripper, width: float, stiffness: float = 2000.0) -> Script:
    """A fruit of the given width [m] between two soft pads of the given stiffness each [N/m]."""

    def feel(_now: float) -> Float64:
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -stiffness * max(width - gripper.width, 0.0) / 2.0
        return wrenches

    return feel


class _Listener:
    def __init__(self, call: Callable[[WrenchSample], None], listeners: list[_Listener]) -> None:
        self.call = call
        self._listeners = listeners

    def close(self) -> None:
        if self in self._listeners:
            self._listeners.remove(self)


class MockForceSensor(Device):
    """A 500 Hz stream.

    Args:
        clock: that drives the stream.
        feel: what the fingers feel; nothing by default. May be replaced at any time.
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
        self._newest: WrenchSample | None = None
        self._listeners: list[_Listener] = []
        self._error: DeviceError | None = None
        clock.each_step.append(self._step)

    # ---------------------------------------------------------------------------------------------- script

    def lose(self, duration: float) -> None:
        """Deliver nothing for so many seconds; the sequence counts on."""
        self._silent = self._clock.now() + duration

    def give(self, sample: WrenchSample) -> None:
        """Deliver one sample now, whatever its stamp and sequence."""
        self._newest = sample
        for listener in tuple(self._listeners):
            listener.call(sample)

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._error = error

    # ----------------------------------------------------------------------------------------------- device

    def latest(self) -> WrenchSample | None:
        return self._newest

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        entry = _Listener(listener, self._listeners)
        self._listeners.append(entry)
        return entry

    def check(self) -> None:
        if self._error is not None:
            raise self._error

    def link(self) -> str:
        return "ok" if self._error is None else self._error.message

    def _step(self) -> None:
        self._sequence += 1
        now = self._clock.now()
        if now > self._silent:
            self.give(WrenchSample(now, self._sequence, np.array(self.feel(now), np.float64), self.saturated))
