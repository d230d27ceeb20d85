"""A driver: a device behind a Protocol, with options that a cell file may give. Run: python examples/one_driver.py

An entry point makes it known to cell files: [project.entry-points."pomona.drivers"] wall-camera = "one_driver:connect"
Needs the distribution pomona.
"""

from dataclasses import dataclass

import numpy as np

from pomona.drivers import Camera, ConnectContext, Device, Frame, Intrinsics, Settings, driver
from pomona.executive.clock import Clock, ManualClock
from pomona.executive.values.kinds import Measure
from pomona.executive.values.sections import value
from pomona.executive.values.units import LENGTH


@dataclass(frozen=True, slots=True, kw_only=True)
class WallOptions:
    """A wall in front of the camera."""

    distance: float = value(Measure(LENGTH, "1 cm", "10 m"), "50 cm", "distance of the wall")


class WallCamera(Device):
    """An RGB-D camera that sees a wall. A real driver reads its device in a thread and keeps the newest frame."""

    interfaces = (Camera,)

    def __init__(self, options: WallOptions, clock: Clock, name: str = "camera") -> None:
        super().__init__(name)
        self._options = options
        self._clock = clock
        self._frames = 0

    def latest(self) -> Frame | None:
        self._frames += 1
        colour = np.full((48, 64, 3), 128, np.uint8)
        depth = np.full((48, 64), self._options.distance, np.float32)
        lens = Intrinsics(fx=60.0, fy=60.0, cx=31.5, cy=23.5, width=64, height=48)
        return Frame(
            self._clock.now(), self._frames, colour, depth, lens, q=None, T_mount_camera=np.eye(4)
        )


@driver(WallCamera, WallOptions)
def connect(settings: Settings[WallOptions], context: ConnectContext) -> WallCamera:
    """`driver: wall-camera`"""
    return WallCamera(settings.values, context.clock, settings.name)


camera = WallCamera(WallOptions(distance=0.4), ManualClock())
frame = camera.latest()
assert frame is not None
assert frame.depth is not None
print(
    f"{camera.name}: frame {frame.sequence}, {frame.depth.shape} pixels, {frame.depth.mean():.2f} m, {camera.link()}"
)
