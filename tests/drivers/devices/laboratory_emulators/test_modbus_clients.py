"""pymodbus, a Modbus client of other authors, accepts the emulated PLC; refusals are those of the protocol."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from pomona.devices.emulators.server import Server, TcpPort
from pomona.devices.laboratory_emulators.modbus_plc import PlcEmulator


@pytest.fixture
def plc() -> PlcEmulator:
    return PlcEmulator(owned=[("holding", 9)])


@pytest.fixture
def client(plc: PlcEmulator) -> Iterator[Any]:
    modbus: Any = pytest.importorskip(
        "pymodbus.client", reason="pymodbus, of the extra dev, is not installed"
    )
    port, done = TcpPort(plc, clients=2), threading.Event()
    server = Server([port], [plc], time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    host, number = port.address.split(":")
    opened = modbus.ModbusTcpClient(host, port=int(number), timeout=10.0)
    assert opened.connect()
    yield opened
    opened.close()
    done.set()
    thread.join(5.0)


def test_pymodbus_reads_and_writes_all_areas(plc: PlcEmulator, client: Any) -> None:
    plc.memory["discrete"][3:6] = [1, 0, 1]
    plc.memory["input"][7:9] = [555, 65535]
    assert client.read_discrete_inputs(3, count=3, device_id=1).bits[:3] == [True, False, True]
    assert client.read_input_registers(7, count=2, device_id=1).registers == [555, 65535]
    assert not client.write_coil(4, True, device_id=1).isError()
    assert not client.write_coils(5, [True, False, True], device_id=1).isError()
    assert client.read_coils(4, count=4, device_id=1).bits[:4] == [True, True, False, True]
    assert not client.write_register(1, 12, device_id=1).isError()
    assert not client.write_registers(2, [13, 14], device_id=1).isError()
    assert client.read_holding_registers(1, count=3, device_id=1).registers == [12, 13, 14]


@pytest.mark.parametrize(
    ("ask", "code"),
    [
        (lambda c: c.read_coils(60, count=8, device_id=1), 2),
        (lambda c: c.write_register(9, 1, device_id=1), 2),
        (lambda c: c.read_coils(0, count=1, device_id=7), 11),
        (
            lambda c: c.readwrite_registers(
                read_address=0, read_count=1, write_address=0, values=[1], device_id=1
            ),
            1,
        ),
    ],
)
def test_pymodbus_is_refused_with_the_protocols_exceptions(
    client: Any, ask: Any, code: int
) -> None:
    answer = ask(client)
    assert answer.isError()
    assert answer.exception_code == code
