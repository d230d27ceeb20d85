import time
from collections.abc import Callable

import numpy as np
import pytest

from pomona.devices.realsense.camera_mount import CameraMount
from pomona.devices.realsense.driver import RECONNECT, StreamingCamera
from pomona.devices.realsense.source import Pair
from pomona.devices.realsense.stamps import LATENCY
from pomona.drivers.errors import DeviceFault, DeviceLost
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.clock import ManualClock

INTRINSICS = Intrinsics(600.0, 600.0, 3.5, 2.5, 8, 6)


class ScriptedSource:
    def __init__(self, clock: ManualClock) -> None:
        self.clock, self.silent, self.gone, self.opened, self.closed, self.number = (
            clock,
            False,
            False,
            0,
            0,
            0,
        )
        self.on_host_clock, self.late, self.stays, self.frozen, self.same_depth = (
            False,
            0.0,
            False,
            False,
            False,
        )

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
        self.number += not self.stays
        colour, depth = np.zeros((6, 8, 3), np.uint8), np.ones((6, 8), np.float32)
        colour[0, 0] = 0 if self.frozen else 1 + self.number % 255
        depth[5, 7] += 0.0 if self.frozen or self.same_depth else 1e-3 * (1 + self.number % 255)
        taken = (time.time() if self.on_host_clock else 123.0 + self.clock.now()) - self.late
        return Pair(colour, depth, INTRINSICS, taken, self.on_host_clock, self.number)

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def source() -> ScriptedSource:
    return ScriptedSource(ManualClock(10.0))


@pytest.fixture
def camera(source: ScriptedSource) -> StreamingCamera:
    camera = StreamingCamera(source.open, CameraMount(None, np.eye(4)), source.clock)
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


def test_a_near_surface_that_repeats_most_of_its_depth_is_no_fault(
    camera: StreamingCamera, source: ScriptedSource
) -> None:
    for _ in range(40):  # of ScriptedSource's depth the last pixel changes alone
        camera.step()
    camera.check()


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


def test_an_unplugged_camera_is_looked_for_again_and_again(
    camera: StreamingCamera, source: ScriptedSource
) -> None:
    source.gone = True
    end = source.clock.now() + 5.0 * RECONNECT
    while source.clock.now() < end:
        camera.step()
    assert 4 <= source.opened <= 7
    assert "unplugged" in camera.link()


def test_a_camera_without_images_is_refused_at_the_connection(source: ScriptedSource) -> None:
    source.silent = True
    with pytest.raises(DeviceLost, match="no image within 1 s"):
        StreamingCamera(
            source.open, CameraMount(None, np.eye(4)), source.clock, silence=9.0
        ).connect(1.0)
    assert source.closed == 1


@pytest.mark.parametrize("on_host_clock", [True, False])
@pytest.mark.parametrize(
    ("lie", "words"),
    [
        (lambda source: setattr(source, "late", 30.0), "delivers frames that are 30 s old"),
        (lambda source: setattr(source, "late", -10.0), "stamps its frames 9.97 s in the future"),
        (lambda source: setattr(source, "stays", True), "repeats its frame 11"),
        (
            lambda source: setattr(source, "frozen", True),
            "shows the same picture for 0.53 s, to the last bit",
        ),
        (
            lambda source: setattr(source, "same_depth", True),
            "shows the same depth image for 0.53 s, to the last bit",
        ),
    ],
)
def test_frames_that_are_not_current_are_reported_within_a_second_and_never_shown(
    camera: StreamingCamera,
    source: ScriptedSource,
    lie: Callable[[ScriptedSource], None],
    words: str,
    on_host_clock: bool,
) -> None:
    source.on_host_clock = on_host_clock
    camera._stamps.restart()
    for _ in range(10):
        camera.step()
    last = camera.latest()
    lie(source)
    began = source.clock.now()
    while camera.link() == "ok":
        camera.step()
        assert source.clock.now() - began < 1.0
    with pytest.raises(DeviceFault) as caught:
        camera.check()
    if on_host_clock and "future" in words:
        words = "stamps its frames 10 s in the future"
    assert caught.value.message == words
    shown = camera.latest()
    assert shown is last or (
        (source.frozen or source.same_depth) and shown is not None and shown.stamp < began + 0.1
    )
    assert source.closed == 1  # opened again, and still latched
    source.late, source.stays, source.frozen, source.same_depth = 0.0, False, False, False
    while source.opened < 2:
        camera.step()
    camera.step()
    with pytest.raises(DeviceFault):
        camera.check()
    camera.acknowledge()
    camera.check()
    newest = camera.latest()
    assert newest is not None
    assert 0.0 <= source.clock.now() - newest.stamp < 0.05


def test_a_single_late_frame_is_left_out_without_a_fault(
    camera: StreamingCamera, source: ScriptedSource
) -> None:
    for late in (0.0, 2.0, 0.0, 0.0, 5.0, 0.0):
        source.late = late
        camera.step()
        frame = camera.latest()
        assert frame is not None
        assert source.clock.now() - frame.stamp < 0.1
    camera.check()


def test_the_age_of_a_frame_shows_in_its_stamp(
    camera: StreamingCamera, source: ScriptedSource
) -> None:
    source.late = 0.2
    for _ in range(10):  # the first of these seem to be older than what was seen already
        camera.step()
    frame = camera.latest()
    assert frame is not None
    assert frame.stamp == pytest.approx(source.clock.now() - LATENCY - 0.2, abs=1e-3)


def test_a_camera_that_lies_from_the_beginning_is_refused(source: ScriptedSource) -> None:
    source.on_host_clock, source.late = True, 30.0
    with pytest.raises(DeviceFault, match="30 s old"):
        StreamingCamera(source.open, CameraMount(None, np.eye(4)), source.clock).connect()
    assert source.closed == 1
