"""A camera's options: intrinsics at another image size see the same rays."""

import numpy as np
import pytest

from pomona.drivers.camera_options import IntrinsicsSection

D435 = IntrinsicsSection(fx=610.6, fy=608.1, cx=317.7, cy=238.1, width=640, height=480)


@pytest.mark.parametrize("size", [(1280, 960), (320, 240), (640, 480), (800, 300)])
def test_the_same_point_of_the_image_is_seen_along_the_same_ray_at_any_size(
    size: tuple[int, int],
) -> None:
    scaled, whole = D435.intrinsics(size), D435.intrinsics()
    assert (scaled.width, scaled.height) == size
    for share in np.random.default_rng(0).uniform(
        0.0, 1.0, (20, 2)
    ):  # of the image, from its outer upper left corner
        rays = []
        for camera in (scaled, whole):
            u, v = share * (camera.width, camera.height) - 0.5
            rays.append(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy))
        assert rays[0] == pytest.approx(rays[1], abs=1e-12)
