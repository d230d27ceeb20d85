"""Both connections to a controller: the pushed state, and commands that are answered in time."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from pomona.devices.motoman.codec import (
    Communication,
    Control,
    JointFeedback,
    Message,
    MessageDecoder,
    MotionControl,
    MotionReply,
    Order,
    Result,
    RobotStatus,
    TrajectoryPoint,
    encode,
)
from pomona.devices.motoman.words import refusal
from pomona.drivers import DeviceFault, DeviceLost, Link, Malformed, Nonsense
from pomona.executive import Clock

ANSWER = 0.25  # a command or a point that is not answered within this time means that the controller is lost [s]


class ControllerSession:
    """Talks to the controller until something fails.

    Attributes:
        feedback, status: the newest of each, or None before the first.
        feedback_at, status_at: when the newest of each came, on the cell's clock [s].
    """

    def __init__(
        self, device: str, state: Link, motion: Link, clock: Clock, order: Order, group: int
    ) -> None:
        self.device = device
        self.feedback: JointFeedback | None = None
        self.status: RobotStatus | None = None
        self.feedback_at = self.status_at = clock.now()
        self._state = state
        self._motion = motion
        self._clock = clock
        self._order: Order = order
        self._group = group
        self._state_decoder, self._motion_decoder = MessageDecoder(order), MessageDecoder(order)
        self._asked_at: float | None = None

    def listen(self, patience: float) -> bool:
        """Take in the state that was pushed, waiting up to `patience` [s]; whether feedback came.

        Raises OSError: the connection failed; Nonsense: bytes that are no message.
        """
        return self._on_bytes(self._state.receive(patience))

    def forget_status(self) -> None:
        """Read all pushed messages and drop the status in them: the next push has the present one.

        Raises OSError: the connection failed; Nonsense: bytes that are no message.
        """
        while chunk := self._state.receive(0.0):
            self._on_bytes(chunk)
        self.status = None

    def _on_bytes(self, chunk: bytes) -> bool:
        fresh = False
        for message in self._decode(self._state_decoder, chunk):
            if isinstance(message.body, JointFeedback) and message.body.group == self._group:
                self.feedback, self.feedback_at, fresh = message.body, self._clock.now(), True
            elif isinstance(message.body, RobotStatus):
                self.status, self.status_at = message.body, self._clock.now()
        return fresh

    @property
    def awaiting(self) -> bool:
        """Whether a command or a point is not answered yet."""
        return self._asked_at is not None

    def send(self, body: MotionControl | TrajectoryPoint) -> None:
        """Send a command or a point; fetch the answer with `reply`."""
        self._asked_at = self._clock.now()
        self._motion.send(encode(Message(body, Communication.REQUEST), self._order))

    def reply(self, patience: float = 0.0, deadline: float = ANSWER) -> MotionReply | None:
        """Return the answer, or None while there is none.

        Raises:
            OSError, Nonsense: as `listen`.
            DeviceLost: it did not come in time.
        """
        for message in self._decode(self._motion_decoder, self._motion.receive(patience)):
            if isinstance(message.body, MotionReply) and self._asked_at is not None:
                self._asked_at = None
                return message.body
        if self._asked_at is not None and self._clock.now() - self._asked_at > deadline:
            raise DeviceLost(
                self.device, f"the controller did not answer within {1e3 * deadline:.0f} ms"
            )
        return None

    def ask(
        self,
        command: Control,
        deadline: float = ANSWER,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> MotionReply:
        """Send a command and wait for its answer. Raises OSError, Nonsense, DeviceLost: as `reply`."""
        self.send(MotionControl(self._group, -1, command))
        while True:
            reply = self.reply(0.002, deadline)
            if reply is not None:
                return reply
            self.listen(0.0)
            meanwhile()

    def demand(self, command: Control, deadline: float = ANSWER) -> None:
        """As `ask`, for a command that must succeed.

        Raises DeviceFault: the controller refused, in words; and as `ask`.
        """
        reply = self.ask(command, deadline)
        if reply.result != Result.SUCCESS:
            raise DeviceFault(self.device, refusal(reply))

    def close(self) -> None:
        """Disconnect; the controller closes without an answer."""
        goodbye = MotionControl(self._group, -1, Control.DISCONNECT)
        with contextlib.suppress(OSError):
            self._motion.send(encode(Message(goodbye, Communication.REQUEST), self._order))
        self._motion.close()
        self._state.close()

    def _decode(self, decoder: MessageDecoder, chunk: bytes) -> list[Message]:
        messages = decoder.decode(chunk)
        try:
            decoder.complain()
        except Malformed as error:
            raise Nonsense(self.device, error) from error
        return messages
