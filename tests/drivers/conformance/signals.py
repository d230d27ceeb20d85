"""A bench of every driver of signals that ships."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pomona.devices.emulators.pipes import Pipe
from pomona.devices.laboratory_emulators.modbus_plc import PlcEmulator
from pomona.devices.plc.client import ModbusClient
from pomona.devices.plc.driver import ModbusSignals
from pomona.devices.plc.places import SignalHeartbeat, SignalPlace
from pomona.drivers.conformance import SignalsBench, Wire
from pomona.tools.mock import MockClock
from tests.drivers.conformance.grippers import timed
from tests.drivers.devices.plc.mock_signals import MockSignals

PLACES = {"held": SignalPlace("discrete 1"), "free": SignalPlace("discrete 2")}
OUTPUT = {"out": SignalPlace("coil 1")}


class Memory:
    """An emulated PLC's memory."""

    held, free, output = "held", "free", "out"

    def __init__(self, plc: PlcEmulator) -> None:
        self._plc = plc
        self.put("held", on=True)

    def put(self, name: str, *, on: bool) -> None:
        self._plc.memory["discrete"][PLACES[name].span.first] = int(on)

    def taken(self) -> bool:
        return bool(self._plc.memory["coil"][1])

    def overwrite(self) -> None:
        self._plc.memory["coil"][1] ^= 1


class Served(SignalsBench):
    """A driver whose errors its owner hands back to it."""

    def step(self) -> None:
        try:
            super().step()
        except Exception as error:
            self.device._lose(error)


def modbus() -> SignalsBench:
    """A PLC over Modbus TCP."""
    clock, time = timed()
    plc = PlcEmulator()
    memory = Memory(plc)
    clock.each_step.append(plc.advance)
    wire = Wire(Pipe(plc, time).open)
    signals = ModbusSignals(
        lambda: ModbusClient("plc", wire.open(), time),
        time,
        PLACES,
        OUTPUT,
        SignalHeartbeat(output="coil 0", input="discrete 0"),
    )
    signals.connect()
    return Served(
        signals,
        time,
        memory,
        wire,
        plc,
        overwrite=memory.overwrite,
        without=("half", "overwriting", "other_unit", "owned"),  # of the connection
    )


class Rules:
    """A simulated PLC's inputs, as a test sets them."""

    held, free, output = "held", "free", "out"

    def __init__(self, signals: Any) -> None:
        self._signals = signals

    def put(self, name: str, *, on: bool) -> None:
        self._signals.values[name] = on

    def taken(self) -> bool:
        return bool(self._signals.written_at("out", self._signals._clock.now()))


def mock() -> SignalsBench:
    """The mock signals, on the base of the simulated ones."""
    clock = MockClock()
    signals = MockSignals(clock, {"held": True, "free": False}, ("out",))
    return SignalsBench(signals, clock, Rules(signals), signals, without=("deaf",))


BENCHES: dict[str, Callable[[], SignalsBench]] = {"modbus": modbus, "mock": mock}
