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
from dataclasses import dataclass

from pomona.devices.plc import outside
from pomona.devices.plc.client import ModbusClient, ModbusRefused
from pomona.devices.plc.codec import PORT
from pomona.devices.plc.driver import ModbusSignals, SignalHeartbeat, UnfitSignal
from pomona.devices.plc.places import NUMBERS, SignalPlace
from pomona.devices.plc.signals import SignalNames
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
    Text,
    Whole,
    value,
)

ADDRESS = r"(6553[0-5]|655[0-2]\d|65[0-4]\d\d|6[0-4]\d{3}|[1-5]?\d{1,4})"
READABLE = Text(
    pattern=f"(coil|discrete|holding|input) {ADDRESS}",
    words="an area (coil, discrete, holding, input) and an address from 0 to 65535",
)
WRITABLE = Text(
    pattern=f"(coil|holding) {ADDRESS}",
    words="an area that can be written (coil, holding) and an address, 0 to 65535",
)
LAST = 65535
"""Largest address."""
DEADLINE = 0.2
"""Age from which a signal is unknown where the cell file gives no deadline [s]: ten cycles."""


def _placed(at: str) -> tuple[str, int]:
    area, address = at.split()
    return area, int(address)


def _beyond(at: str, kind: str) -> Iterator[Problem]:
    """Yield the problem of a number whose second register has no address."""
    if _placed(at)[1] + SignalPlace(*_placed(at), kind).span.count - 1 > LAST:
        yield Problem("at", f"a {kind} takes two registers, and {at} is the last one")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusInputFile:
    """A signal that the PLC gives."""

    at: str = value(READABLE, help="area and address, which counts from 0: discrete 3, input 10")
    type: str = value(Text(*NUMBERS), "uint16", "kind of a number in registers")
    scale: float = value(Number(1e-6, 1e9), "1", "value of one count")
    deadline: float | None = value(
        Measure(TIME, "20 ms", "1 min"), None, "age from which it is unknown; default 200 ms"
    )

    def problems(self) -> Iterator[Problem]:
        yield from _beyond(self.at, self.type)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusOutputFile:
    """A signal that the run gives."""

    at: str = value(WRITABLE, help="area and address, which counts from 0: coil 3, holding 10")
    type: str = value(Text(*NUMBERS), "uint16", "kind of a number in registers")
    scale: float = value(Number(1e-6, 1e9), "1", "value of one count")
    safe: float = value(
        Number(), "0", "value at a safe stop, before the first command and after the run"
    )

    def problems(self) -> Iterator[Problem]:
        area, first = _placed(self.at)
        yield from _beyond(self.at, self.type)
        try:
            SignalPlace(area, first, self.type, self.scale).encode(self.safe)
        except ValueError as error:
            yield Problem("safe", str(error))


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalHeartbeatFile:
    """A heartbeat both ways."""

    output: str = value(WRITABLE, help="bit or register of ours that toggles: coil 0")
    input: str = value(READABLE, help="bit or register of the PLC's that changes: discrete 0")
    period: float = value(Measure(TIME, "20 ms", "1 s"), "100 ms", "between two changes of ours")
    deadline: float = value(
        Measure(TIME, "50 ms", "5 s"), "500 ms", "without a change the PLC counts as stopped"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusSignalsFile:
    """Signals of a PLC over Modbus TCP."""

    address: tuple[str, int] = value(Address(PORT), help="HOST or HOST:PORT of the PLC")
    unit: int = value(Whole(0, 255), "1", "its unit; a PLC without a gateway takes any, or 255")
    heartbeat: SignalHeartbeatFile = value(
        Section(SignalHeartbeatFile), help="{output: coil 0, input: discrete 0}"
    )
    inputs: Mapping[str, ModbusInputFile] = value(
        MappingOf(Section(ModbusInputFile)), help="signals of the PLC's"
    )
    outputs: Mapping[str, ModbusOutputFile] = value(
        MappingOf(Section(ModbusOutputFile)), {}, "signals of ours"
    )
    poll: float = value(Measure(TIME, "5 ms", "1 s"), "20 ms", "time between two cycles")
    silence: float = value(
        Measure(TIME, "20 ms", "500 ms"), "200 ms", "without an answer for this long it is lost"
    )
    low_word_first: bool = value(
        Flag(), False, "numbers of two registers begin with their lower half"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address[0]}:{self.address[1]}",)

    @property
    def input_places(self) -> dict[str, SignalPlace]:
        """Places of the inputs."""
        return {
            name: self._place(one, 0.0, one.deadline or DEADLINE)
            for name, one in self.inputs.items()
        }

    @property
    def output_places(self) -> dict[str, SignalPlace]:
        """Places of the outputs."""
        return {name: self._place(one, one.safe, DEADLINE) for name, one in self.outputs.items()}

    def _place(
        self, one: ModbusInputFile | ModbusOutputFile, safe: float, deadline: float
    ) -> SignalPlace:
        return SignalPlace(
            *_placed(one.at), one.type, one.scale, self.low_word_first, safe, deadline
        )

    @property
    def beat(self) -> SignalHeartbeat:
        """The heartbeat."""
        said = self.heartbeat
        return SignalHeartbeat(
            SignalPlace(*_placed(said.output)),
            SignalPlace(*_placed(said.input)),
            said.period,
            said.deadline,
        )

    def problems(self) -> Iterator[Problem]:
        for name in sorted(self.inputs.keys() & self.outputs.keys()):
            yield Problem("outputs", f"'{name}' is an input already")
        beats = {"heartbeat.output": self.beat.output, "heartbeat.input": self.beat.input}
        owner: dict[tuple[str, int], str] = {}
        for name, place in [
            *beats.items(),
            *self.input_places.items(),
            *self.output_places.items(),
        ]:
            there = {(place.area, place.first + i) for i in range(place.span.count)}
            taken = sorted((*at, owner[at]) for at in there & owner.keys())
            if taken:
                area, at, other = taken[0]
                key = (
                    "inputs"
                    if name in self.inputs
                    else "outputs"
                    if name in self.outputs
                    else "heartbeat"
                )
                yield Problem(
                    key,
                    f"'{name}' and '{other}' both take {area} {at}",
                    "give each a place of its own",
                )
            owner |= dict.fromkeys(there, name)

    def known(self) -> Iterator[object]:
        """Yield the names of the signals, which a check of a tree needs."""
        places = {**self.input_places, **self.output_places}
        numbers = frozenset(name for name, place in places.items() if not place.is_bit)
        spans = {
            name: places[name].scale * 2.0 ** (16 * places[name].span.count) for name in numbers
        }
        counts = {
            name: (places[name].scale, span)
            for name, span in spans.items()
            if places[name].kind != "float32"
        }
        yield SignalNames(tuple(self.inputs), tuple(self.outputs), numbers, counts)


@driver(ModbusSignals, ModbusSignalsFile)
def connect(settings: Settings[ModbusSignalsFile], context: ConnectContext) -> ModbusSignals:
    """Open the PLC that a cell file describes, and write the safe values of the outputs."""
    said = settings.values
    host, port = said.address
    open_link = tcp_opener(host, port, context.wires)

    def open_client() -> ModbusClient:
        return ModbusClient(settings.name, open_link(), context.clock, said.unit, said.silence)

    places = said.input_places, said.output_places
    signals = ModbusSignals(
        open_client, context.clock, *places, said.beat, said.poll, settings.name
    )
    signals.outside_stop = f"{outside.__name__}:stop", (host, port, said.unit, signals.safe_writes)
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
