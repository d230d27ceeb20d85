"""One connection to a WSG gripper: requests with deadlines, replies in order, silence noticed."""

from __future__ import annotations

from collections.abc import Callable

from pomona.devices.wsg.codec import Command, Reply, Request, Status, decode_reply, encode
from pomona.devices.wsg.frame import FrameDecoder
from pomona.drivers import DeviceFault, DeviceLost, Link, Malformed, Nonsense
from pomona.executive import Clock

ANSWER = 0.1  # a request that is not answered within this time means that the gripper is lost [s]
QUIET = 0.02  # time without a byte after which an unfinished frame is dropped [s]


class GripperSession:
    """Talks to the gripper over one link until something fails. It belongs to one thread."""

    def __init__(self, device: str, link: Link, clock: Clock) -> None:
        self.device = device
        self.last_heard = clock.now()
        self._link = link
        self._clock = clock
        self._decoder = FrameDecoder()
        self._awaited: dict[Command, float] = {}

    @property
    def discarded(self) -> int:
        """Bytes that belonged to no frame."""
        return self._decoder.discarded

    def send(self, request: Request) -> None:
        """Send a request; its first reply is due within `ANSWER`. Raises OSError: the wire failed."""
        self._awaited.setdefault(request.command, self._clock.now() + ANSWER)
        self._link.send(encode(request))

    def receive(self, timeout: float) -> list[Reply]:
        """Return the replies that have come, waiting up to `timeout` [s] for the first byte.

        Raises:
            OSError: the wire failed.
            Nonsense: a frame that this protocol does not know.
            DeviceLost: a request was not answered in time.
        """
        chunk = self._link.receive(timeout)
        now = self._clock.now()
        if chunk:
            frames = self._decoder.decode(chunk)
        else:
            frames = self._decoder.flush() if now - self.last_heard > QUIET else []
        try:
            replies = [decode_reply(frame) for frame in frames]
        except Malformed as error:
            raise Nonsense(self.device, error) from error
        if replies:
            self.last_heard = now
        for reply in replies:
            self._awaited.pop(reply.command, None)
        for command, due in self._awaited.items():
            # An answer may lie behind the bytes just read, if this thread itself was delayed; but not for long.
            if now > (due + ANSWER if chunk else due):
                self._complain(f"{command.name} was not answered within {1e3 * ANSWER:.0f} ms")
        return replies

    def awaits(self, command: Command) -> bool:
        """Return True if a request with this command is not answered yet."""
        return command in self._awaited

    def ask(
        self,
        request: Request,
        others: Callable[[Reply], None],
        deadline: float = ANSWER,
    ) -> Reply:
        """Send a request and wait for its final reply; `others` gets everything else that comes meanwhile.

        Raises OSError, Nonsense, DeviceLost: as `receive`; DeviceLost too when the final reply is late.
        """
        self.send(request)
        end = self._clock.now() + deadline
        while True:
            final: Reply | None = None
            for reply in self.receive(0.005):
                if (
                    reply.command is request.command
                    and reply.status is not Status.CMD_PENDING
                    and final is None
                ):
                    final = reply
                else:
                    others(reply)
            if final is not None:
                return final
            if self._clock.now() > end:
                self._complain(f"{request.command.name} did not end within {deadline:g} s")

    def demand(
        self,
        request: Request,
        others: Callable[[Reply], None],
        deadline: float = ANSWER,
    ) -> Reply:
        """As `ask`, for a request that must succeed. Raises DeviceFault: the gripper refused it; and as `ask`."""
        reply = self.ask(request, others, deadline)
        if reply.status is not Status.SUCCESS:
            raise DeviceFault(self.device, f"refused {request.command.name}: {reply.status.name}")
        return reply

    def close(self) -> None:
        self._link.close()

    def _complain(self, message: str) -> None:
        if self.discarded:
            message += f"; {self.discarded} bytes came that are no frame (wrong bus, bit rate or CAN id of replies?)"
        raise DeviceLost(self.device, message)
