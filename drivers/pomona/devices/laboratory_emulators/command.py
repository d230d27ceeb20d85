"""`pomona emulate universal-robots`, `xarm` and `modbus-plc`: the controller alone, in a process of its own."""

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
from pomona.devices.laboratory_emulators.xarm import PORTS as XARM_PORTS, XArmEmulator

STRETCHED_UP = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
"""Joints at the start, the tool downwards [rad]."""
FOLDED = np.array([0.0, -0.6, -0.7, 0.0, 1.3, 0.0, 0.0])
"""The same of an xArm; the elbow of a Lite 6 bends the other way."""
KINDS = {"xarm5": (5, 5), "xarm6": (6, 6), "xarm7": (7, 7), "lite6": (6, 9), "850": (6, 12)}
"""Axes and type in the controller's version, by model."""


def add_universal_robots(kinds: Any) -> None:
    """Register the device."""
    arm = kinds.add_parser(
        "universal-robots", help="Universal Robots controller: RTDE, dashboard and scripts"
    )
    arm.add_argument(
        "--host", default="127.0.0.1", help="its ports are fixed: 30001 to 30004 and 29999"
    )
    arm.add_argument("--model", default="UR5", help="as its dashboard names it (default: UR5)")
    arm.add_argument(
        "--local", action="store_true", help="start in local control: programs are not accepted"
    )
    arm.add_argument("--off", action="store_true", help="start without power on the arm")
    arm.set_defaults(main=lambda options: serve(_universal_robots, options))


def _universal_robots(options: argparse.Namespace) -> tuple[list[Endpoint], list[Any]]:
    controller = UrEmulator(FreeJoints(STRETCHED_UP), np.full(6, math.pi), options.model)
    controller.remote = not options.local
    controller.mode = 3 if options.off else controller.mode
    served = [(controller.rtde, 30004), (controller.dashboard, 29999)]
    served += [(controller.script, port) for port in (30001, 30002, 30003)]
    return [TcpPort(port, options.host, number, clients=4) for port, number in served], [controller]


def add_modbus_plc(kinds: Any) -> None:
    """Register the PLC."""
    plc = kinds.add_parser(
        "modbus-plc", help="PLC over Modbus TCP: its discrete inputs follow the coils"
    )
    plc.add_argument("--host", default="127.0.0.1")
    plc.add_argument("--port", type=int, default=5020, help="default: 5020; a PLC's own is 502")
    plc.add_argument(
        "--unit", type=int, default=1, help="it answers as this unit alone (default: 1)"
    )
    plc.set_defaults(main=lambda options: serve(_modbus_plc, options))


def _modbus_plc(options: argparse.Namespace) -> tuple[list[Endpoint], list[Any]]:
    plc = PlcEmulator(unit=options.unit)

    def follow(now: float) -> None:
        plc.memory["discrete"][1:] = plc.memory["coil"][1:]

    plc.program = follow
    return [TcpPort(plc, options.host, options.port, clients=4)], [plc]


def add_xarm(kinds: Any) -> None:
    """Register the device."""
    arm = kinds.add_parser("xarm", help="UFACTORY controller: registers and reports")
    arm.add_argument(
        "--host", default="127.0.0.1", help="its ports are fixed: 502 and 30001 to 30003"
    )
    arm.add_argument(
        "--model", default="xarm6", choices=list(KINDS), help="of the arm (default: xarm6)"
    )
    arm.set_defaults(main=lambda options: serve(_xarm, options))


def _xarm(options: argparse.Namespace) -> tuple[list[Endpoint], list[Any]]:
    axes, kind = KINDS[options.model]
    start = FOLDED[:axes] * (
        np.array([1.0, -1.0, -1.0, 1.0, 1.0, 1.0]) if options.model == "lite6" else 1.0
    )
    controller = XArmEmulator(FreeJoints(start), np.full(axes, math.pi), kind)
    ports = [(getattr(controller, name), number) for name, number in XARM_PORTS.items()]
    return [TcpPort(port, options.host, number, clients=4) for port, number in ports], [controller]
