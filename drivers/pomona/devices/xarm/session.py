"""A connection to a controller: one request at a time, and the newest of its reports."""

from __future__ import annotations

import contextlib

from pomona.devices.xarm.codec import (
    INVALID,
    Register,
    Report,
    decode_answers,
    decode_reports,
    encode,
)
from pomona.drivers import DeviceFault, DeviceLost, Link, Malformed, Nonsense
from pomona.executive import Clock

SLOW = 5.0  # deadline of commands that switch motors or modes [s], as in the vendor's client


class XArmSession:
    """Asks the controller, until something fails. It belongs to one thread.

    Attributes:
        version: the controller's answer to VERSION; flags: of the newest answer.
        report: the newest; reported_at: when it came, on the cell's clock [s].
    """

    def __init__(
        self, device: str, command: Link, reports: Link, clock: Clock, silence: float
    ) -> None:
        """`silence`: deadline of an answer [s]. Read version and first report. Raises DeviceLost, Nonsense, OSError."""
        self._device = device
        self._command = command
        self._reports = reports
        self._clock = clock
        self._silence = silence
        self._answered, self._pushed = bytearray(), bytearray()
        self._transaction = 0
        self.flags, self.reported_at = 0, clock.now()
        self.report: Report
        self.version = self.ask(Register.VERSION, deadline=1.0)
        end = clock.now() + 1.0  # deadline of the first report [s]: it has a hundred in this time
        while not self.listen(0.01):
            if clock.now() > end:
                raise DeviceLost(device, "sent no report within 1 s")

    def send(self, register: Register, parameters: bytes = b"") -> int:
        """Send a request and return its number. Raises OSError: the connection failed."""
        self._transaction = self._transaction % 0xFFFF + 1
        self._command.send(encode(self._transaction, register, parameters))
        return self._transaction

    def ask(
        self, register: Register, parameters: bytes = b"", deadline: float | None = None
    ) -> bytes:
        """Send a request and return the body of its answer.

        Raises:
            DeviceLost: there is none within the deadline.
            Nonsense: it is another protocol. OSError: the connection failed.
            DeviceFault: the controller does not accept the request in its present state.
        """
        number = self.send(register, parameters)
        sent_at = self._clock.now()
        deadline = self._silence if deadline is None else deadline
        while True:
            late = self._clock.now() - sent_at > deadline
            self._answered += self._command.receive(0.0 if late else 0.002)
            try:
                answers = [
                    answer
                    for answer in decode_answers(self._answered)
                    if answer.transaction == number
                ]
            except Malformed as error:
                raise Nonsense(self._device, error) from error
            if answers:
                self.flags = answers[-1].flags
                if self.flags & INVALID:
                    raise DeviceFault(
                        self._device, f"its controller refuses the request {register.name}"
                    )
                return answers[-1].body
            if late:
                raise DeviceLost(
                    self._device, f"no answer for {1e3 * (self._clock.now() - sent_at):.0f} ms"
                )

    def listen(self, patience: float) -> bool:
        """Take in reports, waiting up to `patience` [s]; whether one came. Raises OSError, Nonsense."""
        self._pushed += self._reports.receive(patience)
        try:
            reports = decode_reports(self._pushed)
        except Malformed as error:
            raise Nonsense(self._device, error) from error
        if reports:
            self.report, self.reported_at = reports[-1], self._clock.now()
        return bool(reports)

    def error(self) -> int:
        """Return the number of the controller's error, 0 for none. Raises Nonsense, and as `ask`."""
        body = self.ask(Register.ERROR)
        if not body:
            raise Nonsense(self._device, Malformed(body, "is no number of an error"))
        return body[0]

    def close(self) -> None:
        """Disconnect; an arm in servo mode stays at its newest set-point."""
        with contextlib.suppress(OSError):
            self._command.close()
        self._reports.close()
