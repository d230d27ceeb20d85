"""Stops the gripper over a fresh connection when the process that moved it is gone; called by the supervisor process.

The fingers stay where they are: nothing opens. A gripper whose TCP connection is cut goes to its fast stop by itself.
"""

from __future__ import annotations

import contextlib
import time

from pomona.devices.wsg.codec import Command, Plain, decode_reply, encode
from pomona.devices.wsg.frame import FrameDecoder
from pomona.devices.wsg.transport import CanLink
from pomona.drivers import Link, TcpLink

ANSWER = 0.5  # seconds within which the gripper must connect, and must answer


def stop(host: str, port: int) -> None:
    """Stop a gripper on TCP. Raises OSError: there is no answer, or another client holds the connection."""
    _stop(TcpLink(host, port, ANSWER))


def stop_on_can(interface: str, channel: str, bitrate: int, send_id: int, reply_id: int) -> None:
    """Stop a gripper on a CAN bus. Raises OSError: the bus cannot be opened, or there is no answer."""
    _stop(CanLink.open(interface, channel, bitrate, send_id, reply_id))


def _stop(link: Link) -> None:
    try:
        link.send(encode(Plain(Command.STOP)))
        decoder = FrameDecoder()
        end = time.monotonic() + ANSWER
        while time.monotonic() < end:
            replies = [decode_reply(frame) for frame in decoder.decode(link.receive(0.05))]
            if any(reply.command is Command.STOP for reply in replies):
                with contextlib.suppress(OSError):
                    link.send(encode(Plain(Command.DISCONNECT)))
                return
        raise TimeoutError(f"the gripper did not answer the stop within {ANSWER:g} s")
    finally:
        link.close()
