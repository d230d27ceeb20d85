"""Batches from photographs, beside the rendered ones; batch k is a function of (seed, k) alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.close_look import SIZE_OF_BOX, look_at
from pomona.skills.perception.detection.outputs import FINDER_STRIDE
from pomona.skills.perception.training.augmentation import change_look, cover
from pomona.skills.perception.training.losses import AS_LARGE, FRUIT_IN_INPUT
from pomona.skills.perception.training.photographs import Labels, Photograph, fruit_scale, most_visible
from pomona.skills.perception.training.samples import (
    FINDER_INPUT,
    MOST_ROLL,
    Sample,
    cut_boxes,
    look_sample,
    move_boxes,
    no_fruit,
    roll_of_look,
)
from pomona.skills.perception.training.targets import box_targets

JITTER = (0.71, 1.36)
"""How much larger or smaller than that: in orchards size tells near fruit from fruit of the next row."""

EMPTY_SHARE = 0.12
"""How often a picture without fruit stands in a photograph's place, where there are any."""

EMPTY_JITTER = (0.9, 3.0)
"""How much larger than the whole picture on the finder's input such a picture is shown."""

SHOWN = 0.45
"""A fruit of whose box a window shows less than this part is ignored there."""


class PhotoFinderBatches(Dataset[tuple[Tensor, ...]]):
    """Batches for the finder from photographs, of the same parts as `FinderBatches`.

    Args:
        empty: pictures without fruit, of which `EMPTY_SHARE` of a batch are.
    """

    def __init__(
        self, photographs: Sequence[Photograph], batch: int, seed: int, steps: int, empty: Sequence[Photograph] = ()
    ) -> None:
        self.photographs, self.batch, self.seed, self.steps = photographs, batch, seed, steps
        self.scale, self.empty = fruit_scale(photographs), empty

    def __len__(self) -> int:
        return self.steps

    def __getitem__(self, step: int) -> tuple[Tensor, ...]:
        cv2.setNumThreads(1)
        rng = np.random.default_rng((self.seed, step, 3))
        samples = [self._sample(_one_of(self.photographs, self.empty, rng), rng) for _ in range(self.batch)]
        return tuple(torch.from_numpy(np.stack(part)) for part in zip(*samples, strict=True))

    def _sample(self, photo: Photograph, rng: np.random.Generator) -> Sample:
        """A window of the photograph at nearly the usual scale, most often with a fruit in it."""
        height, width = FINDER_INPUT
        picture, labels = photo.picture(), photo.labels
        # What is in a picture without fruit may be of any size.
        usual, jitter = (FINDER_INPUT[1] / photo.width, EMPTY_JITTER) if photo.empty else (self.scale, JITTER)
        size = usual * np.exp(rng.uniform(*np.log(jitter)))
        around = rng.uniform((0.0, 0.0), (photo.width, photo.height))
        if len(labels.centres) and rng.random() < 0.6:
            around = labels.centres[int(rng.integers(len(labels.centres)))]
        reach = 0.5 * np.array([width, height]) / size
        middle = around + rng.uniform(-0.7, 0.7, 2) * reach
        # Hardly anything of the window lies beside the photograph.
        least, most = 0.85 * reach, (photo.width, photo.height) - 0.85 * reach
        middle = np.where(least < most, np.clip(middle, least, np.maximum(least, most)), 0.5 * (least + most))
        shift = 0.5 * np.array([width - 1, height - 1]) - size * middle
        picture = window(picture, size, shift, (width, height), rng)
        centres, boxes, sizes = (
            labels.centres * size + shift,
            move_boxes(labels.boxes, size, shift),
            labels.sizes * size,
        )
        if rng.random() < 0.5:
            picture = np.ascontiguousarray(picture[:, ::-1])
            centres = centres * (-1.0, 1.0) + (width - 1.0, 0.0)
            boxes[:, 0] = width - boxes[:, 0] - boxes[:, 2]
        picture = cover(change_look(picture, rng), rng, 0.1, (0.03, 0.15))
        inside = cut_boxes(boxes, width, height)
        counted = labels.counted & (inside[:, 2:].prod(axis=1) >= SHOWN * boxes[:, 2:].prod(axis=1))
        s = FINDER_STRIDE
        maps = box_targets(
            (centres + 0.5) / s - 0.5,
            sizes / s,
            inside / s,
            counted,
            height // s,
            width // s,
        )
        if photo.empty:
            maps.unlabelled[:] = 0.0
        return (picture, *maps.parts)


def window(picture: UInt8, size: float, shift: Float64, extent: tuple[int, int], rng: np.random.Generator) -> UInt8:
    """A part of a picture (h, w, 3), scaled and then moved [px]; what lies beyond the picture has one colour."""
    matrix = np.array([[size, 0.0, shift[0]], [0.0, size, shift[1]]])
    colour = [int(c) for c in rng.integers(0, 256, 3)]
    if size < 0.6:  # shrink without aliasing first
        half = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        matrix = np.array([[2.0 * size, 0.0, shift[0] + 0.5 * size], [0.0, 2.0 * size, shift[1] + 0.5 * size]])
        picture = np.asarray(half, np.uint8)
    return np.asarray(cv2.warpAffine(picture, matrix, extent, flags=cv2.INTER_LINEAR, borderValue=colour), np.uint8)


MOST_OF_ONE = 8
"""Looks at fruit, and looks at none, that one photograph gives to a batch."""


class PhotoCloseLookBatches(Dataset[tuple[Tensor, ...]]):
    """Batches for the second look from photographs, of the same parts as `CloseLookBatches`.

    Args:
        places: where the finder sees fruit in each photograph, by name: rows (u, v, size [px], belief).
        turned: share of the looks that are turned by any angle about their axis.
        empty: pictures without fruit.
    """

    def __init__(
        self,
        photographs: Sequence[Photograph],
        batch: int,
        seed: int,
        steps: int,
        places: Mapping[str, Float64] | None = None,
        turned: float = 0.0,
        empty: Sequence[Photograph] = (),
    ) -> None:
        self.photographs, self.batch, self.seed, self.steps = photographs, batch, seed, steps
        self.places, self.turned, self.empty = places or {}, turned, empty
        self.usual = SIZE_OF_BOX * FRUIT_IN_INPUT / fruit_scale(photographs)

    def __len__(self) -> int:
        return self.steps

    def __getitem__(self, step: int) -> tuple[Tensor, ...]:
        cv2.setNumThreads(1)
        rng = np.random.default_rng((self.seed, step, 4))
        samples: list[Sample] = []
        while len(samples) < self.batch:
            samples += self._samples(_one_of(self.photographs, self.empty, rng), rng)
        return tuple(torch.from_numpy(np.stack(part)) for part in zip(*samples[: self.batch], strict=True))

    def _samples(self, photo: Photograph, rng: np.random.Generator) -> list[Sample]:
        picture, labels, K = photo.picture(), photo.labels, photo.K
        fruit = np.nonzero(labels.counted)[0]
        samples = []
        for k in rng.permutation(fruit)[:MOST_OF_ONE]:
            box = labels.boxes[k]
            size = labels.sizes[k] if np.isfinite(labels.sizes[k]) else SIZE_OF_BOX * float(box[2:].max())
            doubt = 1.0 if rng.random() < 0.7 else 0.35
            centre = labels.centres[k] + rng.normal(0.0, 0.06 * doubt, 2) * size
            roll = roll_of_look(self.turned, rng)
            look = look_at(K, centre, size * np.exp(rng.normal(0.0, 0.13 * doubt)), roll)
            size_known, upright = np.isfinite(labels.sizes[k]), abs(roll) < MOST_ROLL
            target, known = np.zeros(10, np.float32), np.array([size_known, size_known, 0, upright, 0, 0], np.float32)
            target[:3], target[6:] = look.label_place(labels.centres[k], size), look.label_box(box)
            shown = most_visible(box)
            samples.append(look_sample(picture, look, target, 1.0, shown, known, rng, True))
        for place, size in self._elsewhere(photo, labels, rng):
            look = look_at(K, place, size, roll_of_look(self.turned, rng))
            unlabelled = float(size >= AS_LARGE * self.usual and not photo.empty)
            samples.append(no_fruit(picture, look, unlabelled, rng, True))
        return samples

    def _elsewhere(self, photo: Photograph, labels: Labels, rng: np.random.Generator) -> list[tuple[Float64, float]]:
        """Places that nobody labelled: what deceives the finder, beside fruit, anywhere."""
        places = self.places.get(photo.name, np.empty((0, 4)))
        wrong = [(row[:2], float(row[2])) for row in rng.permutation(places)]
        wrong = [place for place in wrong if _clear(*place, labels.boxes)][: MOST_OF_ONE - 2]
        usual, extent = 0.12 * photo.width if photo.empty else self.usual, (photo.width, photo.height)
        other = [
            (rng.uniform((0.0, 0.0), extent), usual * np.exp(rng.uniform(np.log(0.5), np.log(1.6))))
            for _ in range(3 if photo.empty else 1)
        ]
        if len(labels.boxes):
            box = labels.boxes[int(rng.integers(len(labels.boxes)))]
            size, angle = SIZE_OF_BOX * float(box[2:].max()), rng.uniform(0.0, 2.0 * np.pi)
            away = rng.uniform(1.0, 1.7) * size * np.array([np.cos(angle), np.sin(angle)])
            other.append((box[:2] + 0.5 * box[2:] + away, size * np.exp(rng.normal(0.0, 0.3))))
        return wrong + [
            (place, size)
            for place, size in other
            if _clear(place, size, labels.boxes) and (place > 0).all() and (place < (photo.width, photo.height)).all()
        ]


def _one_of(labelled: Sequence[Photograph], empty: Sequence[Photograph], rng: np.random.Generator) -> Photograph:
    some = empty if empty and rng.random() < EMPTY_SHARE else labelled
    return some[int(rng.integers(len(some)))]


def _clear(place: Float64, size: float, boxes: Float64) -> bool:
    """Whether a look aimed here is at none of the boxes."""
    if not len(boxes):
        return True
    beyond = np.abs(place - (boxes[:, :2] + 0.5 * boxes[:, 2:])) - 0.5 * boxes[:, 2:]
    return bool((beyond.max(axis=1) > 0.15 * size).all())


class Mixed(Dataset[tuple[Tensor, ...]]):
    """Batches of several kinds as one: rendered frames and photographs, which share their parts."""

    def __init__(self, kinds: Sequence[Dataset[tuple[Tensor, ...]]], steps: int) -> None:
        self.kinds, self.steps = kinds, steps

    def __len__(self) -> int:
        return self.steps

    def __getitem__(self, step: int) -> tuple[Tensor, ...]:
        return tuple(torch.cat(parts) for parts in zip(*(kind[step] for kind in self.kinds), strict=True))
