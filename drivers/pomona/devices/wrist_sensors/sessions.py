"""The wires to sensors at the wrist: the serial stream of an FT 300, and the force fields of RTDE."""

from __future__ import annotations

import contextlib

import numpy as np

from pomona.devices.universal_robots.rtde import RtdeSession
from pomona.devices.wrist_sensors.codec import START_STREAM, STOP, take_frames
from pomona.drivers import Link, Malformed, Nonsense
from pomona.executive import Clock, Float64

DRAINED = 0.1  # time in which the rest of an earlier stream ends [s]
MOST = 400  # bytes without a frame after which the peer is no such sensor: 25 frames
FIELDS = ("actual_TCP_force", "actual_TCP_pose")


class Ft300Session:
    """The stream of a Robotiq FT 300 on a serial line."""

    def __init__(self, device: str, link: Link, clock: Clock) -> None:
        """End an earlier stream and start one. Raises OSError: the line failed."""
        self._device = device
        self._link = link
        self._buffer = bytearray()
        self._dropped = 0
        link.send(STOP)
        end = clock.now() + DRAINED
        while clock.now() < end:
            link.receive(0.01)
        link.send(START_STREAM)

    def receive(self, patience: float) -> list[Float64]:
        """As `WristSession.receive`, wrenches of shape (1, 6). Raises Nonsense: bytes come, and none are frames."""
        self._buffer += self._link.receive(patience)
        found, dropped = take_frames(self._buffer)
        self._dropped = 0 if found else self._dropped + dropped
        if self._dropped > MOST:
            raise Nonsense(
                self._device, Malformed(bytes(self._buffer), "has no frame of an FT 300")
            )
        return [wrench[None, :] for wrench in found]

    def close(self) -> None:
        """End the stream and close the line."""
        with contextlib.suppress(OSError):
            self._link.send(STOP)
        self._link.close()


class UrForceSession:
    """Force and torque at the tool of a Universal Robots arm, by a client of its own that writes nothing."""

    def __init__(self, device: str, link: Link, clock: Clock, rate: float) -> None:
        """Raises as `RtdeSession`; `rate` is of packages [1/s]."""
        self._rtde = RtdeSession(device, link, clock, FIELDS, (), rate)

    def receive(self, patience: float) -> list[Float64]:
        """As `WristSession.receive`, wrenches of shape (1, 6)."""
        if not self._rtde.receive(patience):
            return []
        force, pose = (self._rtde.vector(name) for name in FIELDS)
        R_tool_base = rotation(pose[3:]).T
        return [np.concatenate([R_tool_base @ force[:3], R_tool_base @ force[3:]])[None, :]]

    def close(self) -> None:
        """Disconnect."""
        self._rtde.close()


def rotation(vector: Float64) -> Float64:
    """Return the rotation (3, 3) of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Float64 = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    return turned
