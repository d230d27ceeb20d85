"""Signals of a PLC as a device: named inputs and outputs, each a switch or a number, with its age."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from pomona.drivers import Surroundings
from pomona.executive import Problem, choose, command, stamped


@dataclass(frozen=True, slots=True)
class SignalValue:
    """One signal.

    Attributes:
        value: a switch or a number; None when it is unknown, since it is older than its deadline.
        stamp: time at which it was asked for on the cell's clock [s].
        age: time since then [s].
    """

    value: bool | float | None
    stamp: float
    age: float


@dataclass(frozen=True, slots=True)
class SignalNames:
    """Names of a cell's signals, known before any connection.

    Attributes:
        inputs, outputs: all of the PLC's signals that a run reads, and those that it writes.
        numbers: those of them that are numbers.
        counts: of those that are counted in registers, the value of one count and the span of all, after which they
            begin anew.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    numbers: frozenset[str] = frozenset()
    counts: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def lacking(
        self, key: str, name: str, *, output: bool = False, number: bool = False
    ) -> Iterator[Problem]:
        """Yield the problem of a driver's option `key` that names a signal of another kind, or none."""
        known = [
            each
            for each in (self.outputs if output else self.inputs)
            if (each in self.numbers) is number
        ]
        if name not in known:
            kind = "output" if output else "input"
            words = f"the PLC has no {kind} '{name}' that is a {'number' if number else 'switch'}"
            yield Problem(key, words, choose(name, known))


@runtime_checkable
class Signals(Protocol):
    """Inputs and outputs of a PLC. Every call takes the newest values and does not wait."""

    @property
    def names(self) -> SignalNames:
        """Names of the signals."""

    @stamped
    def newest(self) -> SignalValue | None:
        """Return the newest value of any input, or None before the first."""

    def read(self, name: str) -> SignalValue:
        """Return an input, or an output as the PLC has accepted it last. Raises KeyError: there is no such signal."""

    @command
    def write(self, name: str, value: bool | float) -> None:
        """Command an output; `read` shows when the PLC has accepted it. At a safe stop it takes its safe value.

        Raises:
            KeyError: there is no such output.
            MotionRefused: the device is latched or lost, or the value does not fit; nothing has changed.
        """


def fit_signals(
    around: Surroundings, unfit: Callable[[SignalNames], Iterable[Problem]]
) -> Iterator[Problem]:
    """Yield the conflicts of a driver's signals with those of the PLC above it, by `unfit`; without a PLC that one."""
    plc = next(
        (name for name, device in around.above.items() if Signals in device.interfaces), None
    )
    if plc is None:
        yield Problem("driver", "it needs a PLC above it", "plc: {driver: modbus-signals, …}")
    for fact in getattr(around.options.get(plc or ""), "known", tuple)():
        if isinstance(fact, SignalNames):
            yield from unfit(fact)
