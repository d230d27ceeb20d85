"""A Modbus TCP client: one request at a time over a link, each with a deadline."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from pomona.devices.plc.codec import (
    MOST,
    READS,
    REASONS,
    REFUSED,
    WRITES,
    MemorySpan,
    frame,
    read_answer,
    read_request,
    take_frame,
    write_request,
    written,
)
from pomona.drivers import DeviceFault, DeviceLost, Link, Malformed, Nonsense, TcpLink
from pomona.executive import Clock, SystemClock

T = TypeVar("T")
Write = tuple[str, int, Sequence[int]]  # area, first address, values

ANSWER = 0.5
"""Time within which the PLC must answer the supervisor [s]."""
PATIENCE = 0.005
"""The link is waited for no longer than this at a time [s]."""


class ModbusRefused(DeviceFault):
    """A request that the device refuses; `code` is the Modbus exception."""

    def __init__(self, device: str, code: int) -> None:
        self.code = code
        super().__init__(
            device, f"refuses the request: {REASONS.get(code, f'Modbus exception {code}')}"
        )


class ModbusClient:
    """Reads and writes a device's bits and registers; used by one thread.

    Areas are `coil`, `discrete`, `holding` and `input`. Addresses count from 0, as on the wire.
    """

    def __init__(
        self, device: str, link: Link, clock: Clock, unit: int = 1, deadline: float = 0.2
    ) -> None:
        """
        Args:
            device: name for messages.
            link: open.
            unit: of the device, from 0 to 255.
            deadline: of each answer [s].
        """
        self._device = device
        self._link = link
        self._clock = clock
        self._unit = unit
        self._deadline = deadline
        self._buffer = bytearray()
        self._transaction = 0

    def read(self, span: MemorySpan) -> tuple[int, ...]:
        """Return the values of a span: 0 or 1 of a bit, 0 to 65535 of a register.

        Raises:
            ModbusRefused: the device refuses; for example, it has no such address.
            DeviceLost: it does not answer within the deadline; Nonsense: not as Modbus has it.
            OSError: the wire failed.
            ValueError: the span is longer than a request may be.
        """
        _require_count(span.count, READS[span.area])
        return self._exchange(read_request(span), lambda answer: read_answer(span, answer))

    def write(self, area: str, first: int, values: Sequence[int]) -> None:
        """Write `coil` or `holding` values from an address on.

        Raises ModbusRefused, Nonsense, DeviceLost, OSError, ValueError: as `read`.
        """
        _require_count(len(values), WRITES[area])
        request = write_request(area, first, values)
        self._exchange(request, lambda answer: written(request, answer))

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _exchange(self, request: bytes, read: Callable[[bytes], T]) -> T:
        self._transaction = (self._transaction + 1) % 65536
        self._link.send(frame(self._transaction, self._unit, request))
        end = self._clock.now() + self._deadline
        try:
            while (answer := self._answer()) is None:
                if self._clock.now() >= end:
                    words = (
                        f"does not answer as unit {self._unit} within {1e3 * self._deadline:.0f} ms"
                    )
                    raise DeviceLost(self._device, words)
                self._buffer += self._link.receive(PATIENCE)
            if answer[0] == request[0] | REFUSED and len(answer) == 2:
                raise ModbusRefused(self._device, answer[1])
            return read(answer)
        except Malformed as error:
            self._buffer.clear()
            raise Nonsense(self._device, error) from error

    def _answer(self) -> bytes | None:
        """Take the answer to the newest request; an answer to an earlier one is dropped."""
        while (taken := take_frame(self._buffer)) is not None:
            transaction, unit, message = taken
            if (transaction, unit) == (self._transaction, self._unit):
                return message
        return None


def _require_count(count: int, function: int) -> None:
    """Raise ValueError unless a request may have so many values."""
    if not 1 <= count <= MOST[function]:
        raise ValueError(f"a request has 1 to {MOST[function]} values of this area, not {count}")


def stop(host: str, port: int, unit: int, writes: Sequence[Write]) -> None:
    """Write a PLC's safe values when the process that wrote its outputs hangs or is gone; for the supervisor.

    Raises OSError, DeviceError: there is no answer, or a refusal.
    """
    client = ModbusClient("plc", TcpLink(host, port, ANSWER), SystemClock(), unit, ANSWER)
    try:
        for area, first, values in writes:
            client.write(area, first, values)
    finally:
        client.close()
