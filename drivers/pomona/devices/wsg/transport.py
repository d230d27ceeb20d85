"""Links to a WSG gripper: a CAN bus by python-can, or TCP (`pomona.executive.cell.owner.TcpLink`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import can

TCP_PORT = 1000
_CAN_HARDWARE_TYPE = "280"


class CanLink:
    """Bytes in the payload of standard CAN frames, eight at a time."""

    def __init__(self, bus: can.BusABC, send_id: int = 0x01, reply_id: int = 0x02) -> None:
        """Take over an open bus; `reply_id` is a setting of the gripper."""
        self._bus = bus
        self._send_id = send_id
        self._reply_id = reply_id

    @classmethod
    def open(
        cls, interface: str, channel: str, bitrate: int, send_id: int, reply_id: int
    ) -> CanLink:
        """Open any of python-can's interfaces: socketcan, virtual, udp_multicast, pcan, slcan …

        Raises OSError: the bus cannot be opened.
        """
        options: dict[str, Any] = (
            {} if interface in ("virtual", "udp_multicast") else {"bitrate": bitrate}
        )
        filters: list[Any] = [{"can_id": reply_id, "can_mask": 0x7FF, "extended": False}]
        try:
            bus = can.Bus(channel, interface=interface, can_filters=filters, **options)
        except can.CanError as error:
            raise OSError(f"the CAN bus {interface}:{channel} cannot be opened: {error}") from error
        return cls(bus, send_id, reply_id)

    def send(self, chunk: bytes) -> None:
        for at in range(0, len(chunk), 8):
            message = can.Message(
                arbitration_id=self._send_id, data=chunk[at : at + 8], is_extended_id=False
            )
            try:
                self._bus.send(message, timeout=0.05)
            except can.CanError as error:
                raise OSError(f"sending on the CAN bus failed: {error}") from error

    def receive(self, timeout: float) -> bytes:
        received = bytearray()
        try:
            message = self._bus.recv(max(timeout, 0.0))
            while message is not None:
                if message.arbitration_id == self._reply_id and not message.is_extended_id:
                    received += message.data
                message = self._bus.recv(0.0)
        except can.CanError as error:
            raise OSError(f"receiving from the CAN bus failed: {error}") from error
        return bytes(received)

    def close(self) -> None:
        self._bus.shutdown()


def can_channels(network: Path = Path("/sys/class/net")) -> list[str]:
    """CAN interfaces of this machine that socketcan can open, by name."""
    types = {path.parent.name: path.read_text().strip() for path in sorted(network.glob("*/type"))}
    return [name for name, hardware in types.items() if hardware == _CAN_HARDWARE_TYPE]
