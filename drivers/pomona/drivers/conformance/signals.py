"""Claims of signals to and from a PLC, judged by what truly stands in the PLC's memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from pomona.drivers.conformance.bench import Bench
from pomona.drivers.conformance.claims import Claims, Finding, judge_notice
from pomona.drivers.errors import DeviceError, MotionRefused
from pomona.executive.cell.device import FaultSwitch
from pomona.executive.clock import Clock

LASTS = 1.0  # a harm of this length is noticed [s]
SOON = 0.2  # a change arrives within this time, and a value that is older is unknown [s]
SHORT = 0.06  # a change of this length is not missed [s]


class Plc(Protocol):
    """The PLC as it truly is. Its switch `held` is on from the start, `free` is off."""

    held: str
    free: str
    output: str

    def put(self, name: str, *, on: bool) -> None:
        """Let the program set an input."""

    def taken(self) -> bool:
        """Return the output `output`, as it stands in the memory; its safe value is off."""


class SignalsBench(Bench):
    """Signals' driver, and the PLC.

    Attributes:
        told: values of each input that the driver told for the first time in a row.
    """

    def __init__(
        self,
        device: object,
        clock: Clock,
        plc: Plc,
        *switches: FaultSwitch,
        overwrite: Callable[[], None] | None = None,
        without: tuple[str, ...] = (),
    ) -> None:
        """
        Args:
            overwrite: another master of the PLC changes the output's value.
            switches, without: see the base.
        """
        super().__init__(device, clock, *switches, without=without)
        self.plc = plc
        self.overwrite = overwrite
        self.told: list[bool | float | None] = []
        self.freed_at = -math.inf
        self.is_free_on = False
        self.each_step.append(self._read)
        self.serve(0.3)

    def put(self, *, on: bool) -> None:
        """Let the PLC set the switch `free`."""
        self.plc.put(self.plc.free, on=on)
        self.is_free_on, self.freed_at = on, self.now

    def write(self, seconds: float = SOON) -> None:
        """Set the output, and give it time [s]."""
        self.device.write(self.plc.output, True)
        self.serve(seconds)

    def need_safe(self, words: str) -> None:
        """Raise Finding: the output is on."""
        if self.plc.taken():
            raise Finding(f"{words} the output is on")

    def need_latch(self, words: str) -> None:
        """Raise Finding: the output is on, can be written, or does not stay off when that is acknowledged."""
        self.need_safe(words)
        with suppress(MotionRefused):
            self.device.write(self.plc.output, True)
            raise Finding(f"{words} it takes a value")
        with suppress(DeviceError):
            self.device.acknowledge()
        self.serve(0.5)
        self.need_safe(f"{words} acknowledged,")
        self.write()
        if not self.plc.taken():
            raise Finding(f"{words} acknowledged, a new value does not arrive")

    def _read(self) -> None:
        self.problem()  # the run's tick
        value = self.device.read(self.plc.free).value
        if not self.told or self.told[-1] != value:
            self.told.append(value)
        if self.device.read(self.plc.held).value not in (None, True):
            raise Finding("a switch that was on all the time is told as off")
        if self.now > self.freed_at + 2.0 * SOON and value not in (None, self.is_free_on):
            raise Finding(
                f"a switch has been {'on' if self.is_free_on else 'off'}, and is told otherwise"
            )


Opened = Callable[[], SignalsBench]
SIGNALS: Claims[SignalsBench] = Claims("signals")


def signals_claims(**benches: Opened) -> Callable[..., None]:
    """Return a test for pytest of every claim, for each bench by its name."""
    return SIGNALS.tests(**benches)


@SIGNALS.essential
def a_harm_is_noticed(opened: Opened) -> None:
    """A lost wire and a PLC that stands still are reported, until that is acknowledged."""
    judge_notice(opened, LASTS)


@SIGNALS.essential
def only_an_edge_is_one(opened: Opened) -> None:
    """What is told of a switch is true or unknown: one that is on all the time never seems to rise."""
    for harm in ("", *opened().harms):
        for on in (True, False):
            bench = opened()
            bench.put(on=not on)
            bench.serve(0.3)
            bench.harm(harm, 0.1)
            bench.put(on=on)
            bench.serve(LASTS)
            bench.heal()
            bench.serve(1.5)
            with suppress(DeviceError):
                bench.device.acknowledge()
            bench.serve(0.5)


@SIGNALS.essential
def outputs_end_safe(opened: Opened) -> None:
    """At a stop, a loss and the end an output takes its safe value, and keeps it until that is acknowledged."""
    bench = opened()
    bench.write()
    bench.device.safe_stop("test")
    bench.serve(SOON)
    bench.need_latch("after a stop")
    bench.device.close()
    bench.need_safe("closed,")
    for harm in opened().harms:
        bench = opened()
        bench.write()
        bench.harm(harm, LASTS)
        bench.heal()
        bench.serve(1.5)
        bench.need_latch(f"'{harm}':")


@SIGNALS.claim
def a_short_change_is_told(opened: Opened) -> None:
    """A change that lasts 60 ms is told, such as an order that the PLC withdraws."""
    bench = opened()
    bench.told.clear()
    for on in (True, False, True, False):
        bench.put(on=on)
        bench.serve(SHORT)
    bench.serve(SOON)
    if bench.told != [False, True, False, True, False] and bench.told != [True, False, True, False]:
        raise Finding(f"of two pulses it told {bench.told}")


@SIGNALS.claim
def an_output_is_told_when_it_is_taken(opened: Opened) -> None:
    """An output arrives soon, and is told when the PLC has it, not before."""
    bench = opened()
    bench.device.write(bench.plc.output, True)

    def compare() -> None:
        if bench.device.read(bench.plc.output).value and not bench.plc.taken():
            raise Finding("it tells a value that the PLC does not have")

    compare()
    bench.each_step.append(compare)
    bench.serve(SOON)
    if not bench.plc.taken() or not bench.device.read(bench.plc.output).value:
        raise Finding(f"after {SOON:g} s it has not arrived")


@SIGNALS.claim
def an_overwritten_output_is_noticed(opened: Opened) -> None:
    """An output that another master writes is read back, and reported."""
    bench = opened()
    if bench.overwrite is None:
        return  # nothing else writes there
    for on in (True, False):
        bench = opened()
        if on:
            bench.write()
        assert bench.overwrite is not None
        bench.overwrite()
        bench.serve(SOON)
        if not bench.problem():
            raise Finding(f"{'on' if on else 'off'}, it was overwritten, and nothing is reported")


@SIGNALS.claim
def a_value_that_does_not_fit_is_refused(opened: Opened) -> None:
    """A value that is none of a switch is refused, and nothing is written."""
    bench = opened()
    for value in (2.0, -1.0, math.nan):
        with suppress(MotionRefused):
            bench.device.write(bench.plc.output, value)
            raise Finding(f"it takes {value:g}")
    bench.serve(SOON)
    bench.need_safe("refused,")
