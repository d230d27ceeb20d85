"""The driver `modbus-signals` of a cell file.

plc:
  driver: modbus-signals
  address: 192.168.1.40
  heartbeat: {output: coil 0, input: discrete 0}
  inputs:
    start: {at: discrete 1}
    mass: {at: input 10, type: float32, deadline: 1 s}
  outputs:
    ready: {at: coil 1}
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from pomona.devices.plc import client
from pomona.devices.plc.client import ModbusClient, ModbusRefused
from pomona.devices.plc.codec import PORT
from pomona.devices.plc.driver import ModbusSignals, UnfitSignal
from pomona.devices.plc.places import READABLE, WRITABLE, SignalHeartbeat, SignalPlace, names_of
from pomona.drivers import (
    Address,
    ConnectContext,
    DeviceError,
    DeviceLost,
    Nonsense,
    Settings,
    driver,
    tcp_opener,
)
from pomona.executive import (
    TIME,
    Flag,
    MappingOf,
    Measure,
    Number,
    Problem,
    Section,
    Whole,
    value,
)

POLL = 0.02  # time between two cycles [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusInputFile(SignalPlace):
    """A signal that the PLC gives."""

    at: str = value(READABLE, help="area and address, which counts from 0: discrete 3, input 10")
    deadline: float = value(
        Measure(TIME, "20 ms", "1 min"), "200 ms", "age from which it is unknown"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusOutputFile(SignalPlace):
    """A signal that the run gives."""

    at: str = value(WRITABLE, help="area and address, which counts from 0: coil 3, holding 10")
    safe: float = value(
        Number(), "0", "value at a safe stop, before the first command and after the run"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusSignalsFile:
    """Signals of a PLC over Modbus TCP."""

    address: tuple[str, int] = value(Address(PORT), help="HOST or HOST:PORT of the PLC")
    unit: int = value(Whole(0, 255), "1", "its unit; a PLC without a gateway takes any, or 255")
    heartbeat: SignalHeartbeat = value(
        Section(SignalHeartbeat), help="{output: coil 0, input: discrete 0}"
    )
    inputs: Mapping[str, ModbusInputFile] = value(
        MappingOf(Section(ModbusInputFile)), help="signals of the PLC's"
    )
    outputs: Mapping[str, ModbusOutputFile] = value(
        MappingOf(Section(ModbusOutputFile)), {}, "signals of ours"
    )
    silence: float = value(
        Measure(TIME, "20 ms", "500 ms"), "200 ms", "without an answer for this long it is lost"
    )
    low_word_first: bool = value(
        Flag(), False, "numbers of two registers begin with their lower half"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address[0]}:{self.address[1]}",)

    def places(self, signals: Mapping[str, SignalPlace]) -> dict[str, SignalPlace]:
        """Return places of signals with the order of words that holds for all."""
        low = self.low_word_first
        return {name: replace(one, low_word_first=low) for name, one in signals.items()}

    def problems(self) -> Iterator[Problem]:
        for name in sorted(self.inputs.keys() & self.outputs.keys()):
            yield Problem("outputs", f"'{name}' is an input already")
        beat = self.heartbeat
        beats = {
            "heartbeat.output": SignalPlace(beat.output),
            "heartbeat.input": SignalPlace(beat.input),
        }
        lists: Mapping[str, Mapping[str, SignalPlace]] = {
            "heartbeat": beats,
            "inputs": self.inputs,
            "outputs": self.outputs,
        }
        owner: dict[tuple[str, int], str] = {}
        for key, places in lists.items():
            for name, place in places.items():
                for area, at in sorted(owner.keys() & place.span.cells)[:1]:
                    words = f"'{name}' and '{owner[area, at]}' both take {area} {at}"
                    yield Problem(key, words, "give each a place of its own")
                owner |= dict.fromkeys(place.span.cells, name)

    def known(self) -> Iterator[object]:
        """Yield the names of the signals, which a check of a tree needs."""
        yield names_of(self.inputs, self.outputs)


@driver(ModbusSignals, ModbusSignalsFile)
def connect(settings: Settings[ModbusSignalsFile], context: ConnectContext) -> ModbusSignals:
    """Open the PLC that a cell file describes, and write the safe values of the outputs."""
    said = settings.values
    host, port = said.address
    open_link = tcp_opener(host, port, context.wires)

    def open_client() -> ModbusClient:
        return ModbusClient(settings.name, open_link(), context.clock, said.unit, said.silence)

    places = said.places(said.inputs), said.places(said.outputs)
    signals = ModbusSignals(
        open_client, context.clock, *places, said.heartbeat, POLL, settings.name
    )
    signals.outside_stop = f"{client.__name__}:stop", (host, port, said.unit, signals.safe_writes)
    unit = "is it the unit's number (without a gateway often 1 or 255), and does that port speak Modbus TCP?"
    garbage = f"does another protocol answer on port {port}? Modbus TCP is usually 502; if it is Modbus, is 'unit' right?"
    return settings.opened(
        signals,
        {
            UnfitSignal: ("inputs", ""),
            ModbusRefused: ("unit", unit),
            Nonsense: ("address", garbage),
            DeviceLost: ("unit", unit),
            DeviceError: ("heartbeat", ""),
            OSError: ("address", f"is Modbus TCP switched on in the PLC, on port {port}?"),
        },
    )
