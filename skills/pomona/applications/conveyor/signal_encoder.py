"""A belt whose encoder is read by a PLC: the driver `signal-conveyor`, on any device `Signals` above it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from pomona.applications.conveyor.conveyor import BELT, SILENCE, Belt, BeltPlace, ConveyorState
from pomona.applications.conveyor.devices import OVER
from pomona.applications.conveyor.reach_watch import unseen_people
from pomona.devices.plc.signals import Signals
from pomona.drivers import ConnectContext, Device, DeviceLost, MotionRefused, Settings, StopFailed, Surroundings, driver
from pomona.executive import Clock, Problem, Text, choose, value

AT_REST = 2e-3  # speed below which a belt rests [m/s]


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalConveyorOptions(BeltPlace):
    """Where the belt runs, and the signal that counts its travel."""

    travel: str = value(Text(), help="input of the PLC: the travel in metres, by the signal's `scale`; 32 bits")
    runs: str = value(Text(), "", help="output of the PLC that lets the belt run; '': the program cannot stop it")

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        if not any(Signals in device.interfaces for device in around.above.values()):
            yield Problem("driver", "it needs a PLC above it", "plc: {driver: modbus-signals, …}")
        if not self.runs and around.workspace is not None and around.workspace.watch is not None:
            words = "where the watch of paths stops the arm, the belt runs on: the program cannot stop it"
            yield Problem("driver", words, "runs: an output of the PLC that lets the belt run", warning=True)
        yield from unseen_people(around, "driver")


class SignalConveyor(Device):
    """The belt. Its speed is that over the last `OVER` seconds; an unknown travel ends the run.

    A stop takes the output `runs` away; nothing here gives it again. In the safe state the PLC's driver takes it away.
    """

    interfaces = BELT

    def __init__(self, belt: Belt, signals: Signals, travel: str, clock: Clock, runs: str = "") -> None:
        super().__init__("conveyor")
        self.belt = belt
        self._runs, self._stopping = runs, False
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

    def stop(self) -> bool:
        if self._runs:
            self._stopping = True
            try:
                self._signals.write(self._runs, False)
            except MotionRefused as refused:
                raise StopFailed(self.name, f"the belt may run on: {refused.message}") from refused
        return self._stopping

    def settled(self) -> bool:
        """Return False after a stop while the encoder still counts."""
        state = self.travelled()
        if state is None or self._clock.now() - state.stamp > SILENCE or abs(state.speed) < AT_REST:
            self._stopping = False
        return not self._stopping

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
    switches = [name for name in signals.names.outputs if name not in signals.names.numbers]
    if said.runs and said.runs not in switches:
        words = f"the PLC has no output '{said.runs}' that is a switch"
        raise settings.error(words, "runs", choose(said.runs, switches))
    return SignalConveyor(said.belt, signals, said.travel, context.clock, said.runs)
