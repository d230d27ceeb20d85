"""Stops the fingers over a fresh connection when the process that moved them is gone; called by the supervisor process.

They stay where they are: nothing opens. A gripper whose commands have ended moves on to the last one's position.
"""

from __future__ import annotations

import contextlib
import time

from pomona.devices.robotiq.codec import SLAVE, RobotiqCommand, RobotiqStatus
from pomona.devices.robotiq.session import BAUD, RobotiqSession, RtuSession, UrcapSession
from pomona.drivers import (
    Malformed,
    SerialLink,
    TcpLink,
)
from pomona.executive import SystemClock

ANSWER = 0.5  # seconds within which the gripper must answer


def stop(port: str | None, host: str | None, number: int, unit: int = SLAVE) -> None:
    """Forbid motion, with the position commanded where the fingers are; `unit` is the gripper's Modbus address.

    Raises OSError, TimeoutError: there is no answer.
    """
    clock = SystemClock()
    session: RobotiqSession
    if host is not None:
        session = UrcapSession(TcpLink(host, number, ANSWER), clock)
    else:
        session = RtuSession(SerialLink(port or "", BAUD), clock, unit)
    try:
        status = _status(session, None)
        for _ in range(3):  # an answer may be that of an earlier request, which was repeated
            _status(session, RobotiqCommand(True, False, status.position, 0, 0))
    finally:
        session.close()


def _status(session: RobotiqSession, command: RobotiqCommand | None) -> RobotiqStatus:
    end = time.monotonic() + ANSWER
    while time.monotonic() < end:
        with contextlib.suppress(Malformed):
            status = session.serve(command, 0.02)
            if status is not None:
                return status
    raise TimeoutError(f"the gripper did not answer within {ANSWER:g} s")
