"""The driver `wall_camera` of a cell file: a camera that looks at a wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.drivers import Camera, ConnectContext, Device, Frame, Intrinsics, Settings, driver
from pomona.executive import LENGTH, Clock, Measure, Whole, value


@dataclass(frozen=True, slots=True, kw_only=True)
class WallCameraOptions:
    """A wall, straight ahead."""

    width: int = value(Whole(16, 4096), 64, "pixels of a row")
    distance: float = value(Measure(LENGTH, "1 cm", "10 m"), "50 cm", "of the wall")


class WallCamera(Device):
    """Shows a new frame at every look. A real driver reads its device in a thread and keeps the newest frame."""

    interfaces = (Camera,)

    def __init__(self, options: WallCameraOptions, clock: Clock, name: str = "camera") -> None:
        super().__init__(name)
        self._options = options
        self._clock = clock
        self._looks = 0

    def latest(self) -> Frame | None:
        width = self._options.width
        camera = Intrinsics(
            fx=float(width), fy=float(width), cx=width / 2, cy=width / 2, width=width, height=width
        )
        self._looks += 1
        return Frame(
            stamp=self._clock.now(),
            sequence=self._looks - 1,
            colour=np.full((width, width, 3), 128, np.uint8),
            depth=np.full((width, width), self._options.distance, np.float32),
            intrinsics=camera,
            q=None,
            T_mount_camera=np.eye(4),
            label=self.name,
        )


@driver(WallCamera, WallCameraOptions)
def connect(settings: Settings[WallCameraOptions], context: ConnectContext) -> WallCamera:
    """`driver: wall_camera`"""
    return WallCamera(settings.values, context.clock, settings.name)
