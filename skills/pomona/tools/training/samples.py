"""Training batches from a folder of annotated frames; batch k is a function of (seed, k) alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from pomona.executive.values.arrays import Float64, UInt8
from pomona.executive.values.pictures import UnusablePicture, read_picture
from pomona.skills.perception.detection.close_look import (
    CLOSE_LOOK_SIZE,
    REFERENCE_LENGTH,
    VirtualCamera,
    keypoint_size,
    look_at,
)
from pomona.skills.perception.detection.errors import BadAnnotation, BadTraining
from pomona.tools.pytorch.networks import IMAGENET_MEAN, IMAGENET_STD, STRIDE
from pomona.tools.training.annotations import AnnotatedObject, Annotation, read_annotation
from pomona.tools.training.augmentation import change_look, cover
from pomona.tools.training.targets import dope_targets

Sample = tuple[NDArray[np.generic], ...]


class FrameFolder:
    """Pictures and annotations of one or more data folders, found once."""

    def __init__(self, folders: list[Path]) -> None:
        self.pictures = [
            picture
            for folder in folders
            for annotation in sorted(folder.glob("[!_]*.json"))
            if (picture := _picture_of(annotation)) is not None
        ]
        if not self.pictures:
            raise BadTraining(f"no annotated frames in {', '.join(map(str, folders))}")

    def __len__(self) -> int:
        return len(self.pictures)

    def name(self, index: int) -> str:
        """Return the frame's name in all folders: folder and picture without ending."""
        picture = self.pictures[index]
        return f"{picture.parent.name}/{picture.stem}"

    def annotation(self, index: int) -> Annotation:
        """Return the annotation of a picture, with the picture's own size where the file has none.

        Raises BadAnnotation: the file cannot be read.
        """
        annotation = read_annotation(self.pictures[index].with_suffix(".json"))
        if annotation.width > 0 and annotation.height > 0:
            return annotation
        height, width = self.picture(index, halved=False).shape[:2]
        return replace(annotation, width=width, height=height)

    def picture(self, index: int, halved: bool) -> UInt8:
        """RGB picture (h, w, 3), at half size where `halved`."""
        return _read(self.pictures[index], halved)


class _FrameBatches(Dataset[tuple[Tensor, ...]]):
    """A number of batches of frames, each drawn from the seed and its number alone."""

    def __init__(
        self, frames: FrameFolder, batch: int, seed: int, steps: int, augment: bool = True
    ) -> None:
        self.frames, self.batch, self.seed, self.steps, self.augment = (
            frames,
            batch,
            seed,
            steps,
            augment,
        )

    def __len__(self) -> int:
        return self.steps


def move_boxes(boxes: Float64, size: float, shift: Float64) -> Float64:
    """Boxes x, y, w, h (n, 4) after the picture was scaled and then moved; they end at the outer sides of pixels."""
    return np.hstack([(boxes[:, :2] - 0.5) * size + shift + 0.5, boxes[:, 2:] * size])


def cut_boxes(boxes: Float64, width: int, height: int) -> Float64:
    """Return the parts of boxes x, y, w, h (n, 4) that lie in a picture."""
    limits = np.array([width, height], np.float64)
    low, high = (
        np.clip(boxes[:, :2], 0.0, limits),
        np.clip(boxes[:, :2] + boxes[:, 2:], 0.0, limits),
    )
    return np.hstack([low, high - low])


class DopeBatches(_FrameBatches):
    """Batches for the full network: normalised pictures (n, 3, 400, 400), belief and affinity maps."""

    def __getitem__(self, step: int) -> tuple[Tensor, ...]:
        cv2.setNumThreads(1)
        rng = np.random.default_rng((self.seed, step, 2))
        samples = [self._sample(int(i), rng) for i in _indices(self, rng, step)]
        return tuple(torch.from_numpy(np.stack(part)) for part in zip(*samples, strict=True))

    def _sample(self, index: int, rng: np.random.Generator) -> Sample:
        """Return a square cut at a random place and angle, as DOPE's crop and rotation augmentations do."""
        # side of the square pictures on which the full network learns [px]; its maps are 50 x 50 then
        annotation, side = self.frames.annotation(index), 400
        picture = self.frames.picture(index, halved=False)
        height, width = picture.shape[:2]
        angle = rng.uniform(-0.5, 0.5) * np.pi if self.augment else 0.0
        size = side / height * (rng.uniform(0.8, 1.4) if self.augment else 1.0)
        place = np.array(
            [rng.uniform(0.3, 0.7) * width if self.augment else 0.5 * width, 0.5 * height]
        )
        turn = size * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        matrix = np.column_stack([turn, 0.5 * (side - 1) - turn @ place])
        picture = cv2.warpAffine(picture, matrix, (side, side), flags=cv2.INTER_LINEAR)
        if self.augment:
            picture = change_look(np.asarray(picture, np.uint8), rng)
        keypoints = np.array([item.keypoints for item in annotation.objects]).reshape(-1, 9, 2)
        cells = (keypoints @ turn.T + matrix[:, 2] + 0.5) / STRIDE - 0.5
        visibility = np.array([item.visibility for item in annotation.objects])
        normal = ((picture / 255.0 - np.array(IMAGENET_MEAN)) / np.array(IMAGENET_STD)).astype(
            np.float32
        )
        belief, affinity = dope_targets(cells, visibility, side // STRIDE, side // STRIDE)
        return np.ascontiguousarray(normal.transpose(2, 0, 1)), belief, affinity


class CloseLookBatches(Dataset[tuple[Tensor, ...]]):
    """Batches for the second look.

    Each holds pictures (n, 96, 96, 3) uint8; targets (n, 6): centroid and log size in half sides, stem axis in the
    frame of the ray; kind (n,) with 1 fruit and 0 not fruit; and visibility (n,). `places` are where the finder sees
    fruit; `turned` is the ratio of looks that are turned by any angle about their axis.
    """

    def __init__(
        self,
        frames: FrameFolder,
        batch: int,
        seed: int,
        steps: int,
        augment: bool = True,
        places: Mapping[str, Float64] | None = None,
        turned: float = 0.0,
    ) -> None:
        self.frames, self.batch, self.seed, self.steps, self.augment = (
            frames,
            batch,
            seed,
            steps,
            augment,
        )
        self.places, self.turned = places or {}, turned

    def __len__(self) -> int:
        return self.steps

    def __getitem__(self, step: int) -> tuple[Tensor, ...]:
        cv2.setNumThreads(1)
        rng = np.random.default_rng((self.seed, step, 1))
        samples: list[Sample] = []
        while len(samples) < self.batch:
            samples += self._samples(int(rng.integers(len(self.frames))), rng)
        chosen = samples[: self.batch]
        return tuple(torch.from_numpy(np.stack(part)) for part in zip(*chosen, strict=True))

    def _samples(self, index: int, rng: np.random.Generator) -> list[Sample]:
        annotation, picture = (
            self.frames.annotation(index),
            self.frames.picture(index, halved=False),
        )
        if min(annotation.camera[:2]) <= 0.0:
            path = self.frames.pictures[index].with_suffix(".json")
            raise BadAnnotation(
                path, "names no camera: the close look needs fx, fy, cx and cy [px]"
            )
        K = annotation.K
        seen = [item for item in annotation.objects if item.visibility >= 0.12]
        samples = []
        for item in seen:
            if item.visibility < 0.25 or max(item.box or (0, 0, 1, 1)) < 1:
                continue
            size = K[0, 0] * item.scale * REFERENCE_LENGTH / item.T_camera_object[2, 3]
            for _ in range(1 if item.visibility < 0.5 else 2):
                # A further look is aimed by the one before it, three times as well as the first by the finder.
                doubt = 1.0 if rng.random() < 0.7 else 0.35
                centre = item.keypoints[8] + rng.normal(0.0, 0.06 * doubt, 2) * size
                look = look_at(
                    K, centre, size * np.exp(rng.normal(0.0, 0.13 * doubt)), self._roll(rng)
                )
                target = look.label(item.T_camera_object, item.scale).astype(np.float32)
                samples.append(
                    look_sample(picture, look, target, 1.0, item.visibility, rng, self.augment)
                )
        for place, size in self._elsewhere(annotation, seen, self.frames.name(index), rng):
            inside = (place > -0.3 * size).all() and (
                place < np.array([annotation.width, annotation.height]) + 0.3 * size
            ).all()
            if inside and all(
                not _on_fruit(place, size, item.keypoints) for item in annotation.objects
            ):
                look = look_at(K, place, size, self._roll(rng))
                samples.append(
                    look_sample(picture, look, np.zeros(6, np.float32), 0.0, 0.0, rng, self.augment)
                )
        return samples

    def _roll(self, rng: np.random.Generator) -> float:
        return roll_of_look(self.turned, rng) if self.augment else 0.0

    def _elsewhere(
        self,
        annotation: Annotation,
        seen: list[AnnotatedObject],
        name: str,
        rng: np.random.Generator,
    ) -> list[tuple[Float64, float]]:
        """Return aims of looks beside fruit: false places of the finder, decoys, near fruit, anywhere."""
        wrong = [(row[:2], float(row[2])) for row in self.places.get(name, np.empty((0, 4)))]
        decoys = [
            annotation.decoys[k]
            for k in rng.permutation(len(annotation.decoys))[: 2 if wrong else 4]
        ]
        wrong += [(np.array([u, v]), max(r, 8.0) * rng.uniform(0.9, 1.6)) for u, v, r in decoys]
        if rng.random() < 0.4:
            place = rng.uniform((0.0, 0.0), (annotation.width, annotation.height))
            wrong.append((place, np.exp(rng.uniform(np.log(18.0), np.log(110.0)))))
        if seen:  # beside a fruit is not on it
            item = seen[int(rng.integers(len(seen)))]
            size, angle = keypoint_size(item.keypoints), rng.uniform(0.0, 2.0 * np.pi)
            away = rng.uniform(0.55, 1.3) * size * np.array([np.cos(angle), np.sin(angle)])
            wrong.append((item.keypoints[8] + away, size * np.exp(rng.normal(0.0, 0.4))))
        return wrong


def roll_of_look(turned: float, rng: np.random.Generator) -> float:
    """How far a look is turned about its axis [rad]; the label turns with it exactly.

    Most fruit is taught as cameras see it; looks turned by any angle, a ratio of `turned`, teach the look of a stem
    besides its usual place.
    """
    if turned > 0.0 and rng.random() < turned:
        return float(rng.uniform(-np.pi, np.pi))
    return float(rng.normal(0.0, np.deg2rad(10.0)))


def look_sample(
    picture: UInt8,
    look: VirtualCamera,
    target: NDArray[np.float32],
    kind: float,
    visibility: float,
    rng: np.random.Generator,
    augment: bool,
) -> Sample:
    """One look: view, target (6,), kind, visibility."""
    colour = (
        [int(c) for c in rng.integers(0, 256, 3)] if augment and rng.random() < 0.3 else [0, 0, 0]
    )
    flags, side = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, (CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
    view = np.asarray(
        cv2.warpPerspective(picture, look.picture_from_look, side, flags=flags, borderValue=colour),
        np.uint8,
    )
    if augment and rng.random() < 0.5:
        view = np.ascontiguousarray(view[:, ::-1])
        target[[0, 3]] *= -1.0
    if augment:
        view = cover(change_look(view, rng), rng, 0.08, (0.08, 0.35))
    return view, target, np.asarray(np.float32(kind)), np.asarray(np.float32(visibility))


def _on_fruit(place: Float64, size: float, keypoints: Float64) -> bool:
    """Return True for a place and size so near a fruit that it is no negative."""
    own = keypoint_size(keypoints)
    return (
        bool(np.linalg.norm(place - keypoints[8]) < 0.5 * max(own, 0.6 * size)) and own < 2.5 * size
    )


def _indices(batches: _FrameBatches, rng: np.random.Generator, step: int) -> NDArray[np.int64]:
    if not batches.augment:
        return (np.arange(batches.batch) + step * batches.batch) % len(batches.frames)
    return rng.integers(0, len(batches.frames), batches.batch)


def _picture_of(annotation: Path) -> Path | None:
    return next((p for s in (".jpg", ".png") if (p := annotation.with_suffix(s)).is_file()), None)


def _read(path: Path, halved: bool) -> UInt8:
    try:
        return read_picture(path, as_taken=True, halved=halved)
    except UnusablePicture as error:
        raise BadTraining(f"{path} {error}") from error
