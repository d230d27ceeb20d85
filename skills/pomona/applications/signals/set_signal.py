"""The skill SetSignal."""

from __future__ import annotations

from typing import Annotated

from pomona.applications.signals.signal_skill import SignalSkill
from pomona.devices.plc.signals import Signals
from pomona.drivers import MotionRefused
from pomona.executive import TIME, Port, Time, Work


class SetSignal(SignalSkill):
    """Set an output to the PLC, and wait until the PLC has accepted it; it stays until it is set again."""

    moves = (Signals,)
    failures = ("SIGNAL_NOT_TAKEN", "SIGNAL_REFUSED", "NO_SIGNAL")
    output_ports = ("signal",)

    def run(
        self,
        signal: Annotated[str, Port(help="name of an output in the cell file")],
        state: Annotated[bool, Port(help="whether a switch is on or off")] = True,
        number: Annotated[float | None, Port(help="value of a number")] = None,
        within: Annotated[Time, Port(min="0 s", help="deadline of the PLC's acceptance")] = TIME(
            "500 ms"
        ),
    ) -> Work[None]:
        self.require_output(signal)
        signals, began = self.device(Signals), self.context.elapsed()
        value = state if number is None else number
        try:
            signals.write(signal, value)
        except MotionRefused as refused:
            raise self.failure("SIGNAL_REFUSED", refused.message, signal=signal) from refused
        asked = self.clock.now()
        while (taken := signals.read(signal)).value != value or taken.stamp < asked:
            waited = self.context.elapsed() - began
            if waited >= within:
                words = f"the PLC has not accepted '{signal}' = {value:g} within {within:g} s"
                raise self.failure("SIGNAL_NOT_TAKEN", words, signal=signal, waited_s=waited)
            yield f"setting '{signal}'"
        return None
