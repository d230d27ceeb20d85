"""A PLC that speaks Modbus TCP byte by byte: four areas of memory, a program, and a heartbeat both ways."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from pomona.devices.emulators.emulated import EmulatedDevice, EmulatedWire, EmulatorKind
from pomona.devices.emulators.server import Peer
from pomona.devices.plc.codec import (
    BITS,
    MOST,
    READS,
    REFUSED,
    frame,
    packed_bits,
    take_frame,
    unpacked_bits,
)
from pomona.devices.plc.signals import Signals
from pomona.drivers import Cell, DriverError, FaultSwitch, Malformed

BEAT = 0.1
"""Period of the PLC's own heartbeat [s]."""
MISSED = 0.5
"""Time without a change of the other heartbeat after which the program counts the run as lost [s]."""
BY_FUNCTION = {function: area for area, function in READS.items()} | {
    5: "coil",
    6: "holding",
    15: "coil",
    16: "holding",
}
FUNCTION = 1
ADDRESS = 2
VALUE = 3
COUNT = 3
"""Modbus exceptions: no such function, address, value or number of values."""
WRONG_UNIT = 11


class PlcEmulator(FaultSwitch):
    """The PLC. Coil 0 is the heartbeat that it watches, discrete input 0 its own; `program` is called in each scan.

    Faults: `silent` (no answer), `stopped` (its program stands still, Modbus goes on), `garbage` (answers are no Modbus
    frames), `busy` (each request is refused), `overwriting` (the owned addresses take no new value, without a word);
    `other_unit`, `owned` (before a connection: it answers as unit 7, a field bus owns coil 1).

    Attributes:
        memory: bits and registers by area; an address outside it does not exist.
        owned: areas and addresses that a field bus owns: to write one is refused.
        alive: whether the other side's heartbeat changes.
    """

    known_faults = ("silent", "stopped", "garbage", "busy", "overwriting", "other_unit", "owned")

    def __init__(
        self, size: int = 64, unit: int | None = 1, owned: Iterable[tuple[str, int]] = ()
    ) -> None:
        """`unit` is the only one that it answers as; with None it answers as any."""
        super().__init__()
        self.memory: dict[str, list[int]] = {area: [0] * size for area in READS}
        self.owned = frozenset(owned)
        self.unit = unit
        self.alive = False
        self.program: Callable[[float], None] = lambda now: None
        self.now = 0.0
        self._buffers: dict[int, bytearray] = {}
        self._beat_at = 0.0
        self._heard = 0
        self._heard_at = -MISSED

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        if kind == "other_unit":
            self.unit = 7
        elif kind == "owned":
            self.owned |= {("coil", 1)}

    def connected(self, peer: Peer) -> None:
        """A client has connected."""
        self._buffers[id(peer)] = bytearray()

    def disconnected(self, peer: Peer) -> None:
        """A client has gone."""
        self._buffers.pop(id(peer), None)

    def received(self, peer: Peer, chunk: bytes) -> None:
        """Answer the requests that are whole; a client that speaks no Modbus is hung up on."""
        buffer = self._buffers[id(peer)]
        buffer += chunk
        try:
            while (taken := take_frame(buffer)) is not None:
                transaction, unit, request = taken
                answer = frame(transaction, unit, self._answer(unit, request))
                if self.fault != "silent":
                    peer.send(b"\x5a" * len(answer) if self.fault == "garbage" else answer)
        except Malformed:
            buffer.clear()
            peer.close()

    def advance(self, now: float) -> None:
        """Run the program's scan."""
        self.now = now
        if self.fault == "stopped":
            return
        if now - self._beat_at >= BEAT:
            self._beat_at = now
            self.memory["discrete"][0] ^= 1
        if self.memory["coil"][0] != self._heard:
            self._heard = self.memory["coil"][0]
            self._heard_at = now
        self.alive = now - self._heard_at <= MISSED
        self.program(now)

    def _answer(self, unit: int, request: bytes) -> bytes:
        if self.unit is not None and unit != self.unit:
            return bytes([request[0] | REFUSED, WRONG_UNIT])
        if self.fault == "busy":
            return bytes([request[0] | REFUSED, 6])
        try:
            return self._carry_out(request)
        except _ModbusException as refused:
            return bytes([request[0] | REFUSED, refused.code])

    def _carry_out(self, request: bytes) -> bytes:
        function = request[0]
        area = BY_FUNCTION.get(function)
        if area is None:
            raise _ModbusException(FUNCTION)
        if len(request) < 5:
            raise _ModbusException(VALUE)
        first, count = struct.unpack_from(">HH", request, 1)
        if function in (5, 6):
            if function == 5 and count not in (0, 0xFF00):
                raise _ModbusException(VALUE)
            self._write(area, first, [int(count == 0xFF00) if function == 5 else count])
            return request[:5]
        if not 1 <= count <= MOST[function]:
            raise _ModbusException(COUNT)
        size = (count + 7) // 8 if area in BITS else 2 * count
        if function in (15, 16):
            data = request[6:]
            if len(data) != size or request[5] != size:
                raise _ModbusException(COUNT)
            self._write(
                area,
                first,
                unpacked_bits(data, count) if area in BITS else struct.unpack(f">{count}H", data),
            )
            return request[:5]
        values = self._cells(area, first, count)
        data = packed_bits(values) if area in BITS else struct.pack(f">{count}H", *values)
        return bytes([function, size]) + data

    def _cells(self, area: str, first: int, count: int) -> list[int]:
        if first + count > len(self.memory[area]):
            raise _ModbusException(ADDRESS)
        return self.memory[area][first : first + count]

    def _write(self, area: str, first: int, values: Iterable[int]) -> None:
        new = dict(enumerate(values, first))
        self._cells(area, first, len(new))
        taken = {at for at in new if (area, at) in self.owned}
        if taken and self.fault != "overwriting":
            raise _ModbusException(ADDRESS)
        for at in new.keys() - taken:
            self.memory[area][at] = new[at]


class _ModbusException(DriverError):
    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"Modbus exception {code}")


def mirror(
    plc: PlcEmulator,
    inputs: Mapping[str, Callable[[], bool]],
    outputs: Mapping[str, Callable[[bool], None]],
) -> None:
    """Let the program hand on signals: inputs become discrete inputs 1, 2, …, coils 1, 2, … become outputs."""

    def scan(now: float) -> None:
        for at, give in enumerate(outputs.values(), 1):
            give(bool(plc.memory["coil"][at]))
        for at, take in enumerate(inputs.values(), 1):
            plc.memory["discrete"][at] = int(take())

    plc.program = scan


def _make(cell: Cell, addresses: tuple[str, ...]) -> EmulatedDevice:
    """Put the bytes before the simulated PLC of a cell; its signals are switches."""
    signals = cell.device(Signals)
    plc = PlcEmulator()
    mirror(
        plc,
        {name: partial(_is_on, signals, name) for name in signals.names.inputs},
        {name: partial(signals.write, name) for name in signals.names.outputs},
    )
    return EmulatedDevice(
        (EmulatedWire("wire", addresses[0], plc, clients=4),), plc.advance, {"": plc}
    )


def _is_on(signals: Signals, name: str) -> bool:
    """Return the state of a simulated signal."""
    return bool(signals.read(name).value)


MODBUS_PLC = EmulatorKind(lambda address: (address,), _make)
