"""Figures of detections against known truth: recall, precision, keypoints, direction, orientation, ADD."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.close_look import keypoint_size
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.instances import Instance, find_instances
from pomona.skills.perception.fruit import FruitModel
from pomona.tools.photographs.box_evaluation import BoxCurve
from pomona.tools.training.annotations import AnnotatedObject, Annotation
from pomona.tools.training.pose_calibration import PoseErrors, pose_calibration_table, pose_errors

SAME = 0.5  # a detection is of a fruit when its centroid is within this part of the fruit's keypoint size
CLEARLY_VISIBLE = 0.6

END_IN_SIGHT = 20.0
"""Stem or calyx is turned to the camera when the axis is at least this far out of the picture's plane [deg]."""


class Frames(Protocol):
    """Annotated frames by number."""

    def __len__(self) -> int: ...
    def annotation(self, index: int) -> Annotation:
        """Return the annotation of a frame."""

    def picture(self, index: int, halved: bool) -> UInt8:
        """Return the picture of a frame, (h, w, 3) uint8 RGB, at half its size if asked for."""


@dataclass(frozen=True, slots=True)
class Match:
    """One fruit that was found.

    Attributes:
        visibility, distance [m], size: of the fruit; size is its keypoint size [px].
        scene: kind of scene.
        corner: mean error of the eight corners [px].
        centroid: error of the centroid [px].
        direction: angle between the solved and the true direction to the centre [deg]; NaN without a pose.
        axis: angle between the solved and the true stem axis [deg]; NaN without a pose.
        add: mean distance of the model's points [mm], for CAD-sized fruit; NaN for others.
        depth: relative error of the distance for CAD-sized fruit; NaN for others.
        turned: angle between the true stem axis and the plane across the line of sight [deg]; at 0 both ends are seen
            alike from the side, at 90 one of them faces the camera.
        errors: of the pose, in units of its covariance; None without a pose.
    """

    visibility: float
    distance: float
    size: float
    scene: str
    score: float
    corner: float
    centroid: float
    direction: float
    axis: float
    add: float
    depth: float
    turned: float
    errors: PoseErrors | None


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Outcome over many frames.

    Attributes:
        frames: how many.
        matches: fruit that were found, however visible.
        fruit: visibility, distance, size and scene of every fruit with any visible pixel, found or not.
        wrong: scores of detections of no fruit.
        seconds: time of each frame's detection, poses included.
    """

    frames: int
    matches: tuple[Match, ...]
    fruit: tuple[tuple[float, float, float, str], ...]
    wrong: tuple[float, ...]
    seconds: tuple[float, ...]

    def recall(self, score: float, least: float = CLEARLY_VISIBLE) -> float:
        """Part of the fruit at least `least` visible that was found with at least `score`."""
        wanted = sum(visibility >= least for visibility, *_ in self.fruit)
        return sum(m.visibility >= least and m.score >= score for m in self.matches) / max(
            1, wanted
        )

    def score_for(self, recall: float, least: float = CLEARLY_VISIBLE) -> float | None:
        """Return the highest score with which `recall` is still reached; None where it is reached with none."""
        wanted = sum(visibility >= least for visibility, *_ in self.fruit)
        scores = sorted((m.score for m in self.matches if m.visibility >= least), reverse=True)
        needed = max(1, math.ceil(recall * wanted - 1e-9))
        return scores[needed - 1] if needed <= len(scores) else None

    def judged(self) -> tuple[Float64, NDArray[np.bool_]]:
        """Return scores of all detections, and which are of a fruit of any visibility; (n,) each."""
        scores = np.array([*(match.score for match in self.matches), *self.wrong], np.float64)
        return scores, np.arange(len(scores)) < len(self.matches)

    def curve(self, least: float = CLEARLY_VISIBLE) -> BoxCurve:
        """Precision over all detections, recall of the fruit at least `least` visible."""
        scores, right = self.judged()
        order = np.argsort(-scores, kind="stable")
        clear = np.array(
            [*(match.visibility >= least for match in self.matches), *(False for _ in self.wrong)],
            bool,
        )
        wanted = sum(visibility >= least for visibility, *_ in self.fruit)
        counts = np.maximum(1, np.arange(1, len(scores) + 1))
        return BoxCurve(
            scores[order],
            np.cumsum(right[order]) / counts,
            np.cumsum(clear[order]) / max(1, wanted),
            wanted,
        )

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
    everything: list[tuple[float, float, float, str]] = []
    wrong: list[float] = []
    seconds: list[float] = []
    count = min(count, len(frames))
    for index in range(count):
        annotation, colour = frames.annotation(index), frames.picture(index, halved=False)
        start = time.perf_counter()
        instances = find_instances(detector, colour, annotation.K, fruit)
        seconds.append(time.perf_counter() - start)
        seen = [item for item in annotation.objects if item.visibility > 0.02]
        everything += [
            (i.visibility, _distance(i), keypoint_size(i.keypoints), annotation.scene) for i in seen
        ]
        pairs, missed = pair(instances, seen)
        wrong += [instances[k].score for k in missed]
        matches += [compare(instances[a], seen[b], fruit, annotation.scene) for a, b in pairs]
        if progress is not None:
            progress(index + 1, count)
    return Evaluation(count, tuple(matches), tuple(everything), tuple(wrong), tuple(seconds))


def pair(
    instances: list[Instance], objects: list[AnnotatedObject]
) -> tuple[list[tuple[int, int]], list[int]]:
    """Return detections and the fruit they are of, each used once, surest first; and detections of nothing."""
    free, pairs, nothing = set(range(len(objects))), [], []
    for k in sorted(range(len(instances)), key=lambda i: -instances[i].score):
        near = [
            (float(np.linalg.norm(instances[k].keypoints[8] - objects[b].keypoints[8])), b)
            for b in free
            if np.linalg.norm(instances[k].keypoints[8] - objects[b].keypoints[8])
            < SAME * keypoint_size(objects[b].keypoints)
        ]
        if near:
            _, b = min(near)
            free.discard(b)
            pairs.append((k, b))
        else:
            nothing.append(k)
    return pairs, nothing


def compare(found: Instance, truth: AnnotatedObject, fruit: FruitModel, scene: str) -> Match:
    """Return errors of one detection."""
    errors = np.linalg.norm(found.keypoints - truth.keypoints, axis=1)
    T, T_true = found.T_camera_object, truth.T_camera_object
    direction = axis = add = depth = float("nan")
    if T is not None:
        direction, axis = _angle(T[:3, 3], T_true[:3, 3]), _angle(T[:3, 1], T_true[:3, 1])
        if truth.dimensions is not None and np.allclose(
            truth.dimensions, fruit.dimensions, rtol=0.01
        ):
            points = fruit.vertices[:: max(1, len(fruit.vertices) // 500)]
            away = points @ (T[:3, :3] - T_true[:3, :3]).T + T[:3, 3] - T_true[:3, 3]
            add = 1e3 * float(np.linalg.norm(away, axis=1).mean())
            depth = float(T[2, 3] / T_true[2, 3] - 1.0)
    return Match(
        truth.visibility,
        _distance(truth),
        keypoint_size(truth.keypoints),
        scene,
        found.score,
        float(errors[:8].mean()),
        float(errors[8]),
        direction,
        axis,
        add,
        depth,
        abs(90.0 - _angle(T_true[:3, 1], T_true[:3, 3])),
        pose_errors(found, truth),
    )


def table(result: Evaluation, score: float = 0.6, brief: bool = False) -> str:
    """Return Markdown: recall and precision by threshold, errors by visibility, distance, size and scene.

    And how often the poses' ellipsoids hold the truth.

    `brief` stops after the errors by visibility.
    """
    lines = ["| score at least | recall (≥ 60 % visible) | precision |", "|---|---|---|"]
    for threshold in (0.3, 0.5, 0.6, 0.7, 0.8, 0.9):
        lines.append(
            f"| {threshold} | {result.recall(threshold):.4f} | {result.precision(threshold):.4f} |"
        )
    if (least := result.score_for(0.99)) is not None:
        lines.append(
            f"| {least:.3f} | {result.recall(least):.4f} | {result.precision(least):.4f} |"
        )
    sure = [m for m in result.matches if m.score >= score]
    clear = [m for m in sure if m.visibility >= CLEARLY_VISIBLE]
    lines += [
        "",
        f"Errors of detections with score ≥ {score}: median / 90th percentile.",
        "",
        "| fruit | found | keypoints px | keypoints % | centroid px | direction ° | axis ° | ADD mm | ADD < 10 mm |",
        "|---|---|---|---|---|---|---|---|---|",
        _row("≥ 60 % visible", clear),
    ]
    for low, high in ((0.85, 1.01), (0.6, 0.85), (0.4, 0.6), (0.2, 0.4)):
        lines.append(
            _row(
                f"{100 * low:.0f}–{min(100, 100 * high):.0f} % visible",
                _only(sure, "visibility", low, high),
            )
        )
    if brief:
        return "\n".join(lines)
    in_sight = [m for m in clear if m.turned >= END_IN_SIGHT]
    lines.append(
        _row(f"clear, stem or calyx at least {END_IN_SIGHT:.0f}° towards the camera", in_sight)
    )
    lines.append(_row("clear, seen from the side", [m for m in clear if m.turned < END_IN_SIGHT]))
    for low, high in ((0.2, 0.45), (0.45, 0.65), (0.65, 0.85), (0.85, 2.0)):
        lines.append(_row(f"clear, at {low}–{high} m", _only(clear, "distance", low, high)))
    for low, high in ((0.0, 40.0), (40.0, 60.0), (60.0, 80.0), (80.0, 1e3)):
        lines.append(_row(f"clear, size {low:.0f}–{high:.0f} px", _only(clear, "size", low, high)))
    for scene in sorted({m.scene for m in clear}):
        lines.append(_row(f"clear, scene {scene}", [m for m in clear if m.scene == scene]))
    lines += [
        "",
        "Turned over, calyx for stem (axis more than 90° off), clear fruit by how its axis lies:",
        "",
    ]
    lines += ["| axis out of the picture's plane | fruit | turned over |", "|---|---|---|"]
    for low, high in ((0.0, 10.0), (10.0, 20.0), (20.0, 40.0), (40.0, 60.0), (60.0, 90.1)):
        some = _only(clear, "turned", low, high)
        share = f"{np.mean([m.axis > 90.0 for m in some]):.3f}" if some else ""
        lines.append(f"| {low:.0f}–{high:.0f}° | {len(some)} | {share} |")
    lines += ["", "Truths inside the ellipsoids of 50 % and of 90 % of the poses' covariance:", ""]
    lines.append(pose_calibration_table(_by_visibility(sure)))
    return "\n".join(lines)


def _by_visibility(matches: list[Match]) -> dict[str, list[PoseErrors]]:
    groups = {
        "all": matches,
        "≥ 60 % visible": [m for m in matches if m.visibility >= CLEARLY_VISIBLE],
    }
    for low, high in ((0.85, 1.01), (0.6, 0.85), (0.4, 0.6), (0.0, 0.4)):
        groups[f"{100 * low:.0f}–{min(100, 100 * high):.0f} % visible"] = _only(
            matches, "visibility", low, high
        )
    return {name: [m.errors for m in some if m.errors is not None] for name, some in groups.items()}


def _only(matches: Iterable[Match], key: str, low: float, high: float) -> list[Match]:
    return [m for m in matches if low <= getattr(m, key) < high]


def _row(name: str, matches: list[Match]) -> str:
    if not matches:
        return f"| {name} | 0 | | | | | | | |"
    share = [100.0 * m.corner / m.size for m in matches]
    adds = np.array([m.add for m in matches if np.isfinite(m.add)])
    good = f"{(adds < 10.0).mean():.3f} of {len(adds)}" if len(adds) else ""
    cells = [
        _pair([m.corner for m in matches], 1),
        _pair(share, 1),
        _pair([m.centroid for m in matches], 2),
        _pair([m.direction for m in matches], 3),
        _pair([m.axis for m in matches], 1),
        _pair(adds.tolist(), 1),
    ]
    return f"| {name} | {len(matches)} | {' | '.join(cells)} | {good} |"


def _pair(values: list[float], digits: int) -> str:
    finite = np.array([v for v in values if np.isfinite(v)])
    if not len(finite):
        return ""
    return f"{np.median(finite):.{digits}f} / {np.quantile(finite, 0.9):.{digits}f}"


def _angle(a: Float64, b: Float64) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def _distance(item: AnnotatedObject) -> float:
    return float(np.linalg.norm(item.T_camera_object[:3, 3]))
