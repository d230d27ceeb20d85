"""A serial line, on a pair of sockets in place of the port."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import serial

from pomona.drivers import serial_link
from pomona.drivers.serial_link import SerialLink, serial_opener, serial_ports


class Port:
    """What `serial.Serial` is for the link, with the descriptor of a socket."""

    opened: tuple[Any, ...] = ()

    def __init__(self, end: socket.socket) -> None:
        self.end = end
        self.empties = 0

    def __call__(self, *about: Any, **named: Any) -> Port:
        self.opened = (about, named)
        return self

    def fileno(self) -> int:
        return self.end.fileno()

    def reset_input_buffer(self) -> None:
        self.empties += 1

    def close(self) -> None:
        self.end.close()


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Port, socket.socket]]:
    here, there = socket.socketpair()
    here.setblocking(False)
    port = Port(here)
    monkeypatch.setattr(serial, "Serial", port)
    with here, there:
        yield port, there


def test_the_port_is_opened_for_this_process_alone_and_what_lay_there_is_dropped(
    wire: tuple[Port, socket.socket],
) -> None:
    port, _ = wire
    SerialLink("/dev/ttyUSB0", 115200)
    assert port.opened == (("/dev/ttyUSB0", 115200), {"timeout": 0, "exclusive": True})
    assert port.empties == 1


def test_bytes_go_both_ways_and_silence_is_empty(wire: tuple[Port, socket.socket]) -> None:
    link = SerialLink("p", 9600)
    link.send(b"\x01\x02")
    assert wire[1].recv(10) == b"\x01\x02"
    assert link.receive(0.0) == b""
    assert link.receive(-1.0) == b""
    wire[1].send(b"answer")
    assert link.receive(1.0) == b"answer"


def test_a_device_that_does_not_read_is_an_error_and_no_half_message(
    wire: tuple[Port, socket.socket],
) -> None:
    link = SerialLink("p", 9600)
    with pytest.raises(BlockingIOError, match="takes no more bytes"):
        link.send(bytes(1 << 22))


def test_a_port_that_is_gone_is_an_error(wire: tuple[Port, socket.socket]) -> None:
    link = SerialLink("p", 9600)
    wire[1].close()
    with pytest.raises(ConnectionResetError, match="the serial port is gone"):
        link.receive(1.0)
    descriptor = wire[0].fileno()
    link.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)


def test_a_wire_of_an_emulator_stands_in_for_its_port_alone(
    wire: tuple[Port, socket.socket],
) -> None:
    made = object()
    wires: Any = {"a": lambda: made}
    assert serial_opener("a", 9600, wires)() is made
    assert isinstance(serial_opener("b", 19200, wires)(), SerialLink)
    assert wire[0].opened[0] == ("b", 19200)


def test_the_machines_ports_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [("/dev/a", "n/a"), ("/dev/b", "FT232R"), ("/dev/c", "")]
    found = [SimpleNamespace(device=device, description=text) for device, text in ports]
    monkeypatch.setattr(serial_link.list_ports, "comports", lambda: found)
    assert serial_ports() == "serial ports of this machine: /dev/a, /dev/b (FT232R), /dev/c"
    found.clear()
    assert serial_ports() == "serial ports of this machine: none"
