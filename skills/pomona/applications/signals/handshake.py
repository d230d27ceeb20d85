"""The skill Handshake."""

from __future__ import annotations

from typing import Annotated

from pomona.applications.signals.signal_skill import SignalSkill
from pomona.devices.plc.signals import Signals
from pomona.drivers import MotionRefused
from pomona.executive import TIME, Port, Time, Work


class Handshake(SignalSkill):
    """Let the PLC do something: request, accepted, done, released; each edge has its deadline.

    The output `request` rises when both inputs are off. The PLC answers with `accepted`, then `done`; the request
    falls, and both inputs must fall. After a failure or an interruption the request is withdrawn.
    """

    moves = (Signals,)
    failures = ("EDGE_MISSED", "SIGNAL_UNKNOWN", "SIGNAL_REFUSED", "NO_SIGNAL")
    input_ports, output_ports = ("accepted", "done"), ("request",)

    def run(
        self,
        request: Annotated[str, Port(help="output that asks the PLC")],
        accepted: Annotated[str, Port(help="input by which the PLC accepts")],
        done: Annotated[str, Port(help="input by which the PLC reports the end")],
        request_within: Annotated[
            Time,
            Port(min="0 s", help="deadline of the request: both inputs off, the output accepted"),
        ] = TIME("1 s"),
        accepted_within: Annotated[
            Time, Port(min="0 s", help="deadline of `accepted` after the request")
        ] = TIME("1 s"),
        done_within: Annotated[
            Time, Port(min="0 s", help="deadline of `done` after `accepted`")
        ] = TIME("30 s"),
        released_within: Annotated[
            Time, Port(min="0 s", help="deadline of both falls after `done`")
        ] = TIME("1 s"),
    ) -> Work[None]:
        self.require_output(request)
        signals = self.device(Signals)
        both = {accepted: False, done: False}
        for name in both:
            self.reading(name, edge="request")
        yield from self._edge("request", both, request_within)
        try:
            self._set(signals, request, True)
            yield from self._edge("request", {request: True}, request_within)
            yield from self._edge("accepted", {accepted: True}, accepted_within)
            yield from self._edge("done", {done: True}, done_within)
        finally:
            self._withdraw(signals, request)
        yield from self._edge("released", {request: False, **both}, released_within)
        return None

    def _edge(self, edge: str, wanted: dict[str, bool], within: float) -> Work[None]:
        """Wait until signals have values; a failure names the edge and the first signal that has another one."""
        began = self.context.elapsed()
        while True:
            wrong = next(
                (name for name, value in wanted.items() if self._value(edge, name) != value), None
            )
            if wrong is None:
                return
            waited = self.context.elapsed() - began
            if waited >= within - 1e-9:
                word = "on" if wanted[wrong] else "off"
                words = (
                    f"the edge '{edge}' was missed: '{wrong}' was not {word} within {within:g} s"
                )
                raise self.failure("EDGE_MISSED", words, edge=edge, signal=wrong, waited_s=waited)
            yield f"{edge}: waiting for '{wrong}'"

    def _value(self, edge: str, name: str) -> bool:
        signals = self.device(Signals)
        return bool(
            signals.read(name).value
            if name in signals.names.outputs
            else self.reading(name, edge=edge)
        )

    def _set(self, signals: Signals, name: str, on: bool) -> None:
        try:
            signals.write(name, on)
        except MotionRefused as refused:
            raise self.failure(
                "SIGNAL_REFUSED", refused.message, edge="request", signal=name
            ) from refused

    def _withdraw(self, signals: Signals, name: str) -> None:
        """Take the request back; at a safe stop the device itself has done so."""
        try:
            signals.write(name, False)
        except MotionRefused:
            return
