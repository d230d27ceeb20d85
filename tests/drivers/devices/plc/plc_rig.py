"""A PLC's driver and the emulated PLC on a clock that the test moves, byte for byte."""

from __future__ import annotations

import contextlib
from typing import Any

from pomona.devices.laboratory_emulators.modbus_plc import PlcEmulator
from pomona.devices.plc.client import ModbusClient
from pomona.devices.plc.driver import ModbusSignals
from pomona.devices.plc.places import SignalHeartbeat, SignalPlace
from pomona.executive import ManualClock

INPUTS = {
    "start": SignalPlace("discrete 1"),
    "full": SignalPlace("discrete 2"),
    "mass": SignalPlace("input 4", "float32"),
}
OUTPUTS = {
    "ready": SignalPlace("coil 1"),
    "done": SignalPlace("coil 2"),
    "count": SignalPlace("holding 5", safe=7.0),
}
BEATS = SignalHeartbeat(output="coil 0", input="discrete 0")


class PlcClock(ManualClock):
    """Time in which the PLC runs its scans."""

    def __init__(self, plc: PlcEmulator) -> None:
        super().__init__(10.0)
        self.plc = plc

    def advance(self, duration: float) -> None:
        end = self.now() + duration
        while self.now() < end - 1e-9:
            super().advance(min(1e-3, end - self.now()))
            self.plc.advance(self.now())


class PlcWire:
    """The driver's end of a wire, and the peer that the PLC sees."""

    def __init__(self, rig: PlcRig) -> None:
        self.rig, self.arrived, self.broken = rig, b"", False
        rig.plc.connected(self.peer)

    @property
    def peer(self) -> Any:
        """As the PLC sees it."""
        return self.rig.peers.setdefault(id(self), PlcPeer(self))

    def send(self, chunk: bytes) -> None:
        if self.broken:
            raise ConnectionResetError("the cable is out")
        self.rig.sent.append(chunk)
        self.rig.plc.received(self.peer, chunk)

    def receive(self, timeout: float) -> bytes:
        if self.broken:
            raise ConnectionResetError("the cable is out")
        if not self.arrived:
            self.rig.clock.advance(timeout)
        chunk, self.arrived = self.arrived, b""
        return chunk

    def close(self) -> None:
        self.broken = True


class PlcPeer:
    """The other end."""

    def __init__(self, wire: PlcWire) -> None:
        self.wire = wire

    def send(self, chunk: bytes) -> None:
        self.wire.arrived += chunk

    def close(self) -> None:
        self.wire.broken = True


class PlcRig:
    """An emulated PLC, its clock, and a driver without a thread."""

    def __init__(self, **plc: Any) -> None:
        self.plc = PlcEmulator(**plc)
        self.clock = PlcClock(self.plc)
        self.plc.advance(self.clock.now())
        self.cut = False
        self.sent: list[bytes] = []
        self.peers: dict[int, PlcPeer] = {}
        self.wires: list[PlcWire] = []

    def open(self) -> PlcWire:
        if self.cut:
            raise ConnectionRefusedError("no answer")
        self.wires.append(PlcWire(self))
        return self.wires[-1]

    def client(self, unit: int = 1) -> ModbusClient:
        return ModbusClient("plc", self.open(), self.clock, unit)

    def signals(self, unit: int = 1, **places: Any) -> ModbusSignals:
        inputs, outputs = places.get("inputs", INPUTS), places.get("outputs", OUTPUTS)
        return ModbusSignals(
            lambda: self.client(unit), self.clock, inputs, outputs, places.get("beats", BEATS)
        )

    def connected(self) -> ModbusSignals:
        signals = self.signals()
        signals.connect()
        signals.check()
        return signals

    def serve(self, signals: ModbusSignals, seconds: float, ticks: bool = True) -> None:
        """Let the driver's thread and the run's tick go on; the tick's errors are not raised."""
        end = self.clock.now() + seconds
        while self.clock.now() < end - 1e-9:
            before = self.clock.now()
            try:
                signals.step()
            except Exception as error:
                signals._lose(error)
            if ticks:
                with contextlib.suppress(Exception):
                    signals.check()
            if self.clock.now() == before:
                self.clock.advance(1e-3)

    def pull_cable(self) -> None:
        self.cut = True
        for wire in self.wires:
            wire.broken = True
