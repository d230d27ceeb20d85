"""A video of colour with a video of depth beside it."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.devices.frames.folder import UnusableFrames
from pomona.devices.frames.video import Video, list_video
from pomona.drivers.interfaces import Intrinsics

CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)
COUNT = 7


def write_colour(path: Path, count: int = COUNT) -> Path:
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"FFV1"), 10.0, (64, 48)
    )
    assert writer.isOpened()
    for k in range(count):
        writer.write(np.full((48, 64, 3), (10, 20, 30 * k), np.uint8))  # OpenCV writes BGR
    writer.release()
    return path


def write_depth(
    path: Path, count: int = COUNT, first_mm: int = 1000, size: tuple[int, int] = (64, 48)
) -> Path:
    options = [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U, cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"FFV1"), 10.0, size, options
    )
    assert writer.isOpened()
    for k in range(count):
        writer.write(np.full(size[::-1], first_mm + k, np.uint16))
    writer.release()
    return path


@pytest.fixture
def video(tmp_path: Path) -> Path:
    write_depth(tmp_path / "row_depth_mm.mkv")
    return write_colour(tmp_path / "row_color.mkv")


def test_pictures_of_both_come_together_in_any_order(video: Path) -> None:
    frames = list_video(video)
    assert [frame.label for frame in frames[:2]] == ["row 000001", "row 000002"]
    assert len(frames) == COUNT
    for index in (0, 1, 5, 2, 6, 6, 0):
        colour, depth = frames[index].read(CAMERA)
        assert np.abs(colour.astype(int) - [30 * index, 20, 10]).max() <= 3
        assert depth == pytest.approx(np.full((48, 64), 1e-3 * (1000 + index), np.float32))
        assert depth.dtype == np.float32


def test_a_video_that_cannot_be_measured_is_refused_in_words(video: Path) -> None:
    depth = video.with_name("row_depth_mm.mkv")
    write_depth(depth, COUNT - 2)
    with pytest.raises(
        UnusableFrames,
        match=r"holds 7 pictures and row_depth_mm\.mkv 5: .* not of the same moments",
    ):
        list_video(video)
    depth.write_bytes(b"nothing")
    with pytest.raises(UnusableFrames, match=r"row_depth_mm\.mkv: is no video"):
        list_video(video)
    depth.unlink()
    with pytest.raises(
        UnusableFrames,
        match=r"no depth beside it .* `pomona detect` finds fruit in single pictures",
    ):
        list_video(video)
    video.write_bytes(b"nothing")
    with pytest.raises(UnusableFrames, match=r"row_color\.mkv: is no video"):
        list_video(video)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda path: write_depth(path, size=(32, 24)), "the intrinsics are for 64 x 48"),
        (lambda path: write_colour(path), "depth in mm is one channel of 16 bits"),
        (lambda path: write_depth(path, first_mm=1), "nearer than any camera measures"),
    ],
)
def test_pictures_that_do_not_fit_are_refused_in_words(video: Path, spoil, words: str) -> None:
    spoil(video.with_name("row_depth_mm.mkv"))
    with pytest.raises(UnusableFrames, match=words):
        list_video(video)[0].read(CAMERA)


def test_a_video_that_is_shorter_than_stated_names_the_missing_picture(video: Path) -> None:
    whole = video.read_bytes()
    video.write_bytes(whole[: len(whole) // 2])
    cut = Video(video)
    with pytest.raises(UnusableFrames, match="picture 7 of"):
        cut.read(COUNT - 1)
