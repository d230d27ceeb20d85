"""A PLC over Modbus TCP as `Signals`: inputs are read and outputs are written in every cycle, by one thread.

A heartbeat goes both ways. Ours toggles while the run ticks; the PLC's must change within its deadline. At a safe stop,
at a loss and at the end all outputs go to their safe values.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from pomona.devices.plc.client import ModbusClient, ModbusRefused
from pomona.devices.plc.codec import MOST, WRITES, MemorySpan
from pomona.devices.plc.places import SignalPlace, image, spans_of
from pomona.devices.plc.signals import SignalNames, Signals, SignalValue
from pomona.drivers import Device, DeviceError, DeviceFault, DeviceLost, MotionRefused, Owner
from pomona.executive import Clock

RECONNECT = 0.5
"""Pause between attempts to open a lost connection again [s]."""
STALL = 1.0
"""Time without a tick of the run after which the outputs go to their safe values [s]: the supervisor's default."""
SCAN = 0.1
"""Time for which outputs must keep their safe values at the connection [s]: some scans of a PLC's program."""


@dataclass(frozen=True, slots=True)
class SignalHeartbeat:
    """A heartbeat both ways.

    Attributes:
        output: bit of ours, which toggles.
        input: bit or register of the PLC's, which changes.
        period: between two changes of ours [s].
        deadline: time without a change after which the PLC counts as stopped [s].
    """

    output: SignalPlace
    input: SignalPlace
    period: float = 0.1
    deadline: float = 0.5


class UnfitSignal(DeviceFault):
    """A signal that the PLC does not have, or that cannot be written; `key` is its list in the cell file."""

    def __init__(self, device: str, message: str, key: str) -> None:
        self.key = key
        super().__init__(device, message)


class ModbusSignals(Device):
    """The signals. One thread owns the wire."""

    interfaces = (Signals,)
    outlives = True

    def __init__(
        self,
        open_client: Callable[[], ModbusClient],
        clock: Clock,
        inputs: Mapping[str, SignalPlace],
        outputs: Mapping[str, SignalPlace],
        heartbeat: SignalHeartbeat,
        period: float = 0.02,
        name: str = "plc",
    ) -> None:
        """`period` is that of the cycles [s]."""
        super().__init__(name)
        numbers = frozenset(one for one, place in {**inputs, **outputs}.items() if not place.is_bit)
        self.names = SignalNames(tuple(inputs), tuple(outputs), numbers)
        self._open_client, self._clock, self._period = open_client, clock, period
        self._inputs, self._outputs, self._heartbeat = dict(inputs), dict(outputs), heartbeat
        self._read_spans = spans_of((*inputs.values(), heartbeat.input))
        self._write_spans = spans_of((*outputs.values(), heartbeat.output))
        self._safe: Mapping[str, bool | float] = {
            one: bool(place.safe) if place.is_bit else place.safe for one, place in outputs.items()
        }
        self._commanded = dict(self._safe)
        self._taken: Mapping[
            str, tuple[bool | float, float]
        ] = {}  # of all signals: value and stamp
        self._client: ModbusClient | None = None
        self._problem: DeviceError | None = None
        self._latched = ""
        self._beat, self._beaten_at = False, clock.now()
        self._pulse: bool | float | None = None
        self._pulse_at = self._looked_at = self._due = self._retry_at = clock.now()
        self._owner = Owner(name, self.step, self._lose, clock)

    # ---------------------------------------------------------------------------------------- connection

    def connect(self) -> None:
        """Open the connection, see that every signal is there, and write the safe values.

        Raises:
            UnfitSignal: the PLC lacks a signal, or does not let it be written.
            DeviceError, OSError: it cannot be reached, or its program does not run.
        """
        client = self._client = self._open_client()
        try:
            for name, place in {
                **self._inputs,
                **self._outputs,
                "heartbeat": self._heartbeat.input,
            }.items():
                with self._judging(name, place, writing=False):
                    client.read(place.span)
            self._require_own()
            self._await_pulse()
            self._serve(client)
        except (DeviceError, OSError):
            self._leave()
            raise

    @contextlib.contextmanager
    def _judging(self, name: str, place: SignalPlace, *, writing: bool) -> Iterator[None]:
        """Name the signal in a refusal that concerns its address or its function."""
        try:
            yield
        except ModbusRefused as refused:
            if refused.code not in (1, 2, 3, 4):
                raise
            words = f"its signal '{name}' ({place.area} {place.first}) cannot be {'written' if writing else 'read'}"
            remedy = (
                "does a field bus or the PLC's program own it"
                if writing
                else "does its address count from 0"
            )
            key = (
                "outputs"
                if name in self._outputs
                else "inputs"
                if name in self._inputs
                else "heartbeat"
            )
            raise UnfitSignal(self.name, f"{words}: {refused.message}; {remedy}?", key) from refused

    def _require_own(self) -> None:
        """Write the safe values; they must last, or another one writes there too."""
        client = self._client
        assert client is not None
        for name, place in {**self._outputs, "heartbeat": self._heartbeat.output}.items():
            with self._judging(name, place, writing=True):
                client.write(place.area, place.first, place.encode(self._safe.get(name, False)))
        self._clock.advance(SCAN)
        for name, place in self._outputs.items():
            kept = client.read(place.span)
            if kept != place.encode(self._safe[name]):
                words = f"its signal '{name}' ({place.area} {place.first}) does not keep the value {self._safe[name]:g}"
                why = "the PLC's program or a field bus writes there; use another address"
                raise UnfitSignal(self.name, f"{words}: {why}", "outputs")

    def _await_pulse(self) -> None:
        client, place = self._client, self._heartbeat.input
        assert client is not None
        first, end = client.read(place.span), self._clock.now() + 2.0 * self._heartbeat.deadline
        while client.read(place.span) == first:
            if self._clock.now() > end:
                raise DeviceFault(
                    self.name,
                    f"its heartbeat ({place.area} {place.first}) stands still: start its program",
                )
            self._clock.advance(self._period)
        self._pulse_at = self._clock.now()

    def start(self) -> None:
        """Let the device's own thread serve it from now on."""
        self._looked_at = self._clock.now()
        self._owner.start()

    # ------------------------------------------------------------------------------------------ the wire

    def step(self) -> None:
        """Serve one cycle; the owner calls this in a loop.

        Raises OSError, DeviceLost: the wire failed, or the PLC does not answer; DeviceFault: its program has stopped.
        """
        now = self._clock.now()
        due = self._due if self._client is not None else self._retry_at
        if now < due:
            self._clock.advance(min(due - now, 0.05))
            return
        self._due = now + self._period
        if self._client is None:
            self._client = self._open_client()
        if now - self._looked_at > STALL and self._commanded != self._safe:
            self._commanded = dict(self._safe)
            self._blame(
                DeviceFault(
                    self.name,
                    f"the run stood still for {STALL:g} s: all outputs went to their safe values",
                )
            )
        self._serve(self._client)
        if self._clock.now() - self._pulse_at > self._heartbeat.deadline:
            silent = self._clock.now() - self._pulse_at
            raise DeviceFault(
                self.name,
                f"its heartbeat stands still for {1e3 * silent:.0f} ms: its program has stopped",
            )

    def _serve(self, client: ModbusClient) -> None:
        """Write all outputs and read all inputs."""
        taken = dict(self._taken)
        commanded, now = dict(self._commanded), self._clock.now()
        if now - self._beaten_at >= self._heartbeat.period and now - self._looked_at <= STALL:
            self._beat, self._beaten_at = not self._beat, now
        beat = {"heartbeat": self._heartbeat.output}
        words = image(self._outputs, commanded) | image(beat, {"heartbeat": self._beat})
        for area, first, values in writes(self._write_spans, words):
            client.write(area, first, values)
        taken |= {name: (value, now) for name, value in commanded.items()}
        memory: dict[tuple[str, int], int] = {}
        asked: dict[tuple[str, int], float] = {}
        for span in self._read_spans:
            stamp = self._clock.now()
            cells = {(span.area, span.first + i): word for i, word in enumerate(client.read(span))}
            memory |= cells
            asked |= dict.fromkeys(cells, stamp)
        for name, place in self._inputs.items():
            taken[name] = self._decoded(place, memory), asked[place.area, place.first]
        pulse = self._decoded(self._heartbeat.input, memory)
        if pulse != self._pulse:
            self._pulse, self._pulse_at = pulse, self._clock.now()
        self._taken = taken

    @staticmethod
    def _decoded(place: SignalPlace, memory: Mapping[tuple[str, int], int]) -> bool | float:
        return place.decode([memory[place.area, place.first + i] for i in range(place.span.count)])

    def _lose(self, error: BaseException) -> None:
        """The outputs are safe from now on; the connection is opened again, and nothing more is written by itself."""
        told = (
            f"the connection failed: {error}"
            if isinstance(error, OSError)
            else f"the driver failed: {error!r}"
        )
        self._blame(error if isinstance(error, DeviceError) else DeviceLost(self.name, told))
        if not isinstance(error, DeviceFault):
            self._leave()
            self._retry_at = self._clock.now() + RECONNECT

    def _blame(self, problem: DeviceError) -> None:
        self._commanded = dict(self._safe)
        self._problem = self._problem or problem

    def _leave(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()

    # --------------------------------------------------------------------------------------- the interface

    def newest(self) -> SignalValue | None:
        read = [self.read(name) for name in self._inputs if name in self._taken]
        return max(read, key=lambda one: one.stamp, default=None)

    def read(self, name: str) -> SignalValue:
        place = self._inputs.get(name) or self._outputs[name]
        value, stamp = self._taken[name]
        age = self._clock.now() - stamp
        return SignalValue(
            value if age <= place.deadline and self._problem is None else None, stamp, age
        )

    def write(self, name: str, value: bool | float) -> None:
        place = self._outputs[name]
        if self._latched or self._problem is not None:
            why = self._latched if self._problem is None else self._problem.message
            raise MotionRefused(self.name, f"the output '{name}' stays at its safe value ({why})")
        try:
            place.encode(value)
        except ValueError as error:
            raise MotionRefused(
                self.name, f"the output '{name}' cannot be written: {error}"
            ) from error
        self._owner.post(lambda: self._command(name, bool(value) if place.is_bit else value))

    def _command(self, name: str, value: bool | float) -> None:
        if not self._latched and self._problem is None:
            self._commanded = {**self._commanded, name: value}

    # ------------------------------------------------------------------------------------------ the device

    def link(self) -> str:
        return "ok" if self._problem is None else self._problem.message

    def check(self) -> None:
        self._looked_at = self._clock.now()
        if self._problem is not None:
            raise self._problem
        self._owner.check()

    def safe_stop(self, reason: str) -> None:
        """Let all outputs take their safe values in the next cycle; until `acknowledge` none is written."""
        self._latched = self._latched or reason
        self._owner.post(self._rest)

    def _rest(self) -> None:
        self._commanded = dict(self._safe)

    def settled(self) -> bool:
        """Return True if no output is on its way, or the PLC cannot be reached."""
        return self._problem is not None or all(
            self._taken[name][0] == value for name, value in self._commanded.items()
        )

    def acknowledge(self) -> None:
        """Release the latch; outputs keep their safe values. Raises DeviceError: lost, or its program stands still."""
        self._owner.ask(self._renew, 1.0)
        self._latched, self._problem = "", None

    def _renew(self) -> None:
        if self._client is None:
            raise DeviceLost(self.name, f"is still lost: {self.link()}")
        self._serve(self._client)
        if self._clock.now() - self._pulse_at > self._heartbeat.deadline:
            raise DeviceFault(self.name, "its heartbeat still stands still")

    def close(self) -> None:
        """Write the safe values and disconnect."""
        self.safe_stop("closed")
        self._owner.post(self._part)
        self._owner.close()
        self._problem = self._problem or DeviceLost(self.name, "is closed")
        self._leave()

    def _part(self) -> None:
        if self._client is not None:
            self._serve(self._client)

    # ------------------------------------------------------------------------------------------- from outside

    @property
    def safe_writes(self) -> tuple[tuple[str, int, tuple[int, ...]], ...]:
        """Writes that bring all outputs to their safe values: area, first address, values."""
        return tuple(writes(spans_of(self._outputs.values()), image(self._outputs, self._safe)))


def writes(
    spans: tuple[MemorySpan, ...], words: Mapping[tuple[str, int], int]
) -> list[tuple[str, int, tuple[int, ...]]]:
    """Return the requests that write bits and registers, by area and address: each not longer than Modbus allows."""
    found = []
    for span in spans:
        most = MOST[WRITES[span.area]] - 1
        for first in range(span.first, span.first + span.count, most):
            end = min(first + most, span.first + span.count)
            found.append(
                (span.area, first, tuple(words[span.area, at] for at in range(first, end)))
            )
    return found
