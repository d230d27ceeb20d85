"""The driver `wall_camera`, without a cell."""

from __future__ import annotations

import numpy as np

from my_package.wall_camera import WallCamera, WallCameraOptions
from pomona.drivers import Camera
from pomona.executive import ManualClock


def test_it_is_a_camera_whose_frames_count() -> None:
    camera = WallCamera(WallCameraOptions(width=32, distance=0.4), ManualClock())
    assert isinstance(camera, Camera)
    first = camera.latest()
    second = camera.latest()
    assert first is not None
    assert second is not None
    assert (first.sequence, second.sequence) == (0, 1)
    assert first.depth is not None
    assert np.allclose(first.depth, 0.4)
