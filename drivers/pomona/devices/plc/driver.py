"""A PLC over Modbus TCP as `Signals`: inputs are read and outputs are written in every cycle, by one thread.

A heartbeat goes both ways. Ours toggles while the run ticks; the PLC's must change within its deadline. At a safe stop,
at a loss and at the end all outputs go to their safe values.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping

from pomona.devices.plc.client import ModbusClient, ModbusRefused, Write
from pomona.devices.plc.places import SignalHeartbeat, SignalPlace, image, names_of, spans_of
from pomona.devices.plc.signals import Signals, SignalValue
from pomona.drivers import Device, DeviceError, DeviceFault, DeviceLost, MotionRefused, Owner
from pomona.executive import Clock

RECONNECT = 0.5
"""Pause between attempts to open a lost connection again [s]."""
STALL = 1.0
"""Time without a tick of the run after which the outputs go to their safe values [s]: the supervisor's default."""
BEAT = "(heartbeat)"
"""Stands for the name of a signal in messages about the heartbeat."""
SCAN = 0.1
"""Time for which outputs must keep their safe values at the connection [s]: some scans of a PLC's program."""


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
        self.names = names_of(inputs, outputs)
        self._open_client = open_client
        self._clock = clock
        self._period = period
        self._inputs, self._outputs, self._heartbeat = dict(inputs), dict(outputs), heartbeat
        self._read_places = {**inputs, **outputs, BEAT: SignalPlace(heartbeat.input)}
        self._write_places = {**outputs, BEAT: SignalPlace(heartbeat.output)}
        self._read_spans = spans_of(self._read_places.values())
        self._safe = {name: place.safe for name, place in outputs.items()}
        self._commanded = dict(self._safe)
        self._written: Mapping[str, bool | float] = {}  # to this connection
        # value and stamp of all signals, as the PLC has them
        self._taken: Mapping[str, tuple[bool | float, float]] = {}
        self._client: ModbusClient | None = None
        self._latched = ""
        self._beat, self._beaten_at = False, clock.now()
        self._pulse: bool | float | None = None
        self._pulse_at = self._looked_at = self._due = clock.now()
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
            for name, place in self._read_places.items():
                with self._judging(name, place, "read", "does its address count from 0"):
                    client.read(place.span)
            self._require_own(client)
            self._serve(client)
            first = self._pulse
            while self._pulse == first:
                self._require_pulse("start its program")
                self._clock.advance(self._period)
                self._serve(client)
        except (DeviceError, OSError):
            self._leave()
            raise

    @contextlib.contextmanager
    def _judging(self, name: str, place: SignalPlace, doing: str, remedy: str) -> Iterator[None]:
        """Name the signal in a refusal that concerns its address or its function."""
        try:
            yield
        except ModbusRefused as refused:
            if refused.code not in (1, 2, 3, 4):
                raise
            words = f"cannot be {doing}: {refused.message}; {remedy}?"
            raise self._unfit(name, place, words) from refused

    def _unfit(self, name: str, place: SignalPlace, words: str) -> UnfitSignal:
        lists = {"inputs": self._inputs, "outputs": self._outputs}
        key = next((key for key, places in lists.items() if name in places), "heartbeat")
        return UnfitSignal(self.name, f"its signal '{name}' ({place.at}) {words}", key)

    def _require_own(self, client: ModbusClient) -> None:
        """Write the safe values; they must last, or another one writes there too."""
        values = {**self._safe, BEAT: False}
        for name, place in self._write_places.items():
            owned = "does a field bus or the PLC's program own it"
            with self._judging(name, place, "written", owned):
                client.write(place.area, place.span.first, place.encode(values[name]))
        self._written = self._safe
        self._clock.advance(SCAN)

    def _require_pulse(self, words: str) -> None:
        """Raise DeviceFault if the PLC's heartbeat stands still."""
        silent = self._clock.now() - self._pulse_at
        if silent > self._heartbeat.deadline:
            still = (
                f"its heartbeat ({self._heartbeat.input}) stands still for {1e3 * silent:.0f} ms"
            )
            raise DeviceFault(self.name, f"{still}: {words}; or raise heartbeat.deadline")

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
        if now < self._due:
            self._clock.advance(min(self._due - now, 0.05))
            return
        self._due = now + self._period
        if self._client is None:
            self._client = self._open_client()
        if now - self._looked_at > STALL and self._commanded != self._safe:
            words = f"the run stood still for {STALL:g} s: all outputs went to their safe values"
            self._blame(DeviceFault(self.name, words))
        self._serve(self._client)
        self._require_pulse("its program has stopped")

    def _serve(self, client: ModbusClient) -> None:
        """Read all signals, and write all outputs. Raises UnfitSignal: another one has written an output."""
        commanded = dict(self._commanded)
        written = self._written
        now = self._clock.now()
        if now - self._beaten_at >= self._heartbeat.period and now - self._looked_at <= STALL:
            self._beat = not self._beat
            self._beaten_at = now
        taken: dict[str, tuple[bool | float, float]] = {}
        memory: dict[tuple[str, int], tuple[int, float]] = {}
        for span in self._read_spans:
            stamp = self._clock.now()
            for cell, word in zip(span.cells, client.read(span), strict=True):
                memory[cell] = word, stamp
        for name, place in self._read_places.items():
            words, stamps = zip(*(memory[cell] for cell in place.span.cells), strict=True)
            taken[name] = place.decode(words), stamps[0]
        for area, first, values in writes(self._write_places, {**commanded, BEAT: self._beat}):
            client.write(area, first, values)
        self._written = commanded
        pulse, _stamp = taken.pop(BEAT)
        if pulse != self._pulse:
            self._pulse, self._pulse_at = pulse, self._clock.now()
        self._taken = taken
        for name, value in written.items():
            place = self._outputs[name]
            if taken[name][0] != place.decode(place.encode(value)):
                why = "the PLC's program or a field bus writes there; use another address"
                raise self._unfit(name, place, f"does not keep the value {value:g}: {why}")

    def _lose(self, error: BaseException) -> None:
        """The outputs are safe from now on; the connection is opened again, and nothing more is written by itself."""
        if not isinstance(error, DeviceError):
            failed = f"the connection failed: {error}"
            if not isinstance(error, OSError):
                failed = f"the driver failed: {error!r}"
            error = DeviceLost(self.name, failed)
        self._blame(error)
        if not isinstance(error, DeviceFault):
            self._leave()
            self._due = self._clock.now() + RECONNECT

    def _rest(self) -> None:
        self._commanded = dict(self._safe)

    def _blame(self, problem: DeviceError) -> None:
        self._rest()
        self._problem = self._problem or problem

    def _leave(self) -> None:
        client = self._client
        self._client = None
        self._written = {}
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
        is_known = age <= place.deadline and self._problem is None
        return SignalValue(value if is_known else None, stamp, age)

    def write(self, name: str, value: bool | float) -> None:
        place = self._outputs[name]
        why = self._latched if self._problem is None else self._problem.message
        if why:
            raise MotionRefused(self.name, f"the output '{name}' stays at its safe value ({why})")
        try:
            place.encode(value)
        except ValueError as error:
            words = f"the output '{name}' cannot be written: {error}"
            raise MotionRefused(self.name, words) from error
        self._owner.post(lambda: self._command(name, value))

    def _command(self, name: str, value: bool | float) -> None:
        if not self._latched and self._problem is None:
            self._commanded = {**self._commanded, name: value}

    # ------------------------------------------------------------------------------------------ the device

    def check(self) -> None:
        self._looked_at = self._clock.now()
        super().check()
        self._owner.check()

    def safe_stop(self, reason: str) -> None:
        """Let all outputs take their safe values in the next cycle; until `acknowledge` none is written."""
        self._latched = self._latched or reason
        self._owner.post(self._rest)

    def settled(self) -> bool:
        """Return True if no output is on its way, or the PLC cannot be reached."""
        return self._problem is not None or all(
            self._taken[name][0] == value for name, value in self._commanded.items()
        )

    def acknowledge(self) -> None:
        """Release the latch; outputs keep their safe values. Raises DeviceError: lost, or its program stands still."""
        self._owner.ask(self._renew, 1.0)
        self._latched = ""
        self._problem = None

    def _renew(self) -> None:
        if self._client is None:
            raise DeviceLost(self.name, f"is still lost: {self.link()}")
        self._serve(self._client)
        self._require_pulse("its program has stopped")

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
    def safe_writes(self) -> tuple[Write, ...]:
        """Writes that bring all outputs to their safe values."""
        return tuple(writes(self._outputs, self._safe))


def writes(
    places: Mapping[str, SignalPlace], values: Mapping[str, bool | float]
) -> Iterator[Write]:
    """Yield the requests that write values, each not longer than Modbus allows."""
    words = image(places, values)
    for span in spans_of(places.values()):
        yield span.area, span.first, tuple(words[cell] for cell in span.cells)
