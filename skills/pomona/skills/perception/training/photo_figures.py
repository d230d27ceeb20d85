"""How well photographs are searched, measured against the boxes that people drew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.box_evaluation import BoxCurve, curve, match_boxes
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.compact_network import CloseLookNetwork, FinderNetwork
from pomona.skills.perception.detection.found_fruit import inside
from pomona.skills.perception.detection.torch_engine import torch_detector
from pomona.skills.perception.training.photographs import Photograph

Finds = tuple[Float64, Float64, Float64]
"""Of one photograph: boxes that were found (n, 4), their scores (n,), boxes that people drew (m, 4)."""

PRECISION = 0.9
"""Recall is reported where precision is at least this."""

WATCHED = 36
"""Photographs that are looked at while training goes on, evenly from all of those to measure on."""

LEAST_BELIEF = 0.05
"""Places with less are not looked at: they could only lengthen a curve's tail."""

MOST_FRUIT = 60


def find_boxes(
    detector: CompactDetector,
    photographs: Sequence[Photograph],
    scale: float,
    progress: Callable[[int, int], None] | None = None,
) -> list[Finds]:
    """What the detector finds in each photograph, shrunk by `scale` for the finder."""
    found = []
    for number, photo in enumerate(photographs):
        options = replace(
            detector.options,
            working_width=max(16, round(scale * photo.width)),
            most_fruit=MOST_FRUIT,
            finder_threshold=LEAST_BELIEF,
        )
        fruit = detector.looking(options).find(photo.picture(), photo.K)
        boxes = np.array([f.outline(photo.width, photo.height) for f in fruit]).reshape(-1, 4)
        found.append((boxes, np.array([f.score for f in fruit], np.float64), photo.boxes))
        if progress is not None:
            progress(number + 1, len(photographs))
    return found


def find_places_boxes(finder: CompactDetector, photographs: Sequence[Photograph], scale: float) -> list[Finds]:
    """The same for the finder alone: a fruit's box is its own or a square, its score the finder's belief."""
    found = []
    for photo in photographs:
        searching = finder.looking(replace(finder.options, working_width=max(16, round(scale * photo.width))))
        places = searching.places(photo.picture(), LEAST_BELIEF)
        boxes = [inside(place.outline, photo.width, photo.height) for place in places]
        scores = np.array([place.belief for place in places], np.float64)
        found.append((np.array(boxes).reshape(-1, 4), scores, photo.boxes))
    return found


def figures(found: Sequence[Finds]) -> dict[str, float]:
    """What a training run reports of photographs."""
    half, three_quarters = curve(found), curve(found, 0.75)
    score = half.score_for(PRECISION)
    return {
        "photographs AP": half.average_precision,
        f"recall at precision {PRECISION:.2f}": half.recall_at(PRECISION),
        "from score": float("nan") if score is None else score,
        "AP at IoU 0.75": three_quarters.average_precision,
    }


def watch(
    photographs: Sequence[Photograph], scale: float, finder: FinderNetwork | None
) -> Callable[[nn.Module], dict[str, float]]:
    """Figures of a network in training on some photographs; a close look needs the finder that ships with it."""
    few = list(photographs)[:: max(1, len(photographs) // WATCHED)]

    def of(network: nn.Module) -> dict[str, float]:
        with torch.inference_mode():
            if isinstance(network, FinderNetwork):
                return figures(find_places_boxes(torch_detector(network, CloseLookNetwork()), few, scale))
            assert isinstance(network, CloseLookNetwork)
            assert finder is not None
            return figures(find_boxes(torch_detector(finder, network), few, scale))

    return of


def photo_table(found: Sequence[Finds], score: float) -> str:
    """The figures as Markdown."""
    lines = [
        "| IoU at least | AP | recall at precision 0.90 | from score | recall / precision at score |",
        "|---|---|---|---|---|",
    ]
    for least in (0.5, 0.75):
        result: BoxCurve = curve(found, least)
        from_score = result.score_for(PRECISION)
        recall, precision = result.at_score(score)
        lines.append(
            f"| {least} | {result.average_precision:.3f} | {result.recall_at(PRECISION):.3f} | "
            f"{'never' if from_score is None else f'{from_score:.3f}'} | {recall:.3f} / {precision:.3f} at {score} |"
        )
    return "\n".join(lines)


def calibration(
    scores: Float64, right: NDArray[np.bool_], bins: int = 10
) -> tuple[float, list[tuple[float, float, int]]]:
    """How far scores are from the share of finds that are right: the expected calibration error, and the plot's points.

    Args:
        scores: of finds, 0..1, (n,).
        right: whether each is fruit, (n,).
        bins: of equal width.

    Returns:
        The error: mean over all finds of |mean score - share right| of their bin; and (mean score, share right, count)
        of each bin that is not empty.
    """
    which = np.minimum((scores * bins).astype(int), bins - 1)
    points = [
        (float(scores[inside].mean()), float(right[inside].mean()), int(inside.sum()))
        for k in range(bins)
        if (inside := which == k).any()
    ]
    error = sum(count * abs(score - share) for score, share, count in points) / max(1, len(scores))
    return error, points


def judged(found: Sequence[Finds]) -> tuple[Float64, NDArray[np.bool_]]:
    """Scores of all finds in photographs, and whether each overlaps a box that people drew by half; (n,) each."""
    scores = np.concatenate([np.empty(0), *(sure for _, sure, _ in found)])
    right = [match_boxes(boxes, sure, wanted, 0.5) for boxes, sure, wanted in found]
    return scores, np.concatenate([np.empty(0, np.bool_), *right])


def calibration_table(scores: Float64, right: NDArray[np.bool_], least: float = 0.05) -> str:
    """Scores against the share of such finds that are right, as Markdown."""
    error, points = calibration(scores[scores >= least], right[scores >= least])
    lines = [f"Expected calibration error of finds with score ≥ {least}: {error:.3f}.", ""]
    lines += ["| mean score | share right | finds |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {score:.2f} | {share:.2f} | {count} |" for score, share, count in points)])
