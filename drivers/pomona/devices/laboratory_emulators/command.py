"""`pomona emulate universal-robots`: the controller alone, in a process of its own."""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

from pomona.devices.emulators.command_emulate import serve
from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.emulators.server import Endpoint, TcpPort
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
