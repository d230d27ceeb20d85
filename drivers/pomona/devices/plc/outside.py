"""Writes a PLC's outputs to their safe values when the process that wrote them hangs or is gone; for the supervisor."""

from __future__ import annotations

from collections.abc import Sequence

from pomona.devices.plc.client import ModbusClient
from pomona.drivers import TcpLink
from pomona.executive import SystemClock

ANSWER = 0.5
"""Time within which the PLC must answer [s]."""


def stop(host: str, port: int, unit: int, writes: Sequence[tuple[str, int, Sequence[int]]]) -> None:
    """Write the safe values: area, first address and values of each request.

    Raises OSError, DeviceError: there is no answer, or a refusal.
    """
    client = ModbusClient("plc", TcpLink(host, port, ANSWER), SystemClock(), unit, ANSWER)
    try:
        for area, first, values in writes:
            client.write(area, first, values)
    finally:
        client.close()
