"""Signals of a PLC as a device: named inputs and outputs, each a switch or a number, with its age."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from pomona.executive import command, stamped


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
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    numbers: frozenset[str] = frozenset()


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
