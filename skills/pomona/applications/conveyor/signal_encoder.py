"""A belt whose encoder is read by a PLC: the driver `signal-conveyor`, on any device `Signals` above it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pomona.applications.conveyor.conveyor import Belt, Conveyor, ConveyorState
from pomona.applications.conveyor.devices import OVER, SILENCE
from pomona.devices.plc.signals import Signals
from pomona.drivers import ConnectContext, Device, DeviceLost, Settings, Surroundings, driver
from pomona.executive import LENGTH, Clock, Measure, Problem, Text, choose, value


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalConveyorOptions:
    """Where the belt runs, and the signal that counts its travel."""

    travel: str = value(Text(), help="input of the PLC: the travel in metres, by the signal's `scale`; 32 bits")
    beside: float = value(Measure(LENGTH, "-2 m", "2 m"), help="of the belt's middle line in the base frame, y")
    top: float = value(Measure(LENGTH, "-1 m", "1 m"), help="height of the belt's surface in the base frame")
    width: float = value(Measure(LENGTH, "100 mm", "1 m"), "240 mm", "of the belt")
    length: float = value(Measure(LENGTH, "1 m", "4 m"), "1.8 m", "of the belt, its middle before the robot")

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        if not any(Signals in device.interfaces for device in around.above.values()):
            yield Problem("driver", "it needs a PLC above it", "plc: {driver: modbus-signals, …}")

    @property
    def belt(self) -> Belt:
        """Where the belt runs: along x of the base frame."""
        T = np.eye(4)
        T[:3, 3] = 0.0, self.beside, self.top
        return Belt(T, self.length, self.width)


class SignalConveyor(Device):
    """The belt. Its speed is that over the last `OVER` seconds; an unknown travel ends the run."""

    interfaces = (Conveyor,)

    def __init__(self, belt: Belt, signals: Signals, travel: str, clock: Clock) -> None:
        super().__init__("conveyor")
        self.belt = belt
        self._signals, self._travel, self._clock = signals, travel, clock
        self._read: deque[tuple[float, float]] = deque()
        self._since = clock.now()

    def travelled(self) -> ConveyorState | None:
        found = self._signals.read(self._travel)
        if found.value is not None and (not self._read or found.stamp > self._read[-1][0]):
            self._read.append((found.stamp, float(found.value)))
            while len(self._read) > 2 and found.stamp - self._read[1][0] >= OVER:
                self._read.popleft()
        if not self._read:
            return None
        (before, start), (stamp, position) = self._read[0], self._read[-1]
        return ConveyorState(stamp, position, 0.0 if stamp <= before else (position - start) / (stamp - before))

    def last_seen(self) -> float | None:
        state = self.travelled()
        return None if state is None else state.stamp

    def check(self) -> None:
        state = self.travelled()
        silent = self._clock.now() - (self._since if state is None else state.stamp)
        if silent > SILENCE:
            raise DeviceLost(self.name, f"the PLC's signal '{self._travel}' is {1e3 * silent:.0f} ms old")


@driver(SignalConveyor, SignalConveyorOptions)
def connect(settings: Settings[SignalConveyorOptions], context: ConnectContext) -> SignalConveyor:
    """`driver: signal-conveyor`"""
    said, signals = settings.values, context.find(Signals)
    assert signals is not None, "judged when the cell file was read"
    numbers = [name for name in signals.names.inputs if name in signals.names.numbers]
    if said.travel not in numbers:
        words = f"the PLC has no input '{said.travel}' that is a number"
        raise settings.error(words, "travel", choose(said.travel, numbers))
    return SignalConveyor(said.belt, signals, said.travel, context.clock)
