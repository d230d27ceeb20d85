"""Many threads call the fingers at once; one of them alone may touch their lines."""

from __future__ import annotations

import threading
import time

import numpy as np

from pomona.devices.emulators.suntouch import SunTouchEmulator
from pomona.devices.suntouch.driver import SunTouchFingers
from pomona.devices.suntouch.finger import Finger
from pomona.drivers.interfaces import WrenchSample
from pomona.executive.clock import SystemClock
from tests.drivers.devices.suntouch.test_driver import CALIBRATION
from tests.drivers.one_thread import PATIENCE, OneThread, hammer


class LiveLine(OneThread):
    """A finger that answers at once, in real time, without a terminal."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.device = SunTouchEmulator(lambda: np.zeros(6), seed)
        self._arrived = bytearray()

    class _Peer:
        def __init__(self, line: LiveLine) -> None:
            self.line = line

        def send(self, chunk: bytes) -> None:
            self.line._arrived += chunk

        def close(self) -> None: ...

    def open(self) -> LiveLine:
        self.enter()
        return self

    def send(self, chunk: bytes) -> None:
        self.enter()
        self.device.received(self._Peer(self), chunk)

    def receive(self, timeout: float) -> bytes:
        self.enter()
        if not self._arrived:
            time.sleep(min(timeout, 1e-3))
        chunk = bytes(self._arrived)
        self._arrived.clear()
        return chunk

    def close(self) -> None:
        self.enter()


def test_calls_of_many_threads_break_nothing_and_the_fingers_stream_afterwards() -> None:
    lines = LiveLine(0), LiveLine(1)
    clock = SystemClock()
    # A loaded machine may hold threads up for long; silence is not what this is about.
    fingers = SunTouchFingers(
        *(Finger(line.open, CALIBRATION, clock) for line in lines), clock, silence=PATIENCE
    )
    fingers.connect()
    for line in lines:
        line.used_by.clear()
    fingers.start()
    samples: list[WrenchSample] = []

    def come_and_go(_: np.random.Generator) -> None:
        fingers.subscribe(samples.append).close()

    wrong = hammer(
        {
            "bias": lambda rng: fingers.bias(),
            "come and go": come_and_go,
            "look": lambda rng: (
                fingers.latest(),
                fingers.link(),
                fingers.biased,
                fingers.settled(),
            ),
            "check": lambda rng: fingers.check(),
            "safe stop": lambda rng: fingers.safe_stop("stress"),
            "acknowledge": lambda rng: fingers.acknowledge(),
        },
        rounds=100,
    )
    assert wrong == []
    fingers.check()
    fingers.bias()
    enough = threading.Event()

    def listen(sample: WrenchSample) -> None:
        if fingers.biased:
            enough.set()

    fingers.subscribe(listen)
    assert enough.wait(PATIENCE)
    used = set.union(*(line.used_by for line in lines))
    assert len(used) == 1
    assert threading.get_ident() not in used
    fingers.close()
