"""Real time of the device drivers on emulated devices: `python -m benchmarks.bench_devices [SECONDS]`.

Every emulator runs in a process of its own, as `pomona emulate` starts it; the computer's own sleep is measured beside,
because on a loaded computer everything here is as late as that.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from pomona.devices.emulators.free_gripper import FreeGripper
from pomona.devices.emulators.server import CanPort, Server
from pomona.devices.emulators.wsg import WsgEmulator
from pomona.devices.motoman.driver import MotomanArm
from pomona.devices.motoman.options import MotomanFile
from pomona.devices.suntouch.calibration import FingerCalibration
from pomona.devices.suntouch.driver import SunTouchFingers
from pomona.devices.suntouch.finger import Finger
from pomona.devices.wsg.codec import Command, Observe
from pomona.devices.wsg.session import GripperSession
from pomona.devices.wsg.transport import CanLink
from pomona.drivers.interfaces import ArmLimits, Trajectory, WrenchSample
from pomona.drivers.serial_link import SerialLink
from pomona.executive.cell.owner import Link, TcpLink, raise_priority
from pomona.executive.clock import SystemClock

CALIBRATIONS = Path(__file__).resolve().parents[1] / "trees" / "cells" / "emulated_fingers"
CLOCK = SystemClock()


@contextlib.contextmanager
def emulated(*arguments: str) -> Iterator[list[str]]:
    """An emulator's process; the addresses that it serves."""
    command = [sys.executable, "-m", "pomona.devices.emulators.command_emulate", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    ports = {"wsg": 1, "suntouch": 1, "motoman": 3}[arguments[0]]
    assert process.stdout is not None
    addresses = [process.stdout.readline().strip() for _ in range(ports)]
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process.pid, -10)
    try:
        yield addresses
    finally:
        process.terminate()
        process.wait()


def percentile(values: list[float], share: float) -> float:
    return float(np.percentile(np.array(values), share)) * 1e3


def sleep_lateness(seconds: float) -> None:
    late = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        due = time.monotonic() + 0.002
        time.sleep(0.002)
        late.append(time.monotonic() - due)
    load = os.getloadavg()[0] / (os.cpu_count() or 1)
    print(
        f"computer   load {load:.1f} per core; a sleep of 2 ms ends {percentile(late, 99):.2f} ms late (p99)"
    )


def fingers(seconds: float) -> None:
    """Samples of two fingers on pseudo terminals at 500 Hz, and how late each comes after its period began."""
    with tempfile.TemporaryDirectory() as folder:
        links = [Path(folder) / name for name in ("left", "right")]
        with (
            emulated("suntouch", "--link", str(links[0]), "--press", "3N"),
            emulated("suntouch", "--link", str(links[1]), "--seed", "1", "--press", "3N"),
        ):
            left, right = (
                Finger(
                    partial(SerialLink, str(link), 1_000_000),
                    FingerCalibration.load(CALIBRATIONS / f"{link.name}.json"),
                    CLOCK,
                )
                for link in links
            )
            sensor = SunTouchFingers(left, right, CLOCK)
            sensor.connect()
            latency: list[float] = []
            sequence: list[int] = []

            def listen(sample: WrenchSample) -> None:
                latency.append(CLOCK.now() - sample.stamp)
                sequence.append(sample.sequence)

            sensor.subscribe(listen)
            sensor.start()
            time.sleep(seconds)
            link = sensor.link()
            sensor.close()
    expected = round(seconds * sensor.rate)
    print(
        f"fingers    {seconds:.0f} s at 500 Hz: {100.0 * len(sequence) / expected:.2f} % of {expected} samples, "
        f"latency p50 {percentile(latency, 50):.2f}, p99 {percentile(latency, 99):.2f} ms; link {link}"
    )


def round_trips(name: str, link: Link, count: int = 2000) -> None:
    session = GripperSession("gripper", link, CLOCK)
    took = []
    for _ in range(count):
        began = time.perf_counter()
        session.ask(Observe(Command.WIDTH), lambda reply: None, 1.0)
        took.append(time.perf_counter() - began)
    session.close()
    print(
        f"gripper    {name}: round trip p50 {percentile(took, 50):.2f}, p99 {percentile(took, 99):.2f} ms"
    )


def gripper() -> None:
    """A request and its answer: on a virtual CAN bus (same process) and over TCP (its own process)."""
    import can

    device = WsgEmulator(FreeGripper(time.monotonic))
    port = CanPort(device, can.Bus("bench", interface="virtual"))
    done = threading.Event()

    def serve() -> None:
        raise_priority()
        Server([port], [device], time.monotonic).serve(lambda: not done.is_set())

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    round_trips("virtual CAN bus", CanLink(can.Bus("bench", interface="virtual")))
    done.set()
    thread.join()
    with emulated("wsg", "--tcp", "127.0.0.1:0") as (address,):
        host, _, number = address.rpartition(":")
        round_trips("TCP", TcpLink(host, int(number)))


def arm() -> None:
    """A trajectory of 500 points, 10 s: gaps show as a late end, because a dry queue stands still."""
    port = 51240
    with emulated("motoman", "--port", str(port)):
        limits = ArmLimits(*np.outer((-3.0, 3.0, 3.0, 10.0, 200.0), np.ones(7)))
        driver = MotomanArm(
            lambda name: TcpLink("127.0.0.1", port + (name == "state")),
            CLOCK,
            limits,
            MotomanFile(address=("", port), robot=Path("robot.xml"), controller="fs100"),
        )
        driver.connect()
        driver.start()
        s = np.linspace(0.0, 1.0, 501)[:, None]
        change = np.full(7, 1.0)
        q = change * (10 * s**3 - 15 * s**4 + 6 * s**5)
        qd = change * 3 * (s - s**2) ** 2
        qdd = change * (0.6 * s - 1.8 * s**2 + 1.2 * s**3)
        motion = driver.follow(Trajectory(s[:, 0] * 10.0, q, qd, qdd))
        stream = driver._stream
        began = time.monotonic()
        ahead: list[float] = []
        while not motion.settled:
            time.sleep(0.01)
            if stream is not None and stream.sent > 1 and motion.progress < 1.0:
                ahead.append(stream.ahead)
        took = time.monotonic() - began
        driver.close()
    assert stream is not None
    print(
        f"arm        {stream.sent} points in {took:.2f} s for 10 s of path, {stream.busy} answered BUSY, "
        f"{stream.dry} gaps, never less than {1e3 * min(ahead):.0f} ms in the queue; "
        f"{motion.state.value} {motion.problem}"
    )


def main() -> None:
    raise_priority()
    sleep_lateness(2.0)
    gripper()
    arm()
    fingers(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)


if __name__ == "__main__":
    main()
