"""Figures of detections against known truth: recall, precision, keypoints, direction, orientation, ADD."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.close_look import keypoint_size
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.instances import Instance, find_instances
from pomona.skills.perception.fruit import FruitModel
from pomona.tools.training.annotations import AnnotatedObject, Annotation

SAME = 0.5  # a detection is of a fruit when its centroid is within this part of the fruit's keypoint size
CLEARLY_VISIBLE = 0.6
HIGH_RECALL = 0.99  # whose score a table names
LEAST_VISIBLE = 0.02  # fruit of which less is visible is not asked for
CLOSE = 10.0  # mean distance of the model's points up to which a pose counts as right [mm]


class Frames(Protocol):
    """Annotated frames by number."""

    def __len__(self) -> int: ...
    def annotation(self, index: int) -> Annotation:
        """Return the annotation of a frame."""

    def picture(self, index: int) -> UInt8:
        """Return the picture of a frame, (h, w, 3) uint8 RGB."""


@dataclass(frozen=True, slots=True)
class Match:
    """One fruit that was found.

    Attributes:
        visibility: of the fruit.
        corner: mean error of the eight corners [px].
        centroid: error of the centroid [px].
        direction: angle between the solved and the true direction to the centre [deg]; NaN without a pose.
        axis: angle between the solved and the true stem axis [deg]; NaN without a pose.
        add: mean distance of the model's points [mm], for CAD-sized fruit; NaN for others.
    """

    visibility: float
    score: float
    corner: float
    centroid: float
    direction: float
    axis: float
    add: float


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Outcome over many frames."""

    frames: int
    matches: tuple[Match, ...]  # fruit that were found, however visible
    fruit: tuple[float, ...]  # visibility of every fruit with any visible pixel, found or not
    wrong: tuple[float, ...]  # scores of detections of no fruit
    seconds: tuple[float, ...]  # time of each frame's detection, poses included

    def recall(self, score: float, least: float = CLEARLY_VISIBLE) -> float:
        """Part of the fruit at least `least` visible that was found with at least `score`."""
        wanted = sum(visibility >= least for visibility in self.fruit)
        found = sum(m.visibility >= least and m.score >= score for m in self.matches)
        return found / max(1, wanted)

    def score_for(self, recall: float) -> float | None:
        """Return the highest score with which a recall is still reached; None where it is reached with none."""
        scores = sorted(m.score for m in self.matches if m.visibility >= CLEARLY_VISIBLE)
        return next((score for score in reversed(scores) if self.recall(score) >= recall), None)

    def precision(self, score: float) -> float:
        """Part of the detections with at least `score` that are fruit, however visible."""
        right = sum(m.score >= score for m in self.matches)
        return right / max(1, right + sum(s >= score for s in self.wrong))


def evaluate(
    detector: CompactDetector,
    frames: Frames,
    fruit: FruitModel,
    count: int,
    progress: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Detect in the first `count` frames and compare with their annotations."""
    matches: list[Match] = []
    everything: list[float] = []
    wrong: list[float] = []
    seconds: list[float] = []
    count = min(count, len(frames))
    for index in range(count):
        annotation = frames.annotation(index)
        colour = frames.picture(index)
        start = time.perf_counter()
        instances = find_instances(detector, colour, annotation.K, fruit)
        seconds.append(time.perf_counter() - start)
        seen = [item for item in annotation.objects if item.visibility > LEAST_VISIBLE]
        everything += [item.visibility for item in seen]
        pairs, missed = pair(instances, seen)
        wrong += [instances[k].score for k in missed]
        matches += [compare(instances[a], seen[b], fruit) for a, b in pairs]
        if progress is not None:
            progress(index + 1, count)
    return Evaluation(count, tuple(matches), tuple(everything), tuple(wrong), tuple(seconds))


def pair(
    instances: list[Instance], objects: list[AnnotatedObject]
) -> tuple[list[tuple[int, int]], list[int]]:
    """Return detections and the fruit they are of, each used once, surest first; and detections of nothing."""
    free = set(range(len(objects)))
    pairs = []
    nothing = []
    for k in sorted(range(len(instances)), key=lambda i: -instances[i].score):
        centroid = instances[k].keypoints[8]
        away = {b: float(np.linalg.norm(centroid - objects[b].keypoints[8])) for b in free}
        near = [b for b in free if away[b] < SAME * keypoint_size(objects[b].keypoints)]
        if near:
            b = min(near, key=lambda one: away[one])
            free.discard(b)
            pairs.append((k, b))
        else:
            nothing.append(k)
    return pairs, nothing


def compare(found: Instance, truth: AnnotatedObject, fruit: FruitModel) -> Match:
    """Return errors of one detection."""
    errors = np.linalg.norm(found.keypoints - truth.keypoints, axis=1)
    T = found.T_camera_object
    T_true = truth.T_camera_object
    direction = axis = add = float("nan")
    if T is not None:
        direction = _angle(T[:3, 3], T_true[:3, 3])
        axis = _angle(T[:3, 1], T_true[:3, 1])
        if np.allclose(truth.dimensions, fruit.dimensions, rtol=0.01):
            points = fruit.vertices[:: max(1, len(fruit.vertices) // 500)]
            away = points @ (T[:3, :3] - T_true[:3, :3]).T + T[:3, 3] - T_true[:3, 3]
            add = 1e3 * float(np.linalg.norm(away, axis=1).mean())
    corner = float(errors[:8].mean())
    centroid = float(errors[8])
    return Match(truth.visibility, found.score, corner, centroid, direction, axis, add)


def table(result: Evaluation, score: float = 0.6) -> str:
    """Return Markdown: recall and precision by threshold, errors by visibility."""
    lines = ["| score at least | recall (≥ 60 % visible) | precision |", "|---|---|---|"]
    high = result.score_for(HIGH_RECALL)
    for threshold in (0.3, 0.5, 0.6, 0.7, 0.8, 0.9, *([] if high is None else [round(high, 3)])):
        recall = result.recall(threshold)
        precision = result.precision(threshold)
        lines.append(f"| {threshold} | {recall:.4f} | {precision:.4f} |")
    lines += [
        "",
        f"Errors of detections with score ≥ {score}: median / 90th percentile.",
        "",
        "| visible | found | keypoints px | centroid px | direction ° | axis ° | ADD mm | ADD < 10 mm |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for low, high in ((0.6, 1.01), (0.85, 1.01), (0.6, 0.85), (0.4, 0.6), (0.2, 0.4)):
        some = [m for m in result.matches if m.score >= score and low <= m.visibility < high]
        lines.append(_row(f"{100 * low:.0f}–{min(100, 100 * high):.0f} %", some))
    return "\n".join(lines)


def _row(name: str, matches: Sequence[Match]) -> str:
    adds = np.array([m.add for m in matches if np.isfinite(m.add)])
    good = f"{(adds < CLOSE).mean():.3f} of {len(adds)}" if len(adds) else ""
    cells = [
        _spread([m.corner for m in matches], 1),
        _spread([m.centroid for m in matches], 2),
        _spread([m.direction for m in matches], 3),
        _spread([m.axis for m in matches], 1),
        _spread(adds.tolist(), 1),
    ]
    return f"| {name} | {len(matches)} | {' | '.join(cells)} | {good} |"


def _spread(values: Sequence[float], digits: int) -> str:
    finite = [value for value in values if np.isfinite(value)]
    if not finite:
        return ""
    return f"{np.median(finite):.{digits}f} / {np.quantile(finite, 0.9):.{digits}f}"


def _angle(a: Float64, b: Float64) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
