"""The skill WaitSignal."""

from __future__ import annotations

from typing import Annotated

from pomona.applications.signals.signal_skill import SignalSkill
from pomona.executive import TIME, Outputs, Port, Time, Work


class SeenSignal(Outputs):
    """Outputs of WaitSignal."""

    value: Annotated[float, Port(help="value of the signal; 1 of a switch that is on")]


class WaitSignal(SignalSkill):
    """Wait until an input of the PLC is on or off, or a number is within limits.

    A value past its deadline is unknown: the skill fails, and it counts as neither on nor off. `within: 0 s` asks once.
    """

    failures = ("SIGNAL_TIMEOUT", "SIGNAL_UNKNOWN", "NO_SIGNAL")
    input_ports = ("signal",)

    def run(
        self,
        signal: Annotated[str, Port(help="name of an input in the cell file")],
        state: Annotated[bool, Port(help="whether a switch must be on or off")] = True,
        least: Annotated[float | None, Port(help="smallest value of a number")] = None,
        most: Annotated[float | None, Port(help="largest value of a number")] = None,
        within: Annotated[Time, Port(min="0 s", help="deadline; 0 s asks once")] = TIME("1 min"),
    ) -> Work[SeenSignal]:
        began = self.context.elapsed()
        wanted = _words(state, least, most)
        while True:
            value = self.reading(signal)
            if _fits(value, state, least, most):
                return SeenSignal(value=float(value))
            waited = self.context.elapsed() - began
            if waited >= within - 1e-9:
                words = f"the signal '{signal}' was not {wanted} within {within:g} s; it is {_shown(value)}"
                raise self.failure(
                    "SIGNAL_TIMEOUT", words, signal=signal, value=value, waited_s=waited
                )
            yield f"waiting until '{signal}' is {wanted}; it is {_shown(value)}"


def _fits(value: bool | float, state: bool, least: float | None, most: float | None) -> bool:
    if least is None and most is None:
        return bool(value) == state
    return (least is None or value >= least) and (most is None or value <= most)


def _words(state: bool, least: float | None, most: float | None) -> str:
    ends = ("at least", least), ("at most", most)
    limits = [f"{word} {limit:g}" for word, limit in ends if limit is not None]
    return " and ".join(limits) or ("on" if state else "off")


def _shown(value: bool | float) -> str:
    return ("on" if value else "off") if isinstance(value, bool) else f"{value:g}"
