"""Windows that the finder learns from: boxes stay on their fruit, and a batch repeats."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from pomona.skills.perception.detection.errors import BadTraining
from pomona.tools.photographs.photo_folder import read_empty, read_photographs
from pomona.tools.photographs.photographs import FRUIT_IN_INPUT, PhotoSet, fruit_scale
from pomona.tools.training.finder_samples import (
    OVER_SCALES,
    SIDE,
    TAUGHT,
    EmptyWindows,
    FinderBatches,
    FrameWindows,
    PhotoWindows,
)
from pomona.tools.training.samples import FrameFolder
from pomona.tools.training.targets import HEAT, PEAK, REACHES, WEIGHT
from tests.skills.tools.photographs.photo_folders import tables


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> PhotoSet:
    return read_photographs(tables(tmp_path_factory.mktemp("photographs") / "set"))


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
    (tmp_path / "000000.json").write_text(json.dumps({"camera_data": camera, "objects": objects}))
    return FrameFolder([tmp_path])


def is_red(picture: np.ndarray, u: float, v: float) -> bool:
    r, g, _ = picture[min(SIDE - 1, int(v)), min(SIDE - 1, int(u))].astype(int)
    return bool(r > g)


def test_peaks_of_photographs_lie_on_the_discs_and_boxes_around_them(photographs: PhotoSet) -> None:
    rng, seen, right = np.random.default_rng(0), 0, 0
    for _ in range(30):
        picture, maps = PhotoWindows(photographs.train).draw(rng)
        assert picture.shape == (SIDE, SIDE, 3)
        for v, u in np.argwhere(maps[PEAK] > 0):
            left, up, side, down = 4.0 * maps[REACHES, v, u]
            assert 0.6 < (left + side) / (up + down) < 1.7 or min(left + side, up + down) < 40
            seen, right = seen + 1, right + is_red(picture, 4 * u + 2, 4 * v + 2)
    assert seen > 30
    assert right > 0.9 * seen  # changed colours may turn a disc brown
    assert (
        photographs.train[0].scale
        == fruit_scale(photographs.train)
        == pytest.approx(FRUIT_IN_INPUT / 53.0, rel=0.1)
    )


def test_many_scales_teach_fruit_of_the_sizes_that_a_search_at_several_widths_keeps(
    photographs: PhotoSet,
) -> None:
    rng, sizes, ignored = np.random.default_rng(3), [], 0
    windows = PhotoWindows(photographs.train, OVER_SCALES)
    for _ in range(60):
        _, maps = windows.draw(rng)
        ignored += int((maps[WEIGHT] == 0.0).any())
        for v, u in np.argwhere(maps[PEAK] > 0):
            left, up, side, down = 4.0 * maps[REACHES, v, u]
            if (
                min(4 * u - left, 4 * v - up) > 2 and max(4 * u + side, 4 * v + down) < SIDE - 6
            ):  # whole
                sizes.append(max(left + side, up + down))
    assert TAUGHT[0] <= min(sizes) < 28.0
    assert 90.0 < max(sizes) <= TAUGHT[1]
    assert ignored  # fruit of other sizes is neither fruit nor background


def test_each_folder_counts_alike(photographs: PhotoSet) -> None:
    few = replace(photographs.train[0], path=Path("few/0.jpg"))
    windows, drawn = PhotoWindows([*photographs.train, few]), []
    for photo in (few, *photographs.train):
        blank = np.zeros((640, 640, 3), np.uint8)
        object.__setattr__(
            photo, "picture", lambda photo=photo, blank=blank: drawn.append(photo) or blank
        )
    rng = np.random.default_rng(0)
    for _ in range(60):
        windows.draw(rng)
    assert len(drawn) == 60
    assert 20 < sum(photo is few for photo in drawn) < 40


def test_a_rendered_fruit_keeps_its_box_and_hidden_fruit_does_not_count(
    frames: FrameFolder,
) -> None:
    rng, peaks, ignored = np.random.default_rng(1), 0, 0
    for _ in range(20):
        _, maps = FrameWindows(frames).draw(rng)
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
        frames.picture(0, halved=False)


def test_pictures_without_fruit_hold_none(tmp_path: Path) -> None:
    empty = read_empty(tables(tmp_path / "set") / "images")
    picture, maps = EmptyWindows(empty).draw(np.random.default_rng(0))
    assert picture.shape == (SIDE, SIDE, 3)
    assert maps[HEAT].max() == 0.0
    assert maps[WEIGHT].min() == 1.0


def test_batches_repeat_and_are_the_same_for_any_number_of_processes(
    photographs: PhotoSet, frames: FrameFolder
) -> None:
    sources = [(FrameWindows(frames), 2), (PhotoWindows(photographs.train), 3)]
    whole = FinderBatches(sources, 5, 9)[4]
    again = FinderBatches(sources, 5, 9)[4]
    assert all(torch.equal(a, b) for a, b in zip(whole, again, strict=True))
    assert not torch.equal(FinderBatches(sources, 6, 9)[4][0], whole[0])
    halves = [FinderBatches(sources, 5, 9, rank, 2)[4] for rank in range(2)]
    for part, first, second in zip(whole, *halves, strict=True):
        assert torch.equal(part[::2], first)
        assert torch.equal(part[1::2], second)
