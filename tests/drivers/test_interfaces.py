"""Frames: images that do not belong together are no frame."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault
from pomona.drivers.interfaces import Frame, Intrinsics

LENS = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)


def a_frame(
    colour: tuple[int, ...] = (480, 640, 3), depth: tuple[int, ...] | None = (480, 640)
) -> Frame:
    image = None if depth is None else np.zeros(depth, np.float32)
    return Frame(0.0, 0, np.zeros(colour, np.uint8), image, LENS, None, np.eye(4), "wrist")


def test_images_of_one_size_are_a_frame_with_or_without_depth() -> None:
    assert a_frame().depth is not None
    assert a_frame(depth=None).depth is None


@pytest.mark.parametrize(
    ("sizes", "words"),
    [
        ({"depth": (640, 480)}, "colour 640 x 480 px, intrinsics 640 x 480 px, depth 480 x 640 px"),
        ({"depth": (240, 320)}, "depth 320 x 240 px"),
        ({"colour": (240, 320, 3)}, "colour 320 x 240 px"),
        ({"colour": (240, 320, 3), "depth": None}, "colour 320 x 240 px, intrinsics 640 x 480 px;"),
        ({"depth": (480, 640, 1)}, "depth 1 x 640 x 480 px"),
    ],
)
def test_images_of_other_sizes_are_a_fault_of_the_camera_with_all_sizes(
    sizes: dict[str, object], words: str
) -> None:
    with pytest.raises(DeviceFault) as caught:
        a_frame(**sizes)  # type: ignore[arg-type]
    assert caught.value.device == "wrist"
    assert words in caught.value.message
    assert "register depth to colour" in caught.value.message
