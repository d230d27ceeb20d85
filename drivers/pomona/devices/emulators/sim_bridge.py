"""Connects the emulated devices to the simulated world: joint set-points in, contacts and pictures out."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import cast

import numpy as np

from pomona.devices.emulators.emulated import EmulatedDevice, kind_of, world_of
from pomona.devices.emulators.server import Peer
from pomona.drivers import Camera, Cell, Frame, load_cell, raise_priority
from pomona.tools.simulation import SimCamera, SimWorld, load_mujoco

FRAME_HEADER = struct.Struct("<4sIIddddddI")
"""Of a frame on the wire: magic, width, height, fx, fy, cx, cy, the camera's time [s], age [s], sequence; colour and
depth follow."""
FRAME_MAGIC = b"RGBD"


class EmulatedDevices:
    """The controllers of a simulated cell's devices, which live as the world makes its steps.

    Attributes:
        devices: by their roles: "arm", "gripper", "fingers".
    """

    def __init__(self, cell: Cell, choices: Mapping[str, tuple[str, str]]) -> None:
        """`choices` are the kind of emulator and the address in the cell file, by role."""
        self.world = world_of(cell)
        self.devices: dict[str, EmulatedDevice] = {}
        for role, (name, address) in choices.items():
            kind = kind_of(name)
            self.devices[role] = kind.make(cell, kind.addresses(address))
        self.world.before_step.append(self._live)

    def _live(self) -> None:
        now = self.world.clock.now()
        for device in self.devices.values():
            device.advance(now)


class SightEmulator:
    """A camera that answers every question mark with a frame; one that sees nothing does not answer."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera

    def connected(self, peer: Peer) -> None:
        """Nothing to do: the camera looks when it is asked."""

    def disconnected(self, peer: Peer) -> None:
        """Nothing to do either."""

    def received(self, peer: Peer, chunk: bytes) -> None:
        for _ in range(chunk.count(b"?")):
            frame = self._camera.latest()
            if frame is not None:
                peer.send(pack_frame(frame, 0.0))

    def advance(self, now: float) -> None:
        """The camera has no time of its own."""


class StatePort:
    """Gives the camera's process the world's present state, whenever it asks through the pipe."""

    address = "camera's process"

    def __init__(self, world: SimWorld, pipe: Connection) -> None:
        self._world = world
        self._pipe = pipe

    def readable(self) -> list[int]:
        return [self._pipe.fileno()]

    def poll(self) -> None:
        if self._pipe.poll():
            self._pipe.recv()
            self._world.looked()
            self._pipe.send((self._world.clock.now(), self._world.state.qpos.copy()))

    def close(self) -> None:
        self._pipe.close()


def serve_camera(
    cell_file: Path, seed: int, overrides: dict[str, str], host: str, port: int, pipe: Connection
) -> None:
    """Render the world's state in a process of its own, for clients on a TCP port, until the pipe ends."""
    cell = load_cell(cell_file, seed=seed, overrides=overrides)
    world = cast(SimWorld, cell.devices["world"])
    camera = cast(SimCamera, cell.device(Camera))
    listener = socket.create_server((host, port))
    camera.latest()  # opening the renderer takes a second
    pipe.send("ready")
    raise_priority()
    with contextlib.suppress(EOFError, OSError), listener:
        while True:
            connection, _ = listener.accept()
            with contextlib.suppress(ConnectionError), connection:
                while connection.recv(64):
                    connection.sendall(_look(camera, world, pipe))


def _look(camera: SimCamera, world: SimWorld, pipe: Connection) -> bytes:
    pipe.send("state")
    now, qpos = pipe.recv()
    began = time.monotonic()
    world.state.qpos[:] = qpos
    load_mujoco().mj_forward(world.model, world.state)
    frame = camera._expose(now, round(1e3 * now))
    return pack_frame(frame, time.monotonic() - began)


def pack_frame(frame: Frame, age: float) -> bytes:
    """Return a frame as bytes: header, colour (h, w, 3) uint8, depth (h, w) float32 [m]."""
    K = frame.intrinsics
    size = (FRAME_MAGIC, K.width, K.height)
    header = FRAME_HEADER.pack(*size, K.fx, K.fy, K.cx, K.cy, frame.stamp, age, frame.sequence)
    depth = frame.depth if frame.depth is not None else np.zeros(frame.colour.shape[:2], np.float32)
    return header + frame.colour.tobytes() + depth.tobytes()
