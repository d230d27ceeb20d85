"""Windows that the finder learns from: boxes stay on their fruit, and a batch repeats."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from pomona.tools.training.annotations import BadTraining
from pomona.tools.training.finder_samples import SIDE, FinderBatches, draw_window
from pomona.tools.training.samples import FrameFolder
from pomona.tools.training.targets import PEAK, REACHES, WEIGHT

pytestmark = pytest.mark.slow


@pytest.fixture
def frames(tmp_path: Path) -> FrameFolder:
    """One frame: a red disc of radius 60 px at (300, 200) and, hidden, one at (500, 400)."""
    picture = np.full((480, 640, 3), (60, 140, 40), np.uint8)
    cv2.circle(picture, (300, 200), 60, (40, 40, 200), -1)
    cv2.imwrite(str(tmp_path / "000000.jpg"), picture)
    points = [[300.0, 200.0]] * 9
    fruit = {
        "class": "apple",
        "projected_cuboid": points,
        "location": [0, 0, 0.5],
        "scale": 1.0,
        "dimensions": [0.1, 0.1, 0.1],
        "quaternion_xyzw": [0, 0, 0, 1],
    }
    objects = [
        fruit | {"visibility": 1.0, "bounding_box": [240, 140, 121, 121]},
        fruit | {"visibility": 0.1, "bounding_box": [480, 380, 40, 40]},
    ]
    camera = {
        "width": 640,
        "height": 480,
        "intrinsics": {"fx": 600, "fy": 600, "cx": 320, "cy": 240},
    }
    (tmp_path / "000000.json").write_text(
        json.dumps({"camera_data": camera, "objects": objects, "decoys": [], "scene": "table"})
    )
    return FrameFolder([tmp_path])


def test_a_rendered_fruit_keeps_its_box_and_hidden_fruit_does_not_count(
    frames: FrameFolder,
) -> None:
    rng, peaks, ignored = np.random.default_rng(1), 0, 0
    for _ in range(20):
        _, maps = draw_window(frames, rng)
        peaks += int(maps[PEAK].sum())
        for v, u in np.argwhere(maps[PEAK] > 0):
            left, up, side, down = 4.0 * maps[REACHES, v, u]
            if min(4 * u - left, 4 * v - up) > 2 and max(4 * u + side, 4 * v + down) < SIDE - 6:
                assert left + side == pytest.approx(up + down, rel=0.01)
                assert 0.39 * 121 < left + side < 0.74 * 121
        ignored += int((maps[WEIGHT] == 0.0).any())
    assert 15 <= peaks <= 20
    assert ignored >= 12


def test_a_frame_of_several_pictures_is_refused_by_its_name(
    frames: FrameFolder, tmp_path: Path
) -> None:
    pages = [Image.new("RGB", (640, 480), (10 * k, 90, 90)) for k in range(2)]
    pages[0].save(tmp_path / "000000.jpg", "WEBP", save_all=True, append_images=pages[1:])
    with pytest.raises(
        BadTraining, match=r"000000\.jpg holds 2 pictures: store each that is wanted"
    ):
        frames.picture(0)


def test_batches_repeat(frames: FrameFolder) -> None:
    whole, again = (FinderBatches([(frames, 3)], 5, 9)[4] for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(whole, again, strict=True))
    assert not torch.equal(FinderBatches([(frames, 3)], 6, 9)[4][0], whole[0])
