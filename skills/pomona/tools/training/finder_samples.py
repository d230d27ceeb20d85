"""Windows of rendered frames from which the finder learns."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.skills.perception.detection.close_look import FINDER_STRIDE
from pomona.tools.training.augmentation import change_look
from pomona.tools.training.samples import FrameFolder
from pomona.tools.training.targets import finder_targets

SIDE = 320  # side of a window [px of the finder's input]
SHORTEST = 6.0  # least shorter side of a taught box [px of the input]
NARROWEST = 0.28  # least ratio of its shorter side to the longer
LEAST_SEEN = 0.2  # fruit of which less is visible is neither fruit nor background
LEAST_INSIDE = 0.3  # likewise for a box of which the window shows less

FRAME_SCALE = 0.5
FRAME_JITTER = (0.8, 1.45)
"""Scale of a rendered frame of 640 px in a window, and the range of its factor: the detector searches at 0.5 to 0.7."""

Window = tuple[UInt8, Float32]  # RGB (320, 320, 3) and the maps of `finder_targets`


class FinderBatches(Dataset[tuple[Tensor, ...]]):
    """Batches of windows: pictures (n, 320, 320, 3) uint8 and targets (n, 8, 80, 80).

    Window k of batch s is a function of (seed, s, k) alone, so that a run may be resumed. `sources` has folders of
    frames, and how many windows of each are in a batch.
    """

    def __init__(self, sources: Sequence[tuple[FrameFolder, int]], seed: int, steps: int) -> None:
        self._drawn = [frames for frames, count in sources for _ in range(count)]
        self._seed = seed
        self._steps = steps

    def __len__(self) -> int:
        return self._steps

    def __getitem__(self, step: int) -> tuple[Tensor, ...]:
        cv2.setNumThreads(1)
        windows = [
            draw_window(frames, np.random.default_rng((self._seed, step, 5, k)))
            for k, frames in enumerate(self._drawn)
        ]
        return tuple(torch.from_numpy(np.stack(part)) for part in zip(*windows, strict=True))


def draw_window(frames: FrameFolder, rng: np.random.Generator) -> Window:
    """Draw a frame, or a part of it, somewhere in a window, mirrored or not, with its look changed."""
    index = int(rng.integers(len(frames)))
    annotation = frames.annotation(index)
    size = FRAME_SCALE * 640.0 / annotation.width * np.exp(rng.uniform(*np.log(FRAME_JITTER)))
    extent = np.array([round(annotation.width * size), round(annotation.height * size)])
    small = cv2.resize(frames.picture(index), extent.tolist(), interpolation=cv2.INTER_AREA)
    free = SIDE - extent
    place = np.minimum(0, free) + rng.uniform(0.0, 1.0, 2) * np.abs(free)
    u, v = np.round(place).astype(int).tolist()
    canvas = np.empty((SIDE, SIDE, 3), np.uint8)
    canvas[:] = rng.integers(0, 256, 3)
    top = max(0, v)
    left = max(0, u)
    piece = small[top - v : SIDE - v, left - u : SIDE - u]
    canvas[top : top + len(piece), left : left + piece.shape[1]] = piece
    seen = [item for item in annotation.objects if min(item.box[2:]) > 0]
    boxes = np.array([item.box for item in seen], np.float64).reshape(-1, 4) * size
    boxes[:, :2] += (u, v)
    fruit = np.array([item.visibility >= LEAST_SEEN for item in seen], np.bool_)
    if rng.random() < 0.5:
        canvas = np.ascontiguousarray(canvas[:, ::-1])
        boxes[:, 0] = SIDE - boxes[:, 0] - boxes[:, 2]
    return change_look(canvas, rng), _targets(boxes, fruit)


def _targets(boxes: Float64, fruit: NDArray[np.bool_]) -> Float32:
    """Return the finder's targets of boxes x, y, w, h (n, 4) [px] in a window, and which are to be taught (n,)."""
    low = np.clip(boxes[:, :2], 0.0, SIDE)
    inside = np.hstack([low, np.clip(boxes[:, :2] + boxes[:, 2:], 0.0, SIDE) - low])
    area = inside[:, 2:].prod(axis=1)
    longer = inside[:, 2:].max(axis=1, initial=0.0)
    shorter = inside[:, 2:].min(axis=1, initial=np.inf)
    taught = fruit & (area >= LEAST_INSIDE * boxes[:, 2:].prod(axis=1))
    taught &= (shorter >= SHORTEST) & (shorter >= NARROWEST * longer)
    there = area > 0.0
    cells = SIDE // FINDER_STRIDE
    return finder_targets(inside[there] / FINDER_STRIDE, taught[there], cells, cells)
