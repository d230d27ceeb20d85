"""Signals in this process: the driver `sim-signals`, whose PLC acts by rules of the cell file.

plc:
  driver: sim-signals
  outputs: [ready, done, change_bin]
  inputs:
    start: {follows: ready, delay: 500 ms}
    bin_full: {counts: done, most: 3, cleared_by: change_bin}
    fault: {during: 30 s..35 s}
    mass: {number: 2.5}
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pomona.devices.plc.signals import SignalNames, Signals, SignalValue
from pomona.drivers import (
    ConnectContext,
    Device,
    DeviceFault,
    FaultSwitch,
    MotionRefused,
    Settings,
    driver,
)
from pomona.executive import (
    TIME,
    Clock,
    MappingOf,
    Measure,
    Number,
    OrWord,
    Problem,
    Section,
    Span,
    Text,
    Whole,
    Words,
    choose,
    value,
)

DEADLINE = 0.2
"""Age from which an input is unknown [s]."""
HEARTBEAT = 0.5
"""Time after which the fault `stopped` is noticed [s], as by a heartbeat's deadline."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimInputFile:
    """How a simulated PLC sets one input; without a rule it is a switch that is off."""

    follows: str = value(Text(), "", "output whose value it takes")
    delay: float = value(Measure(TIME, "0 s", "1 h"), "0 s", "after which it follows")
    during: tuple[float, float] | None = value(
        OrWord(Span(Measure(TIME, "0 s", "1000 h")), "never"),
        "never",
        "times of the cell's clock between which it is on",
    )
    counts: str = value(Text(), "", "output whose rises are counted")
    most: int = value(Whole(1, 10000), "1", "count from which on it is on")
    cleared_by: str = value(Text(), "", "output whose rise starts the count anew")
    number: float | None = value(Number(), None, "a number that stays")

    def problems(self) -> Iterator[Problem]:
        rules = self.follows, self.counts, self.during is not None, self.number is not None
        if sum(map(bool, rules)) > 1:
            yield Problem("", "it has one rule: 'follows', 'during', 'counts' or 'number'")


@dataclass(frozen=True, slots=True, kw_only=True)
class SimSignalsFile:
    """A simulated PLC."""

    inputs: Mapping[str, SimInputFile] = value(
        MappingOf(Section(SimInputFile)), help="signals of the PLC's, with rules"
    )
    outputs: tuple[str, ...] = value(Words(), (), "names of the signals of ours, all switches")

    def problems(self) -> Iterator[Problem]:
        for name in sorted(set(self.outputs) & self.inputs.keys()):
            yield Problem("outputs", f"'{name}' is an input already")
        for name, rule in self.inputs.items():
            for used in filter(None, (rule.follows, rule.counts, rule.cleared_by)):
                if used not in self.outputs:
                    yield Problem(
                        "inputs", f"'{name}' needs the output '{used}'", choose(used, self.outputs)
                    )

    def known(self) -> Iterator[object]:
        """Yield the names of the signals, which a check of a tree needs."""
        yield self.names

    @property
    def names(self) -> SignalNames:
        """Names of the signals."""
        numbers = frozenset(name for name, rule in self.inputs.items() if rule.number is not None)
        return SignalNames(tuple(self.inputs), self.outputs, numbers)


class SimSignals(FaultSwitch, Device):
    """A simulated PLC: its inputs by the rules of its cell file, outputs with the times of their changes.

    Faults: `stopped` (the PLC's program stands still: the values age, then the device is faulty), `deaf` (no written
    value is accepted).
    """

    interfaces = (Signals,)
    known_faults = ("stopped", "deaf")

    def __init__(self, clock: Clock, said: SimSignalsFile) -> None:
        Device.__init__(self, "plc")
        FaultSwitch.__init__(self)
        self.names = said.names
        self._rules = said.inputs
        self._clock = clock
        self._latched = ""
        self._stopped_at: float | None = None
        # times of the changes and values: switches that are off
        self._written: dict[str, list[tuple[float, bool | float]]] = {
            name: [(-1.0, False)] for name in said.outputs
        }

    def input_at(self, name: str, t: float) -> bool | float:
        """Return an input's value at a time [s]."""
        rule = self._rules[name]
        if rule.number is not None:
            return rule.number
        if rule.follows:
            return self.written_at(rule.follows, t - rule.delay)
        if rule.counts:
            cleared = self.rises(rule.cleared_by, -1.0, t)[-1:] if rule.cleared_by else []
            return len(self.rises(rule.counts, cleared[0] if cleared else -1.0, t)) >= rule.most
        return rule.during is not None and rule.during[0] <= t <= rule.during[1]

    def written_at(self, name: str, t: float) -> bool | float:
        """Return an output's value at a time [s]."""
        return next(value for at, value in reversed(self._written[name]) if at <= t or at < 0.0)

    def rises(self, name: str, since: float, until: float) -> list[float]:
        """Return the times at which an output has risen [s]."""
        return [at for at, value in self._written[name] if value and since < at <= until]

    def newest(self) -> SignalValue | None:
        return next((self.read(name) for name in self.names.inputs), None)

    def read(self, name: str) -> SignalValue:
        now = self._clock.now()
        if name in self._written:
            return SignalValue(self._written[name][-1][1], now, 0.0)
        if name not in self.names.inputs:
            raise KeyError(name)
        stamp = now if self._stopped_at is None else self._stopped_at
        is_known = now - stamp <= DEADLINE
        return SignalValue(self.input_at(name, stamp) if is_known else None, stamp, now - stamp)

    def write(self, name: str, value: bool | float) -> None:
        changes = self._written[name]
        if self._latched:
            words = f"stays at its safe value ({self._latched})"
            raise MotionRefused(self.name, f"the output '{name}' {words}")
        if value not in (0, 1):
            words = f"cannot be written: {value:g} is no value of a switch"
            raise MotionRefused(self.name, f"the output '{name}' {words}")
        if self.fault != "deaf" and value != changes[-1][1]:
            changes.append((self._clock.now(), value))

    def check(self) -> None:
        if self._stopped_at is not None and self._clock.now() - self._stopped_at > HEARTBEAT:
            words = (
                f"its heartbeat stands still for {1e3 * HEARTBEAT:.0f} ms: its program has stopped"
            )
            self._problem = DeviceFault(self.name, words)
            self.safe_stop(words)
        super().check()

    def safe_stop(self, reason: str) -> None:
        """Let all outputs take their safe value, 0."""
        for name in self.names.outputs:
            if not self._latched and self._written[name][-1][1]:
                self._written[name].append((self._clock.now(), False))
        self._latched = self._latched or reason

    def acknowledge(self) -> None:
        self._problem = None
        self.check()
        self._latched = ""

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        self._stopped_at = self._clock.now() if kind == "stopped" else None

    def clear_fault(self) -> None:
        super().clear_fault()
        self._stopped_at = None

    def close(self) -> None:
        self.safe_stop("closed")


@driver(SimSignals, SimSignalsFile)
def connect(settings: Settings[SimSignalsFile], context: ConnectContext) -> SimSignals:
    """`driver: sim-signals`"""
    return SimSignals(context.clock, settings.values)
