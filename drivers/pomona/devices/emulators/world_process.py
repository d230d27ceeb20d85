"""A process of its own in which the simulated world runs in real time behind emulated devices.

    python -m pomona.devices.emulators.world_process --cell sim.yaml --device arm fs100 127.0.0.1:50240
        --device gripper wsg 127.0.0.1:41000 --device fingers suntouch /run/user/1000 --camera 127.0.0.1:41001

It prints `ready` on its standard output, answers every line `truth` with the world's score as JSON, and ends when its
standard input is closed.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import re
import sys
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path

from pomona.devices.emulators.emulated import EmulatedWire
from pomona.devices.emulators.server import Endpoint, PtyPort, Server, TcpPort
from pomona.devices.emulators.sim_bridge import EmulatedDevices, StatePort, serve_camera
from pomona.drivers import Cell, DriverError, load_cell, raise_priority
from pomona.tools.simulation import TIMESTEP, SimWorld


class _Control:
    """Standard input: requests of the parent, and its end."""

    address = "standard input"

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self.open = True
        os.set_blocking(sys.stdin.fileno(), False)

    def readable(self) -> list[int]:
        return [sys.stdin.fileno()] if self.open else []

    def poll(self) -> None:
        try:
            chunk = os.read(sys.stdin.fileno(), 4096)
        except BlockingIOError:
            return
        if not chunk:
            self.open = False
        for _ in range(chunk.count(b"truth\n")):
            print(json.dumps(self._cell.truth(), default=str), flush=True)

    def close(self) -> None:
        """The parent owns the pipe."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until the parent has gone."""
    options = _parse(arguments)
    overrides = dict(setting.split("=", 1) for setting in options.set)
    here, there = multiprocessing.Pipe()
    eye = multiprocessing.get_context("spawn").Process(
        target=serve_camera,
        args=(options.cell, options.seed, overrides, *_address(options.camera), there),
        daemon=True,
    )
    eye.start()
    there.close()
    try:
        cell = load_cell(options.cell, seed=options.seed, overrides=overrides)
        server, control, world = _set_up(cell, here, options)
        here.recv()  # its camera is ready
    except (DriverError, OSError, EOFError) as error:
        print(error or "the emulated camera did not start", file=sys.stderr)
        return 2
    print("ready", flush=True)
    raise_priority()
    _run(server, control, world, options.pace)
    for port in server.ports:
        port.close()
    eye.join(2.0)
    return 0


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cell", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument(
        "--device", action="append", nargs=3, required=True, metavar=("ROLE", "EMULATOR", "ADDRESS")
    )
    parser.add_argument("--camera", required=True, help="HOST:PORT")
    parser.add_argument(
        "--pace", type=float, default=1.0, help="of the world's time; 1 is real time"
    )
    return parser.parse_args(arguments)


def _set_up(
    cell: Cell, pipe: Connection, options: argparse.Namespace
) -> tuple[Server, _Control, SimWorld]:
    emulated = EmulatedDevices(
        cell, {role: (kind, address) for role, kind, address in options.device}
    )
    control = _Control(cell)
    wires = [wire for device in emulated.devices.values() for wire in device.wires]
    ports: list[Endpoint] = [*map(_port, wires), StatePort(emulated.world, pipe), control]
    return Server(ports, [], time.monotonic), control, emulated.world


def _port(wire: EmulatedWire) -> Endpoint:
    """Open a TCP port for HOST:PORT, and a pseudo terminal for a path."""
    if re.fullmatch(r"[^/]+:\d+", wire.address):
        return TcpPort(wire.emulator, *_address(wire.address), clients=wire.clients)
    link = Path(wire.address)
    link.parent.mkdir(parents=True, exist_ok=True)
    return PtyPort(wire.emulator, link)


def _run(server: Server, control: _Control, world: SimWorld, pace: float) -> None:
    """Step the world at the pace of time; between the steps, answer requests."""
    began = time.monotonic() - world.clock.now() / pace
    while control.open:
        due = began + (world.clock.now() + TIMESTEP) / pace
        server.turn(max(due - time.monotonic(), 0.0))
        behind = time.monotonic() - due
        if (
            behind > 0.2 / pace
        ):  # a world that falls behind real time by more than this lets the time go [s]
            began += behind
        if behind >= 0.0:
            world.clock.advance(TIMESTEP)


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    return host, int(port)


if __name__ == "__main__":
    sys.exit(main())
