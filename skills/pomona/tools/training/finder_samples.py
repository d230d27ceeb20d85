"""Windows from which the finder learns: of rendered frames, photographs with boxes, and pictures without fruit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.skills.perception.detection.close_look import FINDER_STRIDE
from pomona.tools.photographs.photographs import Photograph
from pomona.tools.training.augmentation import change_look
from pomona.tools.training.samples import FrameFolder, cut_boxes, move_boxes
from pomona.tools.training.targets import finder_targets

SIDE = 320  # side of a window [px of the finder's input]

SHORTEST, NARROWEST = (
    6.0,
    0.28,
)  # least shorter side of a taught box [px of the input], and its ratio to the longer

FRAME_SCALE, FRAME_JITTER = 0.5, (0.8, 1.45)
"""Scale of a rendered frame of 640 px in a window, and the range of its factor: the detector searches at 0.5 to 0.7."""

PHOTO_JITTER = 1.22  # largest factor on a photograph's scale, and its inverse the least: size tells near from far rows
OVER_SCALES = 2.2  # the same, for a finder that searches each photograph at several widths
TAUGHT = (
    18.0,
    110.0,
)  # longer side of the boxes that it is taught; larger and smaller ones are left out [px]
EMPTY_JITTER = (
    0.9,
    3.0,
)  # range of the factor by which a picture without fruit is larger than the window
Window = tuple[UInt8, Float32]  # RGB (320, 320, 3) and the maps of `finder_targets`


class Windows(Protocol):
    """A source of windows."""

    def draw(self, rng: np.random.Generator) -> Window:
        """One window, a function of the generator's state alone."""


class EmptyWindows:
    """Windows of pictures without fruit."""

    def __init__(self, pictures: Sequence[Photograph]) -> None:
        self._pictures = pictures

    def draw(self, rng: np.random.Generator) -> Window:
        """Return a part of any of them."""
        return _window(self.part(rng), np.empty((0, 4)), np.empty(0, np.bool_), rng)

    def part(self, rng: np.random.Generator) -> UInt8:
        """Return the part of a picture, as it is, (320, 320, 3)."""
        photo = _any(self._pictures, rng)
        size = SIDE / max(photo.width, photo.height) * np.exp(rng.uniform(*np.log(EMPTY_JITTER)))
        return _cut(
            photo.picture(),
            size,
            _shift(photo, size, rng.uniform((0.0, 0.0), (photo.width, photo.height))),
        )


class PhotoWindows:
    """Windows of photographs with boxes, most often with a fruit in the middle half; each folder counts alike.

    `jitter` is the largest factor on a photograph's scale; with more than `PHOTO_JITTER`, sizes are those of `TAUGHT`.
    """

    def __init__(self, photographs: Sequence[Photograph], jitter: float = PHOTO_JITTER) -> None:
        folders = sorted({photo.path.parent for photo in photographs})
        self._folders = [
            [photo for photo in photographs if photo.path.parent == folder] for folder in folders
        ]
        self._jitter = jitter
        self._taught = TAUGHT if jitter > PHOTO_JITTER else (0.0, np.inf)

    def draw(self, rng: np.random.Generator) -> Window:
        """Return a part of any of them, near the scale at which fruit has the size that the detector looks for."""
        photo = _any(self._folders[int(rng.integers(len(self._folders)))], rng)
        size = photo.scale * np.exp(np.log(self._jitter) * rng.uniform(-1.0, 1.0))
        around = rng.uniform((0.0, 0.0), (photo.width, photo.height))
        if len(photo.boxes) and rng.random() < 0.6:
            x, y, w, h = photo.boxes[int(rng.integers(len(photo.boxes)))]
            around = (
                np.array([x + 0.5 * w, y + 0.5 * h]) + rng.uniform(-0.25, 0.25, 2) * SIDE / size
            )
        shift = _shift(photo, size, around)
        boxes = move_boxes(photo.boxes, size, shift)
        longer = boxes[:, 2:].max(axis=1, initial=0.0)
        taught = ~photo.crowd & (longer >= self._taught[0]) & (longer <= self._taught[1])
        return _window(_cut(photo.picture(), size, shift), boxes, taught, rng)


class FrameWindows:
    """Windows of annotated rendered frames; some are pasted on the pictures without fruit in `empty`."""

    def __init__(self, frames: FrameFolder, empty: Sequence[Photograph] = ()) -> None:
        self._frames, self._empty = frames, EmptyWindows(empty) if empty else None

    def draw(self, rng: np.random.Generator) -> Window:
        """Return a frame, or a part of it, somewhere in the window."""
        index = int(rng.integers(len(self._frames)))
        annotation, picture = (
            self._frames.annotation(index),
            self._frames.picture(index, halved=False),
        )
        size = FRAME_SCALE * 640.0 / annotation.width * np.exp(rng.uniform(*np.log(FRAME_JITTER)))
        extent = np.array([round(annotation.width * size), round(annotation.height * size)])
        small = cv2.resize(picture, extent.tolist(), interpolation=cv2.INTER_AREA)
        free = SIDE - extent
        u, v = (
            np.round(np.minimum(0, free) + rng.uniform(0.0, 1.0, 2) * np.abs(free))
            .astype(int)
            .tolist()
        )
        # ratio of rendered frames that are pasted on a picture without fruit instead of one colour
        if self._empty is not None and rng.random() < 0.4:
            canvas = self._empty.part(rng)
        else:
            canvas = np.broadcast_to(
                rng.integers(0, 256, 3).astype(np.uint8), (SIDE, SIDE, 3)
            ).copy()
        top, left = max(0, v), max(0, u)
        piece = small[top - v : SIDE - v, left - u : SIDE - u]
        canvas[top : top + len(piece), left : left + piece.shape[1]] = piece
        seen = [
            item for item in annotation.objects if item.box is not None and min(item.box[2:]) > 0
        ]
        boxes = np.array([item.box for item in seen], np.float64).reshape(-1, 4) * size + (
            u,
            v,
            0.0,
            0.0,
        )
        # rendered fruit of which less is visible is neither fruit nor background
        return _window(
            canvas, boxes, np.array([item.visibility >= 0.2 for item in seen], np.bool_), rng
        )


class FinderBatches(Dataset[tuple[Tensor, ...]]):
    """Batches of windows: pictures (n, 320, 320, 3) uint8 and targets (n, 8, 80, 80).

    Window k of batch s is a function of (seed, s, k) alone, so that a run may be resumed, and shared among processes.
    `sources` has windows, and how many of each are in a batch.
    """

    def __init__(
        self,
        sources: Sequence[tuple[Windows, int]],
        seed: int,
        steps: int,
        rank: int = 0,
        processes: int = 1,
    ) -> None:
        drawn = [source for source, count in sources for _ in range(count)]
        self._drawn, self._seed, self._steps = list(enumerate(drawn))[rank::processes], seed, steps

    def __len__(self) -> int:
        return self._steps

    def __getitem__(self, step: int) -> tuple[Tensor, ...]:
        cv2.setNumThreads(1)
        windows = [
            source.draw(np.random.default_rng((self._seed, step, 5, k)))
            for k, source in self._drawn
        ]
        return tuple(torch.from_numpy(np.stack(part)) for part in zip(*windows, strict=True))


def _window(
    picture: UInt8, boxes: Float64, fruit: NDArray[np.bool_], rng: np.random.Generator
) -> Window:
    """Return the window as it is learnt from: mirrored or not, its look changed, with targets."""
    if rng.random() < 0.5:
        picture = np.ascontiguousarray(picture[:, ::-1])
        boxes = np.column_stack([SIDE - boxes[:, 0] - boxes[:, 2], boxes[:, 1:]])
    inside = cut_boxes(boxes, SIDE, SIDE)
    area = inside[:, 2:].prod(axis=1)
    longer, shorter = (
        inside[:, 2:].max(axis=1, initial=0.0),
        inside[:, 2:].min(axis=1, initial=np.inf),
    )
    # least part of a box's area that a window must show for the fruit to be taught
    taught = fruit & (area >= 0.3 * boxes[:, 2:].prod(axis=1))
    taught &= (shorter >= SHORTEST) & (shorter >= NARROWEST * longer)
    there = area > 0.0
    cells = SIDE // FINDER_STRIDE
    targets = finder_targets(inside[there] / FINDER_STRIDE, taught[there], cells, cells)
    return change_look(picture, rng), targets


def _any(pictures: Sequence[Photograph], rng: np.random.Generator) -> Photograph:
    return pictures[int(rng.integers(len(pictures)))]


def _shift(photo: Photograph, size: float, around: Float64) -> Float64:
    """Where a scaled picture is put so that a point of it is in the window's middle, and little lies beside it [px]."""
    reach = 0.5 * SIDE / size
    least = np.full(2, 0.9 * reach)
    most = np.array([photo.width, photo.height]) - least
    middle = np.where(
        least < most, np.clip(around, least, np.maximum(least, most)), 0.5 * (least + most)
    )
    shift: Float64 = 0.5 * (SIDE - 1) - size * (middle - 0.5)
    return shift


def _cut(picture: UInt8, size: float, shift: Float64) -> UInt8:
    """Return a window of a picture that is scaled and then moved [px]; outside of the picture it is grey."""
    while size < 0.6:  # without aliasing
        height, width = picture.shape[:2]
        half = cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        picture, size, shift = np.asarray(half, np.uint8), 2.0 * size, shift + 0.5 * size
    matrix = np.array([[size, 0.0, shift[0]], [0.0, size, shift[1]]])
    moved = cv2.warpAffine(
        picture, matrix, (SIDE, SIDE), flags=cv2.INTER_LINEAR, borderValue=(114, 114, 114)
    )
    return np.asarray(moved, np.uint8)
