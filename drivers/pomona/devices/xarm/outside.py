"""Stops the arm over a fresh connection when the process that moved it is gone; called by the supervisor process."""

from __future__ import annotations

import time

from pomona.devices.xarm.codec import Register, decode_answers, encode
from pomona.devices.xarm.words import STOP
from pomona.drivers import TcpLink

ANSWER = 0.5  # seconds within which the controller must connect, and must have stopped


def stop(host: str, port: int) -> None:
    """Command the state of a stop at `port`; the arm brakes, and follows no set-point before it is made ready again.

    Raises OSError: there is no connection; TimeoutError: no answer, or it is in another state.
    """
    link = TcpLink(host, port, ANSWER)
    try:
        link.send(encode(1, Register.SET_STATE, bytes([STOP])))
        end = time.monotonic() + ANSWER
        buffer = bytearray()
        number = 1
        while time.monotonic() < end:
            buffer += link.receive(0.01)
            for answer in decode_answers(buffer):
                if answer.register == Register.GET_STATE and answer.body[:1] == bytes([STOP]):
                    return
                number += 1
                link.send(encode(number, Register.GET_STATE))
        raise TimeoutError(f"the controller has not stopped {ANSWER:g} s after the command")
    finally:
        link.close()
