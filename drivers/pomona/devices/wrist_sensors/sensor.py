"""A force/torque sensor at the wrist as a `LoadSensor`: one thread reads its stream, and opens a lost one again.

A loss or a fault of the values stays latched until an operator acknowledges it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pomona.drivers import (
    Device,
    DeviceError,
    DeviceLost,
    LoadSensor,
    Owner,
    Subscription,
    WrenchSample,
    WrenchStream,
    words,
)
from pomona.executive import Clock, Float64

RECONNECT = 0.5  # pause between attempts to open a lost sensor again [s]
FIRST = 1.0  # deadline of the first sample after opening [s]


class WristSession(Protocol):
    """An open wire to a sensor that streams."""

    def receive(self, patience: float) -> list[Float64]:
        """Return the wrenches that have come, shape (n, 6) each [N, N·m], waiting up to `patience` [s].

        Raises OSError, DeviceError: the wire failed, or the peer is no such sensor.
        """

    def close(self) -> None:
        """Disconnect. May raise OSError."""


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """Options of a stream.

    Attributes:
        rate: samples per second; silence: time without one after which it is lost [s].
        range: largest force along an axis [N].
    """

    rate: float
    silence: float
    range: float


class StreamingSensor(Device):
    """A sensor that streams wrenches, shape (n, 6), one for each of `sides`."""

    sides: tuple[str, ...] = ("the load sensor",)

    def __init__(
        self,
        open_session: Callable[[], WristSession],
        clock: Clock,
        options: StreamOptions,
        name: str,
    ) -> None:
        """`open_session` opens the wire. Raises OSError, DeviceError."""
        super().__init__(name)
        self.rate = options.rate
        self._open = open_session
        self._clock = clock
        self._options = options
        self._owner = Owner(name, self.step, self._lose, clock)
        self._stream = WrenchStream(clock, options.silence, sides=self.sides)
        self._session: WristSession | None = None
        self._problem = DeviceLost(name, "was never connected")
        self._sequence = 0
        self._heard_at = 0.0
        self._retry_at = 0.0

    def connect(self) -> None:
        """Open the wire and wait for the first sample. Raises DeviceLost: there is none."""
        try:
            self._begin()
        except OSError as error:
            raise DeviceLost(self.name, f"cannot be reached: {error}") from error
        self._problem = None

    def start(self) -> None:
        """Read the stream in a thread of its own from now on."""
        self._owner.start()

    def _begin(self) -> None:
        self._session = self._open()
        self._stream.restart()
        end = self._clock.now() + FIRST
        try:
            while not self._take(0.01):
                if self._clock.now() > end:
                    raise DeviceLost(self.name, f"sent no sample within {FIRST:g} s")
        except (OSError, DeviceError):
            self._close_session()
            raise

    def step(self) -> None:
        """Serve the wire for a moment; the sensor's own thread calls this without end.

        A DeviceLost is kept as the sensor's problem.
        """
        try:
            if self._session is not None:
                silent = self._clock.now() - self._heard_at
                if not self._take(0.002) and silent > self._options.silence:
                    raise DeviceLost(self.name, f"no sample for {1e3 * silent:.0f} ms")
            elif self._clock.now() >= self._retry_at:
                self._begin()
            else:
                self._clock.advance(min(self._retry_at - self._clock.now(), 0.05))
        except (OSError, DeviceError) as error:
            self._lose(error)

    def _take(self, patience: float) -> bool:
        """Deliver all samples that have come; return whether there were any."""
        assert self._session is not None
        wrenches = self._session.receive(patience)
        for behind, wrench in zip(range(len(wrenches) - 1, -1, -1), wrenches, strict=True):
            self._sequence += 1
            stamp = self._heard_at = self._clock.now()
            full = np.abs(wrench[:, :3]).max(axis=1) >= self._options.range
            sample = WrenchSample(
                stamp - behind * 1e-6, self._sequence, wrench, (bool(full[0]), bool(full[-1]))
            )
            self._stream.deliver(sample)
        return bool(wrenches)

    def _lose(self, error: BaseException) -> None:
        told = (
            f"the wire failed: {error}"
            if isinstance(error, OSError)
            else f"the driver failed: {error!r}"
        )
        self._problem = error if isinstance(error, DeviceError) else DeviceLost(self.name, told)
        self._close_session()
        self._retry_at = self._clock.now() + RECONNECT

    def _close_session(self) -> None:
        session = self._session
        self._session = None
        if session is not None:
            try:
                session.close()
            except OSError:
                return

    # ------------------------------------------------------------------------------------- the interface

    def latest(self) -> WrenchSample | None:
        return self._stream.newest

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        return self._stream.subscribe(listener)

    # ---------------------------------------------------------------------------------------- the device

    def check(self) -> None:
        super().check()
        self._owner.check()

    def acknowledge(self) -> None:
        """Accept that the stream had been lost. Raises DeviceLost: it is lost."""
        if self._session is None:
            raise DeviceLost(self.name, f"is still lost: {words(self._problem)}")
        self._owner.ask(self._release)

    def _release(self) -> None:
        self._stream.acknowledge(self.name)
        self._problem = None

    def _wrong(self) -> DeviceError | None:
        return self._problem or self._stream.problem(self.name)

    def close(self) -> None:
        self._owner.close()
        self._close_session()
        self._problem = DeviceLost(self.name, "is closed")


class WristSensor(StreamingSensor):
    """A sensor between flange and hand.

    Attributes:
        mass: that it carries, hand and fruit [kg]; least: smallest lasting change that is no error of it [N].
    """

    interfaces = (LoadSensor,)

    def __init__(
        self,
        open_session: Callable[[], WristSession],
        clock: Clock,
        options: StreamOptions,
        mass: float,
        least: float,
        name: str = "load",
    ) -> None:
        super().__init__(open_session, clock, options, name)
        self.mass = mass
        self.least = least
