"""`pomona emulate DEVICE`: a device without the device, in a process of its own, until Ctrl-C."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

from pomona.devices.emulators.free_gripper import FreeGripper
from pomona.devices.emulators.motoman import ORDERS, FreeJoints, MotomanEmulator
from pomona.devices.emulators.server import CanPort, Endpoint, PtyPort, Server, TcpPort
from pomona.devices.emulators.suntouch import STEPS, Pad, SunTouchEmulator, encode, random_wrenches
from pomona.devices.emulators.wsg import WsgEmulator
from pomona.executive import FORCE, LENGTH, TIME, Measure

GROUP = "pomona.emulate"
"""Entry point group of functions that add a device to the command."""
SIA5_VELOCITY = np.radians([200.0, 200.0, 200.0, 200.0, 200.0, 230.0, 350.0])


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "emulate", help="emulate the protocol of a gripper, of fingers or of an arm"
    )
    kinds = parser.add_subparsers(metavar="DEVICE", required=True)
    wsg = kinds.add_parser("wsg", help="WSG gripper on TCP or CAN")
    wsg.add_argument("--tcp", default="127.0.0.1:1000", help="HOST:PORT (default: 127.0.0.1:1000)")
    wsg.add_argument(
        "--can",
        metavar="INTERFACE:CHANNEL",
        help="CAN bus of python-can in place of TCP, for instance socketcan:vcan0",
    )
    wsg.add_argument(
        "--reply-id", type=int, default=2, help="CAN id of the gripper's replies (default: 2)"
    )
    wsg.add_argument(
        "--not-referenced", action="store_true", help="start without a reference: moves are refused"
    )
    wsg.add_argument(
        "--no-script",
        action="store_true",
        help="start without the finger script for streamed speeds",
    )
    wsg.add_argument(
        "--obstacle",
        type=Measure(LENGTH, "0 mm").option,
        default=0.0,
        metavar="WIDTH",
        help="part between the jaws",
    )
    wsg.set_defaults(main=lambda options: serve(_wsg, options))
    suntouch = kinds.add_parser("suntouch", help="one force/tactile finger on a pseudo terminal")
    suntouch.add_argument("--link", type=Path, help="symbolic link to make to the terminal")
    suntouch.add_argument("--seed", type=int, default=0, help="finger: 0 for left, 1 for right")
    suntouch.add_argument(
        "--press",
        type=Measure(FORCE, "0 N").option,
        default=0.0,
        metavar="FORCE",
        help="peak of a slow periodic force",
    )
    suntouch.add_argument(
        "--record", type=Path, help="write a recording for `pomona calibrate fingers`, then exit"
    )
    suntouch.add_argument(
        "--samples", type=int, default=20000, help="number of samples of the recording"
    )
    suntouch.set_defaults(
        main=lambda options: _record(options) if options.record else serve(_suntouch, options)
    )
    motoman = kinds.add_parser("motoman", help="Yaskawa controller with MotoROS on three TCP ports")
    motoman.add_argument("--host", default="127.0.0.1")
    motoman.add_argument(
        "--port", type=int, default=50240, help="motion port; state: the next one (default: 50240)"
    )
    motoman.add_argument(
        "--controller", choices=tuple(ORDERS), default="fs100", help="the byte order"
    )
    motoman.add_argument("--teach", action="store_true", help="start in teach mode")
    motoman.add_argument(
        "--e-stop", action="store_true", help="start with the emergency stop pressed"
    )
    motoman.add_argument(
        "--queue",
        type=Measure(TIME, "0 s").option,
        default=0.8,
        metavar="TIME",
        help="length of the motion queue; a full one answers BUSY",
    )
    motoman.set_defaults(main=lambda options: serve(_motoman, options))
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        point.load()(kinds)


def _wsg(options: argparse.Namespace) -> tuple[list[Endpoint], list[Any]]:
    fingers = FreeGripper(time.monotonic)
    fingers.obstacle = options.obstacle
    device = WsgEmulator(
        fingers, referenced=not options.not_referenced, has_script=not options.no_script
    )
    if options.can:
        import can

        interface, _, channel = options.can.partition(":")
        bus = can.Bus(channel, interface=interface)
        return [CanPort(device, bus, reply_id=options.reply_id)], [device]
    host, _, port = options.tcp.rpartition(":")
    return [TcpPort(device, host or "127.0.0.1", int(port))], [device]


def _suntouch(options: argparse.Namespace) -> tuple[list[Endpoint], list[Any]]:
    def wrench() -> np.ndarray[Any, np.dtype[np.float64]]:
        force = options.press * 0.5 * (1.0 - np.cos(time.monotonic()))
        return np.array([0.0, 0.0, -force, 0.0, 0.0, 0.0])

    device = SunTouchEmulator(wrench, options.seed)
    return [PtyPort(device, options.link)], [device]


def _motoman(options: argparse.Namespace) -> tuple[list[Endpoint], list[Any]]:
    joints = FreeJoints(np.zeros(7))
    controller = MotomanEmulator(joints, SIA5_VELOCITY, ORDERS[options.controller], options.queue)
    controller.teach = options.teach
    controller.e_stopped = options.e_stop
    ports: list[Endpoint] = [
        TcpPort(controller.motion, options.host, options.port),
        TcpPort(controller.state, options.host, options.port + 1, clients=4),
    ]
    return ports, [controller]


def serve(
    build: Callable[[argparse.Namespace], tuple[list[Endpoint], list[Any]]],
    options: argparse.Namespace,
) -> int:
    """Serve a device until Ctrl-C; `build` gives its ports and the function that steps it. Returns an exit status."""
    try:
        ports, devices = build(options)
    except (OSError, ValueError) as error:
        print(f"the port cannot be opened: {error}", file=sys.stderr)
        return 2
    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: done.set())
    for port in ports:
        print(port.address, flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        Server(ports, devices, time.monotonic).serve(lambda: not done.is_set())
    return 0


def _record(options: argparse.Namespace) -> int:
    """Voltages without bias and the wrenches behind them, as a reference sensor under the finger would give them."""
    pad = Pad(options.seed)
    wrenches = random_wrenches(options.samples, options.seed)
    counts = np.array([np.frombuffer(encode(pad.volts(wrench)), "<u2") for wrench in wrenches])
    volts = counts / STEPS - pad.rest
    np.savez_compressed(options.record, volts=volts, wrenches=wrenches)
    print(f"{options.samples} samples in {options.record}")
    return 0


def main(arguments: list[str] | None = None) -> int:
    """`python -m pomona.devices.emulators.command_emulate DEVICE …`: the same without the command line of `pomona`."""
    parser = argparse.ArgumentParser(description=__doc__)
    add(parser.add_subparsers(required=True))
    options = parser.parse_args(["emulate", *(sys.argv[1:] if arguments is None else arguments)])
    status: int = options.main(options)
    return status


if __name__ == "__main__":
    sys.exit(main())
