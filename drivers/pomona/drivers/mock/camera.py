"""A camera that shows the frames it was given."""

from __future__ import annotations

from dataclasses import replace

from pomona.drivers.device import Device
from pomona.drivers.errors import DeviceError
from pomona.drivers.interfaces import Camera, Frame
from pomona.executive.clock import Clock


class MockCamera(Device):
    """Every look shows the next frame; the last one stays.

    Args:
        frames: to show, in order; none gives a camera without frames.
        clock: stamps each frame with the time of the look; without it frames keep their own stamps.

    Attributes:
        looks: number of requested frames.
    """

    interfaces = (Camera,)

    def __init__(self, *frames: Frame, clock: Clock | None = None) -> None:
        super().__init__("camera")
        self._frames, self._clock = list(frames), clock
        self.looks = 0
        self._error: DeviceError | None = None

    def show(self, *frames: Frame) -> None:
        """Show these frames from the next look on."""
        self._frames = list(frames)

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._error = error

    def latest(self) -> Frame | None:
        self.looks += 1
        if not self._frames:
            return None
        frame = self._frames.pop(0) if len(self._frames) > 1 else self._frames[0]
        return frame if self._clock is None else replace(frame, stamp=self._clock.now())

    def check(self) -> None:
        if self._error is not None:
            raise self._error

    def link(self) -> str:
        return "ok" if self._error is None else self._error.message
