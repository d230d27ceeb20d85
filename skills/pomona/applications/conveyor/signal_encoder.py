"""A belt whose encoder is read by a PLC: the driver `signal-conveyor`, on any device `Signals` above it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from pomona.applications.conveyor.conveyor import (
    AT_REST,
    BELT,
    SILENCE,
    Belt,
    BeltPlace,
    ConveyorState,
    second_belt,
)
from pomona.applications.conveyor.devices import OVER
from pomona.applications.conveyor.reach_watch import unseen_people
from pomona.devices.plc.signals import SignalNames, Signals, fit_signals
from pomona.drivers import (
    ConnectContext,
    Device,
    DeviceLost,
    MotionRefused,
    Settings,
    StopFailed,
    Surroundings,
    driver,
)
from pomona.executive import Clock, Problem, Text, value

# largest travel of one count, and least travel after which the counts begin anew [m]
COARSEST = 1e-3
SHORTEST = 10e3


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalConveyorOptions(BeltPlace):
    """Where the belt runs, and the signal that counts its travel."""

    travel: str = value(
        Text(), help="input of the PLC: the travel in metres, by the signal's `scale`; 32 bits"
    )
    runs: str = value(
        Text(), "", help="output of the PLC that lets the belt run; '': the program cannot stop it"
    )

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        yield from fit_signals(around, self.unfit)
        yield from second_belt(around)
        yield from BeltPlace.fits(self, around)
        if not self.runs and around.workspace is not None and around.workspace.watch is not None:
            words = "where the watch of paths stops the arm, the belt runs on: the program cannot stop it"
            yield Problem(
                "driver", words, "runs: an output of the PLC that lets the belt run", warning=True
            )
        yield from unseen_people(around, self.belt)

    def unfit(self, names: SignalNames) -> Iterator[Problem]:
        """Yield the signals that the PLC does not have, or whose counts are no travel."""
        yield from names.lacking("travel", self.travel, number=True)
        if self.runs:
            yield from names.lacking("runs", self.runs, output=True)
        count, span = names.counts.get(self.travel, (0.0, SHORTEST))
        if count > COARSEST:
            words = f"one count of '{self.travel}' is {1e3 * count:g} mm of travel, and a belt needs 1 mm or less"
            yield Problem(
                "travel", words, "give the signal its `scale` in metres, such as scale: 0.0001"
            )
        elif span < SHORTEST:
            words = f"'{self.travel}' begins anew after {span:.3g} m of travel, which looks like a jump of the belt"
            yield Problem("travel", words, "count in two registers, with type: int32")


class SignalConveyor(Device):
    """The belt. Its speed is that over the last `OVER` seconds; an unknown travel ends the run.

    A stop takes the output `runs` away; nothing here gives it again. In the safe state the PLC's driver takes it away.
    """

    interfaces = BELT

    def __init__(
        self, belt: Belt, signals: Signals, travel: str, clock: Clock, runs: str = ""
    ) -> None:
        super().__init__("conveyor")
        self.belt = belt
        self._runs = runs
        self._stopping = False
        self._signals = signals
        self._travel = travel
        self._clock = clock
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
        return ConveyorState(
            stamp, position, 0.0 if stamp <= before else (position - start) / (stamp - before)
        )

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
            raise DeviceLost(
                self.name, f"the PLC's signal '{self._travel}' is {1e3 * silent:.0f} ms old"
            )


@driver(SignalConveyor, SignalConveyorOptions)
def connect(settings: Settings[SignalConveyorOptions], context: ConnectContext) -> SignalConveyor:
    """`driver: signal-conveyor`"""
    said = settings.values
    signals = context.find(Signals)
    assert signals is not None, "judged when the cell file was read"
    for problem in said.unfit(signals.names):
        raise settings.error(problem.message, problem.key, problem.hint)
    return SignalConveyor(said.belt, signals, said.travel, context.clock, said.runs)
