"""A RealSense camera as a `Camera`: its owner keeps the newest pair of images and where the camera was.

A frame that is old, stamped in the future, repeated or frozen (`pomona.drivers.streams.FrameGuard`) is rejected; a
camera that sends nothing else is lost, is reopened, and stays latched.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from numpy.typing import NDArray

from pomona.devices.realsense.camera_mount import CameraMount
from pomona.devices.realsense.source import Pair
from pomona.devices.realsense.stamps import Stamps
from pomona.drivers import (
    D4XX,
    Camera,
    DepthModel,
    Device,
    DeviceError,
    DeviceLost,
    Frame,
    FrameGuard,
    Owner,
)
from pomona.executive import Clock, UInt8

RECONNECT = 1.0  # pause between attempts to open a lost camera again [s]
# stride in rows and columns of the colour pixels that are compared with the previous frame
PIXELS = 16


class ImageSource(Protocol):
    """A source of images; see `pomona.devices.realsense.source`."""

    def wait(self, timeout: float) -> Pair | None:
        """Return the next pair of pictures, waiting at most `timeout` seconds; None when none came."""

    def close(self) -> None: ...


class StreamingCamera(Device):
    """Keeps the newest frame of a source at hand."""

    interfaces = (Camera,)

    def __init__(
        self,
        open_source: Callable[[], ImageSource],
        mount: CameraMount,
        clock: Clock,
        *,
        silence: float = 0.5,
        depth_model: DepthModel = D4XX,
        label: str = "realsense",
        name: str = "camera",
    ) -> None:
        super().__init__(name)
        self._open_source = open_source
        self._mount = mount
        self._clock = clock
        self._silence = silence
        self._label = label
        self._depth_model = depth_model
        self._stamps, self._guard = Stamps(clock), FrameGuard(clock, silence)
        self._source: ImageSource | None = None
        self._owner = Owner(name, self.step, self._lose, clock)
        self._newest: Frame | None = None
        self._sequence = 0
        self._last_seen = 0.0
        self._retry_at = 0.0
        self._problem = DeviceLost(name, "was never connected")

    def connect(self, deadline: float = 5.0) -> None:
        """Open the source and wait for its first images.

        Raises:
            DeviceError: it cannot be opened, or no image came within `deadline` [s].
        """
        self._open()
        end = self._clock.now() + deadline
        try:
            while self._newest is None:
                self._look()
                if self._clock.now() > end:
                    raise DeviceLost(self.name, f"no image within {deadline:g} s")
        except (OSError, DeviceError):
            self._close_source()
            raise
        self._problem = None

    def start(self) -> None:
        """Stream in a thread of its own from now on."""
        self._owner.start()

    def step(self) -> None:
        """Wait for one pair of images; the camera's own thread calls this in a loop."""
        try:
            if self._source is not None:
                self._look()
            elif self._clock.now() >= self._retry_at:
                self._open()
            else:
                self._clock.advance(0.05)
        except (OSError, DeviceError) as error:
            self._lose(error)

    def latest(self) -> Frame | None:
        return self._newest

    def picture(self) -> tuple[UInt8, float] | None:
        """Return the newest colour image, shape (h, w, 3), and its timestamp [s]."""
        frame = self._newest
        return None if frame is None else (frame.colour, frame.stamp)

    def check(self) -> None:
        super().check()
        self._owner.check()

    def acknowledge(self) -> None:
        """Acknowledge that the camera was lost. Raises DeviceLost: it is still lost."""
        self._owner.ask(self._release)

    def _release(self) -> None:
        if self._source is None:
            raise DeviceLost(self.name, f"is still lost: {self.link()}")
        self._problem = None

    def close(self) -> None:
        self._owner.close()
        self._close_source()
        self._problem = DeviceLost(self.name, "is closed")

    def _open(self) -> None:
        self._source = self._open_source()
        self._last_seen = self._clock.now()
        self._stamps.restart()
        self._guard.restart()

    def _look(self) -> None:
        source = self._source
        if source is None:
            return
        self._mount.note()
        pair = source.wait(0.1)
        self._mount.note()
        now = self._clock.now()
        if pair is not None:
            self._last_seen = now
            stamp = self._stamps.stamp(pair)
            if self._guard.judge(
                stamp, pair.number, _some_pixels(pair.colour), pair.depth.tobytes()
            ):
                self._newest = self._frame(pair, min(stamp, now))
            self._guard.check(self.name)
        elif now - self._last_seen > self._silence:
            raise DeviceLost(self.name, f"no image for {now - self._last_seen:.1f} s")

    def _frame(self, pair: Pair, stamp: float) -> Frame:
        frame = Frame(
            stamp=stamp,
            sequence=self._sequence,
            colour=pair.colour,
            depth=self._depth_model.corrected(pair.depth),
            intrinsics=pair.intrinsics,
            q=self._mount.joints(stamp),
            T_mount_camera=self._mount.T_mount_camera,
            label=self._label,
            depth_model=self._depth_model,
        )
        self._sequence += 1
        return frame

    def _lose(self, error: BaseException) -> None:
        if self._source is not None:
            self._problem = (
                error if isinstance(error, DeviceError) else DeviceLost(self.name, repr(error))
            )
        self._retry_at = self._clock.now() + RECONNECT
        self._close_source()

    def _close_source(self) -> None:
        source = self._source
        self._source = None
        if source is not None:
            source.close()


def _some_pixels(image: NDArray[Any]) -> bytes:
    some: bytes = image[::PIXELS, ::PIXELS].tobytes()
    return some
