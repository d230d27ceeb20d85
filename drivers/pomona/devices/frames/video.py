"""A video of colour with a video of depth beside it: each pair of pictures is a recorded frame.

row_7_color.mp4         colour, in a format of OpenCV
row_7_depth_mm.mkv      depth registered to it, one channel of 16 bits [mm], without loss (FFV1), 0 = no measurement
intrinsics.yaml         as in a folder of images
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.devices.frames.folder import Images, UnusableFrames, metres
from pomona.drivers import Intrinsics

DEPTH_SUFFIX = "_depth_mm.mkv"


class Video:
    """The pictures of one video, in any order; reading on is quick, going back opens it anew."""

    def __init__(self, path: Path, raw: bool = False) -> None:
        """
        Args:
            raw: hand pixels on as they are stored: depth.

        Raises:
            UnusableFrames: it is no video that can be read.
        """
        self.path = path
        self._raw = raw
        self._next = 0
        self._capture = self._open()
        self.count = max(
            0, int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        )  # number of pictures in its header

    def read(self, index: int) -> NDArray[Any]:
        """One picture, counted from 0, of shape (height, width, 3) or (height, width).

        Raises UnusableFrames: it ends before, or is damaged there.
        """
        if index < self._next:
            self._capture.release()
            self._capture = self._open()
            self._next = 0
        while self._next < index and self._capture.grab():
            self._next += 1
        there, image = self._capture.read() if self._next == index else (False, None)
        if not there or image is None:
            raise UnusableFrames(
                self.path,
                f"picture {index + 1} of {self.count} cannot be read: the video is shorter, or damaged",
            )
        self._next += 1
        return np.asarray(image)

    def _open(self) -> Any:
        capture = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            raise UnusableFrames(self.path, "is no video that can be read")
        if self._raw:
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        return capture


@dataclass(frozen=True, slots=True)
class VideoFrame:
    """Two pictures that were taken together."""

    colour: Video
    depth: Video
    index: int

    @property
    def label(self) -> str:
        """The video's name, and the picture's number from 1."""
        return f"{_name(self.colour.path)} {self.index + 1:06d}"

    def read(self, intrinsics: Intrinsics) -> Images:
        """Return both images. Raises UnusableFrames: they cannot be read, or are not of the intrinsics' size."""
        colour = self.colour.read(self.index)
        depth = self.depth.read(self.index)
        expected = (intrinsics.width, intrinsics.height)
        if depth.ndim == 2 and depth.size == expected[0] * expected[1]:
            depth = depth.reshape(
                expected[::-1]
            )  # OpenCV hands rows of one channel on in a row of its own
        for video, image in ((self.colour, colour), (self.depth, depth)):
            if image.shape[1::-1] != expected:
                got = f"{image.shape[1]} x {image.shape[0]}"
                raise UnusableFrames(
                    video.path,
                    f"is {got} pixels, the intrinsics are for {expected[0]} x {expected[1]}",
                )
        if depth.dtype != np.uint16 or depth.squeeze().ndim != 2:
            words = f"holds {depth.dtype} of {depth.shape[2] if depth.ndim == 3 else 1} channels"
            raise UnusableFrames(self.depth.path, f"{words}, depth in mm is one channel of 16 bits")
        return np.ascontiguousarray(colour[..., ::-1]), metres(depth.squeeze(), self.depth.path)


def list_video(path: Path) -> Sequence[VideoFrame]:
    """Return the frames of a video of colour with depth beside it.

    Raises UnusableFrames: it is no video, has no depth beside it, or the two are not of the same moments.
    """
    colour = Video(path)
    beside = path.with_name(f"{_name(path)}{DEPTH_SUFFIX}")
    if not beside.is_file():
        words = f"has no depth beside it ({beside.name} is missing), and without depth nothing is measured"
        raise UnusableFrames(
            path, f"{words}: `pomona detect` finds fruit in single pictures that are taken from it"
        )
    depth = Video(beside, raw=True)
    if colour.count != depth.count:
        words = f"holds {colour.count} pictures and {beside.name} {depth.count}"
        raise UnusableFrames(path, f"{words}: colour and depth are not of the same moments")
    if not colour.count:
        raise UnusableFrames(path, "holds no picture")
    return tuple(VideoFrame(colour, depth, index) for index in range(colour.count))


def _name(path: Path) -> str:
    return path.stem.removesuffix("_color")
