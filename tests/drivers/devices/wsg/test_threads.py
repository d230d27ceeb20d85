"""Many threads call the gripper at once; one of them alone may touch its wire."""

from __future__ import annotations

import threading
import time

import pytest

from pomona.devices.emulators.free_gripper import FreeGripper
from pomona.devices.emulators.wsg import WsgEmulator
from pomona.devices.wsg.driver import WsgGripper
from pomona.devices.wsg.handshake import WsgOptions
from pomona.drivers.interfaces import MotionState
from pomona.executive.clock import SystemClock
from tests.drivers.one_thread import PATIENCE, OneThread, hammer


class LiveWire(OneThread):
    """An emulated gripper that steps during reads; in real time, without a socket."""

    def __init__(self) -> None:
        super().__init__()
        self.device = WsgEmulator(FreeGripper(time.monotonic))
        self._arrived = bytearray()

    def open(self) -> LiveWire:
        self.device.connected(self)
        return self

    def send(self, chunk: bytes) -> None:
        """Called by the driver with requests and by the device with answers: each side knows which it is."""
        if self._answering:
            self._arrived += chunk
            return
        self.enter()
        self._answering = True
        self.device.received(self, chunk)
        self._answering = False

    _answering = False

    def receive(self, timeout: float) -> bytes:
        self.enter()
        end = time.monotonic() + timeout
        while True:
            self._answering = True
            self.device.advance(time.monotonic())
            self._answering = False
            if self._arrived or time.monotonic() >= end:
                chunk = bytes(self._arrived)
                self._arrived.clear()
                return chunk
            time.sleep(2e-4)

    def close(self) -> None:
        self.device.disconnected(self)


def test_calls_of_many_threads_break_nothing_and_the_gripper_works_afterwards() -> None:
    wire = LiveWire()
    # A loaded machine may hold threads up for long; silence is not what this is about.
    gripper = WsgGripper(wire.open, SystemClock(), WsgOptions(silence=PATIENCE, watchdog=0.5))
    gripper.connect()
    wire.used_by.clear()
    gripper.start()
    wrong = hammer(
        {
            "move": lambda rng: gripper.move(rng.uniform(0.0, 0.06), 0.2),
            "move and stop": lambda rng: gripper.move(rng.uniform(0.0, 0.06), 0.2).stop(),
            "stream": lambda rng: gripper.set_speed(rng.uniform(-0.02, 0.02)),
            "pause": lambda rng: gripper.pause(),
            "resume": lambda rng: gripper.resume(),
            "safe stop": lambda rng: gripper.safe_stop("stress"),
            "acknowledge": lambda rng: gripper.acknowledge(),
            "look": lambda rng: (
                gripper.state(),
                gripper.settled(),
                gripper.link(),
                gripper.check(),
            ),
        }
    )
    assert wrong == []
    gripper.check()  # neither lost nor faulty: nobody pulled a cable
    reasons = []
    for _ in range(3):
        gripper.safe_stop("end of the stress")
        gripper.acknowledge()
        motion = gripper.move(0.03, 0.4)
        end = time.monotonic() + PATIENCE
        while not motion.settled and time.monotonic() < end:
            time.sleep(0.005)
        if motion.state is MotionState.DONE:
            break
        # Held up for long, the driver's thread rightly takes a move for one that went wrong: the next one must not.
        reasons.append(motion.problem)
    assert motion.state is MotionState.DONE, reasons
    assert len(wire.used_by) == 1
    assert threading.get_ident() not in wire.used_by
    gripper.close()


@pytest.mark.parametrize("seed", range(3))
def test_no_move_that_was_left_before_a_safe_stop_starts_after_it(seed: int) -> None:
    wire = LiveWire()
    gripper = WsgGripper(wire.open, SystemClock(), WsgOptions(silence=PATIENCE))
    gripper.connect()
    gripper.start()
    motions = [gripper.move(0.02 + 0.001 * seed, 0.001) for _ in range(5)]
    gripper.safe_stop("now")
    gripper.acknowledge()
    assert all(motion.ended for motion in motions)
    gripper.close()
