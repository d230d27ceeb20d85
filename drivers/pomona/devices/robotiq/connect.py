"""The driver `robotiq` of a cell file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from pomona.devices.robotiq.driver import RobotiqGripper
from pomona.devices.robotiq.options import RobotiqFile
from pomona.devices.robotiq.session import BAUD, RobotiqSession, RtuSession, UrcapSession
from pomona.drivers import (
    ConnectContext,
    DeviceError,
    DeviceLost,
    Settings,
    driver,
    serial_opener,
    serial_ports,
    tcp_opener,
)


def opener(said: RobotiqFile, context: ConnectContext) -> Callable[[], RobotiqSession]:
    """Return how to open the gripper's wire."""
    if said.urcap is not None:
        open_link = tcp_opener(*said.urcap, context.wires)
        return lambda: UrcapSession(open_link(), context.clock)
    open_port = serial_opener(said.port or "", BAUD, context.wires)
    return lambda: RtuSession(open_port(), context.clock, said.unit)


@driver(RobotiqGripper, RobotiqFile)
def connect(settings: Settings[RobotiqFile], context: ConnectContext) -> RobotiqGripper:
    """Open the gripper that a cell file describes; nothing moves, unless it is activated."""
    said = settings.values
    options = replace(said, activate=said.activate and context.cleared)
    gripper = RobotiqGripper(opener(said, context), context.clock, options)
    where: tuple[Any, ...] = (
        (said.port, None, 0, said.unit) if said.urcap is None else (None, *said.urcap)
    )
    gripper.outside_stop = "pomona.devices.robotiq.outside:stop", where
    silent = (
        "port",
        f"{serial_ports()}; is the gripper powered, with the Modbus address {said.unit} ('unit')?",
    )
    if said.urcap is not None:
        silent = (
            "urcap",
            "is the Robotiq URCap installed, and no other client connected? is the gripper powered?",
        )
    return settings.opened(
        gripper, {OSError: silent, DeviceLost: silent, DeviceError: (silent[0], "")}
    )
