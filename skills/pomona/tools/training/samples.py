"""Training batches from a folder of annotated frames; batch k is a function of (seed, k) alone."""

from __future__ import annotations

from collections.abc import Mapping
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
from pomona.tools.training.annotations import (
    AnnotatedObject,
    Annotation,
    BadTraining,
    read_annotation,
)
from pomona.tools.training.augmentation import change_look, cover

Sample = tuple[NDArray[np.generic], ...]


class FrameFolder:
    """Pictures and annotations of one or more data folders, found once."""

    def __init__(self, folders: list[Path]) -> None:
        self.pictures = [
            picture
            for folder in folders
            for annotation in sorted(folder.glob("*.json"))
            if (picture := annotation.with_suffix(".jpg")).is_file()
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
        """Return the annotation of a picture. Raises BadTraining: the file cannot be read."""
        return read_annotation(self.pictures[index].with_suffix(".json"))

    def picture(self, index: int) -> UInt8:
        """RGB picture (h, w, 3). Raises BadTraining: the file cannot be read."""
        path = self.pictures[index]
        try:
            return read_picture(path, as_taken=True)
        except UnusablePicture as error:
            raise BadTraining(f"{path} {error}") from error


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
        self.frames = frames
        self.batch = batch
        self.seed = seed
        self.steps = steps
        self.augment = augment
        self.places = places or {}
        self.turned = turned

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
        annotation = self.frames.annotation(index)
        picture = self.frames.picture(index)
        K = annotation.K
        seen = [item for item in annotation.objects if item.visibility >= 0.12]
        samples = []
        for item in seen:
            if item.visibility < 0.25:
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
            size = keypoint_size(item.keypoints)
            angle = rng.uniform(0.0, 2.0 * np.pi)
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
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    side = (CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
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
