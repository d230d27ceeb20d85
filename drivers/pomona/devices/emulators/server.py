"""Serves emulated devices on TCP ports, pseudo terminals and CAN buses: one thread, real time.

An emulator is a pure state machine: bytes go in by `received`, time by `advance`, bytes come out by `Peer.send`.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import tty
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import can


class Peer(Protocol):
    """The other end of the wire."""

    def send(self, chunk: bytes) -> None:
        """Send bytes to every connected peer."""

    def close(self) -> None:
        """Hang up, where the wire knows that."""


class Emulator(Protocol):
    """A device that answers bytes with bytes."""

    def connected(self, peer: Peer) -> None:
        """A peer has connected."""

    def received(self, peer: Peer, chunk: bytes) -> None:
        """Bytes came from a peer."""

    def disconnected(self, peer: Peer) -> None:
        """A peer has gone."""

    def advance(self, now: float) -> None:
        """Let the device's time go on to `now` [s]."""


class Endpoint(Protocol):
    """A place where an emulated device can be reached."""

    @property
    def address(self) -> str:
        """Where a driver finds it, as cell files write it."""

    def readable(self) -> Sequence[int]:
        """File descriptors to wait for; none for a port that must be polled."""

    def poll(self) -> None:
        """Pass on the bytes that have arrived."""

    def close(self) -> None: ...


class _TcpPeer:
    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, chunk: bytes) -> None:
        with contextlib.suppress(OSError):  # a peer that is gone is noticed when it is read
            self.connection.send(chunk)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)


class TcpPort:
    """A listening TCP port; `clients` at most are served at a time, more are turned away."""

    def __init__(
        self, emulator: Emulator, host: str = "127.0.0.1", port: int = 0, clients: int = 1
    ) -> None:
        self._emulator = emulator
        self._clients = clients
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server((host, port), family=family)
        self._listener.setblocking(False)
        self._peers: list[_TcpPeer] = []

    @property
    def address(self) -> str:
        host, port = self._listener.getsockname()[:2]
        return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"

    def readable(self) -> list[int]:
        return [self._listener.fileno(), *(peer.connection.fileno() for peer in self._peers)]

    def poll(self) -> None:
        with contextlib.suppress(BlockingIOError):
            connection, _ = self._listener.accept()
            if len(self._peers) >= self._clients:
                connection.close()
            else:
                peer = _TcpPeer(connection)
                self._peers.append(peer)
                self._emulator.connected(peer)
        for peer in tuple(self._peers):
            try:
                chunk = peer.connection.recv(65536)
            except BlockingIOError:
                continue
            except OSError:
                chunk = b""
            if chunk:
                self._emulator.received(peer, chunk)
            else:
                self.drop(peer)

    def drop(self, peer: _TcpPeer) -> None:
        """Close one connection."""
        self._peers.remove(peer)
        peer.connection.close()
        self._emulator.disconnected(peer)

    def pull_cable(self) -> None:
        """Close all connections, as after pulling the cable; for tests."""
        for peer in tuple(self._peers):
            self.drop(peer)

    def close(self) -> None:
        self.pull_cable()
        self._listener.close()


class PtyPort:
    """A pseudo terminal; `link` is a path that points to it while it is open."""

    def __init__(self, emulator: Emulator, link: Path | None = None) -> None:
        self._emulator = emulator
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._link = link
        if link is not None:
            link.unlink(missing_ok=True)
            link.symlink_to(os.ttyname(self._slave))
        emulator.connected(self)

    @property
    def address(self) -> str:
        return str(self._link or os.ttyname(self._slave))

    def send(self, chunk: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, chunk)

    def readable(self) -> list[int]:
        return [self._master]

    def poll(self) -> None:
        with contextlib.suppress(BlockingIOError):
            chunk = os.read(self._master, 4096)
            if chunk:
                self._emulator.received(self, chunk)

    def close(self) -> None:
        self._emulator.disconnected(self)
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        os.close(self._master)
        os.close(self._slave)


class CanPort:
    """A CAN bus: the device listens to one id and answers with another, eight bytes a frame."""

    def __init__(
        self, emulator: Emulator, bus: can.BusABC, request_id: int = 0x01, reply_id: int = 0x02
    ) -> None:
        self._emulator = emulator
        self._bus = bus
        self._request_id = request_id
        self._reply_id = reply_id
        emulator.connected(self)

    @property
    def address(self) -> str:
        return str(self._bus.channel_info)

    def send(self, chunk: bytes) -> None:
        for at in range(0, len(chunk), 8):
            data = chunk[at : at + 8]
            with contextlib.suppress(can.CanError):
                self._bus.send(
                    can.Message(arbitration_id=self._reply_id, data=data, is_extended_id=False)
                )

    def readable(self) -> list[int]:
        return []

    def poll(self) -> None:
        while (message := self._bus.recv(0.0)) is not None:
            if message.arbitration_id == self._request_id and not message.is_extended_id:
                self._emulator.received(self, bytes(message.data))

    def close(self) -> None:
        self._emulator.disconnected(self)
        self._bus.shutdown()


class Server:
    """Serves ports and steps the emulators, until `running` returns False."""

    def __init__(
        self, ports: Sequence[Endpoint], emulators: Sequence[Emulator], now: Callable[[], float]
    ) -> None:
        self.ports, self.emulators = tuple(ports), tuple(emulators)
        self._now = now

    def serve(self, running: Callable[[], bool], period: float = 1e-3) -> None:
        """Serve until `running` returns False, looking at least every `period` [s]; close the ports then."""
        try:
            while running():
                self.turn(period)
        finally:
            for port in self.ports:
                port.close()

    def turn(self, patience: float) -> None:
        """Wait up to `patience` [s] for bytes, pass them on, and let time go on."""
        waiting = [descriptor for port in self.ports for descriptor in port.readable()]
        polled = any(not port.readable() for port in self.ports)
        select.select(waiting, [], [], min(patience, 5e-4) if polled else patience)
        for port in self.ports:
            port.poll()
        now = self._now()
        for emulator in self.emulators:
            emulator.advance(now)
