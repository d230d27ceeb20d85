"""The driver `wall_camera` keeps the claims of cameras, without a cell."""

from __future__ import annotations

from my_package.wall_camera import WallCamera, WallCameraOptions
from pomona.drivers import Intrinsics
from pomona.drivers.conformance import BenchClock, CameraBench, camera_claims


def bench() -> CameraBench:
    """The driver, and what truly stands before the camera."""
    clock = BenchClock()
    camera = WallCamera(WallCameraOptions(width=32, distance=0.4), clock)
    return CameraBench(camera, clock, lambda: 0.4, Intrinsics(32.0, 32.0, 16.0, 16.0, 32, 32))


test_claims = camera_claims(wall_camera=bench)
