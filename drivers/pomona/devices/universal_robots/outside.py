"""Stops the arm over a fresh connection when the process that moved it is gone; called by the supervisor process."""

from __future__ import annotations

import time

from pomona.devices.universal_robots.dashboard import UrDashboard
from pomona.drivers import TcpLink
from pomona.executive import SystemClock

ANSWER = 0.5  # seconds within which the controller must connect, and the program must have ended


def stop(host: str, port: int) -> None:
    """Let the dashboard server at `port` end the program; the arm brakes, and holds.

    The controller does so by itself when the heart beat has ended.

    Raises DeviceLost: there is no answer; TimeoutError: a program goes on.
    """
    dashboard = UrDashboard("arm", lambda: TcpLink(host, port, ANSWER), SystemClock())
    dashboard.ask("stop")
    end = time.monotonic() + ANSWER
    while "true" in dashboard.ask("running").lower():
        if time.monotonic() > end:
            raise TimeoutError(f"a program still runs {ANSWER:g} s after the stop")
