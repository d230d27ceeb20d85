"""Many threads look through the camera at once; one of them alone may touch its source."""

from __future__ import annotations

import threading
import time

import numpy as np

from pomona.devices.realsense.camera_mount import CameraMount
from pomona.devices.realsense.driver import StreamingCamera
from pomona.devices.realsense.source import Pair
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.clock import SystemClock
from tests.drivers.one_thread import PATIENCE, OneThread, hammer


class LiveSource(OneThread):
    """A camera in real time."""

    def __init__(self) -> None:
        super().__init__()
        self.number = 0
        self.rng = np.random.default_rng(0)

    def open(self) -> LiveSource:
        self.enter()
        return self

    def wait(self, timeout: float) -> Pair:
        self.enter()
        time.sleep(0.002)
        self.number += 1
        colour = self.rng.integers(0, 255, (6, 8, 3), np.uint8)
        K = Intrinsics(600.0, 600.0, 3.5, 2.5, 8, 6)
        return Pair(colour, np.ones((6, 8), np.float32), K, time.time(), True, self.number)

    def close(self) -> None:
        self.enter()


def test_calls_of_many_threads_break_nothing_and_frames_come_afterwards() -> None:
    source, clock = LiveSource(), SystemClock()
    camera = StreamingCamera(source.open, CameraMount(None, np.eye(4)), clock, silence=PATIENCE)
    camera.connect()
    source.used_by.clear()
    camera.start()
    wrong = hammer(
        {
            "look": lambda rng: (
                camera.latest(),
                camera.link(),
                camera.last_seen(),
                camera.settled(),
            ),
            "check": lambda rng: camera.check(),
            "safe stop": lambda rng: camera.safe_stop("stress"),
            "acknowledge": lambda rng: camera.acknowledge(),
        },
        rounds=100,
    )
    assert wrong == []
    camera.check()
    before, end = source.number, time.monotonic() + PATIENCE
    while source.number < before + 5 and time.monotonic() < end:
        time.sleep(0.01)
    assert source.number >= before + 5
    assert len(source.used_by) == 1
    assert threading.get_ident() not in source.used_by
    camera.close()
