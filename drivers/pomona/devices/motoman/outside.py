"""Stops the arm over a fresh connection when the process that moved it is gone; called by the supervisor process."""

from __future__ import annotations

import contextlib
import time

from pomona.devices.motoman.codec import (
    Communication,
    Control,
    Message,
    MessageDecoder,
    MotionControl,
    MotionReply,
    Order,
    encode,
)
from pomona.drivers import TcpLink

ANSWER = 0.5  # seconds within which the controller must connect, and must answer


def stop(host: str, port: int, order: Order, group: int) -> None:
    """Let the controller end the motion and forget its queue. The servos stay on and hold the arm.

    Raises:
        OSError: there is no answer, or another client holds the motion connection.
    """
    link = TcpLink(host, port, ANSWER)
    try:
        link.send(
            encode(Message(MotionControl(group, -1, Control.STOP), Communication.REQUEST), order)
        )
        decoder = MessageDecoder(order)
        end = time.monotonic() + ANSWER
        while time.monotonic() < end:
            if any(
                isinstance(message.body, MotionReply)
                for message in decoder.decode(link.receive(0.05))
            ):
                goodbye = MotionControl(group, -1, Control.DISCONNECT)
                with contextlib.suppress(OSError):
                    link.send(encode(Message(goodbye, Communication.REQUEST), order))
                return
        raise TimeoutError(f"the controller did not answer the stop within {ANSWER:g} s")
    finally:
        link.close()
