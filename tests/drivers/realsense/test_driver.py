import numpy as np
import pytest

from drivers.errors import DeviceLost
from drivers.interfaces import Intrinsics
from drivers.realsense.driver import LATENCY, RECONNECT, StreamingCamera
from drivers.realsense.ride import Ride
from drivers.realsense.source import Pair
from executive.clock import ManualClock

INTRINSICS = Intrinsics(600.0, 600.0, 3.5, 2.5, 8, 6)


class ScriptedSource:
    def __init__(self, clock: ManualClock) -> None:
        self.clock, self.silent, self.gone, self.opened, self.closed, self.number = clock, False, False, 0, 0, 0

    def open(self) -> "ScriptedSource":
        self.opened += 1
        if self.gone:
            raise DeviceLost("camera", "no device connected")
        return self

    def wait(self, timeout: float) -> Pair | None:
        if self.gone:
            raise DeviceLost("camera", "unplugged")
        self.clock.advance(timeout if self.silent else 1.0 / 30.0)
        if self.silent:
            return None
        self.number += 1
        colour, depth = np.zeros((6, 8, 3), np.uint8), np.ones((6, 8), np.float32)
        return Pair(colour, depth, INTRINSICS, 123.0, False, self.number)

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def source() -> ScriptedSource:
    return ScriptedSource(ManualClock(10.0))


@pytest.fixture
def camera(source: ScriptedSource) -> StreamingCamera:
    camera = StreamingCamera(source.open, Ride(None, np.eye(4)), source.clock)
    assert camera.latest() is None
    camera.connect()
    return camera


def test_the_newest_frame_is_at_hand_with_the_time_of_its_exposure(
    camera: StreamingCamera, source: ScriptedSource
) -> None:
    for _ in range(3):
        camera.step()
    frame = camera.latest()
    assert frame is not None
    assert frame.sequence == 3
    assert frame.stamp == pytest.approx(source.clock.now() - LATENCY)
    assert frame.intrinsics == INTRINSICS
    assert camera.link() == "ok"


def test_a_silent_camera_is_lost_and_opened_again_but_stays_latched(
    camera: StreamingCamera, source: ScriptedSource
) -> None:
    source.silent = True
    began = source.clock.now()
    while camera.link() == "ok":
        camera.step()
    assert source.clock.now() - began < 0.75
    assert source.closed == 1
    with pytest.raises(DeviceLost, match="no image"):
        camera.check()
    with pytest.raises(DeviceLost, match="still lost"):
        camera.acknowledge()
    source.silent = False
    while source.opened < 2:
        camera.step()
    camera.step()
    with pytest.raises(DeviceLost):
        camera.check()
    camera.acknowledge()
    camera.check()


def test_an_unplugged_camera_is_looked_for_again_and_again(camera: StreamingCamera, source: ScriptedSource) -> None:
    source.gone = True
    end = source.clock.now() + 5.0 * RECONNECT
    while source.clock.now() < end:
        camera.step()
    assert 4 <= source.opened <= 7
    assert "unplugged" in camera.link()


def test_a_camera_without_images_is_refused_at_the_connection(source: ScriptedSource) -> None:
    source.silent = True
    with pytest.raises(DeviceLost, match="no image within 1 s"):
        StreamingCamera(source.open, Ride(None, np.eye(4)), source.clock, silence=9.0).connect(1.0)
    assert source.closed == 1
