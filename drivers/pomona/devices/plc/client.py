"""A Modbus TCP client: one request at a time over a link, each with a deadline."""

from __future__ import annotations

from collections.abc import Sequence

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
from pomona.drivers import DeviceFault, DeviceLost, Link, Malformed, Nonsense
from pomona.executive import Clock

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
        self._device, self._link, self._clock = device, link, clock
        self._unit, self._deadline = unit, deadline
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
        if not 1 <= span.count <= MOST[READS[span.area]]:
            raise ValueError(
                f"a request reads 1 to {MOST[READS[span.area]]} values of an area, not {span.count}"
            )
        answer = self._exchange(read_request(span))
        try:
            return read_answer(span, answer)
        except Malformed as error:
            raise Nonsense(self._device, error) from error

    def write(self, area: str, first: int, values: Sequence[int]) -> None:
        """Write `coil` or `holding` values from an address on.

        Raises ModbusRefused, Nonsense, DeviceLost, OSError, ValueError: as `read`.
        """
        if not 1 <= len(values) <= MOST[WRITES[area]]:
            raise ValueError(
                f"a request writes 1 to {MOST[WRITES[area]]} values of an area, not {len(values)}"
            )
        request = write_request(area, first, values)
        answer = self._exchange(request)
        try:
            written(request, answer)
        except Malformed as error:
            raise Nonsense(self._device, error) from error

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _exchange(self, request: bytes) -> bytes:
        self._transaction = (self._transaction + 1) % 65536
        self._link.send(frame(self._transaction, self._unit, request))
        end = self._clock.now() + self._deadline
        while (answer := self._answer()) is None:
            if self._clock.now() >= end:
                words = f"does not answer as unit {self._unit} within {1e3 * self._deadline:.0f} ms"
                raise DeviceLost(self._device, words)
            self._buffer += self._link.receive(PATIENCE)
        if answer[0] == request[0] | REFUSED and len(answer) == 2:
            raise ModbusRefused(self._device, answer[1])
        return answer

    def _answer(self) -> bytes | None:
        """Take the answer to the newest request; an answer to an earlier one is dropped."""
        while True:
            try:
                taken = take_frame(self._buffer)
            except Malformed as error:
                self._buffer.clear()
                raise Nonsense(self._device, error) from error
            if taken is None:
                return None
            transaction, unit, message = taken
            if (transaction, unit) == (self._transaction, self._unit):
                return message
