"""`pomona emulate universal-robots` and `modbus-plc`: the controller alone, in a process of its own."""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

from pomona.devices.emulators.command_emulate import serve
from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.emulators.server import Endpoint, TcpPort
from pomona.devices.laboratory_emulators.modbus_plc import PlcEmulator
from pomona.devices.laboratory_emulators.universal_robots import UrEmulator
from pomona.devices.universal_robots.connect import PORTS

STRETCHED_UP = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
"""Joints at the start, the tool downwards [rad]."""


def add_universal_robots(kinds: Any) -> None:
    """Register the device."""
    arm = kinds.add_parser("universal-robots", help="Universal Robots controller: RTDE, dashboard and scripts")
    arm.add_argument("--host", default="127.0.0.1", help="its ports are fixed: 30001 to 30004 and 29999")
    arm.add_argument("--model", default="UR5", help="as its dashboard names it (default: UR5)")
    arm.add_argument("--local", action="store_true", help="start in local control: programs are not accepted")
    arm.add_argument("--off", action="store_true", help="start without power on the arm")
    arm.set_defaults(main=lambda options: serve(_universal_robots, options))


def _universal_robots(options: argparse.Namespace) -> tuple[list[Endpoint], list[Any]]:
    controller = UrEmulator(FreeJoints(STRETCHED_UP), np.full(6, math.pi), options.model)
    controller.remote, controller.mode = not options.local, 3 if options.off else controller.mode
    served = [(controller.rtde, PORTS["rtde"]), (controller.dashboard, PORTS["dashboard"])]
    served += [(controller.script, port) for port in (30001, 30002, 30003)]
    return [TcpPort(port, options.host, number, clients=4) for port, number in served], [controller]


def add_modbus_plc(kinds: Any) -> None:
    """Register the PLC."""
    plc = kinds.add_parser("modbus-plc", help="PLC over Modbus TCP: its discrete inputs follow the coils")
    plc.add_argument("--host", default="127.0.0.1")
    plc.add_argument("--port", type=int, default=5020, help="default: 5020; a PLC's own is 502")
    plc.add_argument("--unit", type=int, default=1, help="it answers as this unit alone (default: 1)")
    plc.set_defaults(main=lambda options: serve(_modbus_plc, options))


def _modbus_plc(options: argparse.Namespace) -> tuple[list[Endpoint], list[Any]]:
    plc = PlcEmulator(unit=options.unit)

    def follow(now: float) -> None:
        plc.memory["discrete"][1:] = plc.memory["coil"][1:]

    plc.program = follow
    return [TcpPort(plc, options.host, options.port, clients=4)], [plc]
