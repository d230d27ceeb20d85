"""Fits one score for photographs and rendered frames, from places with known labels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.places import iou
from pomona.skills.perception.detection.weights_file import FEATURES, LARGEST, FusedScore
from pomona.tools.photographs.box_evaluation import match_boxes
from pomona.tools.photographs.photographs import Photograph
from pomona.tools.training.photo_figures import searching
from pomona.tools.training.samples import FrameFolder

NETS, UNITS = 3, 8
"""Nets whose logits are averaged, and tanh units of each; in a probe neither one net nor four units changed figures."""

STEPS, RATE, DECAY = 300, 0.03, 1e-3
"""Full-batch steps of Adam, their first rate, which falls to zero, and the weight decay."""

SAME, OTHER = 0.5, 0.15
"""A place is fruit with at least this intersection over union, none with less than the second, and doubtful between."""


@dataclass(frozen=True, slots=True, eq=False)
class JudgedPlaces:
    """Places of one domain."""

    features: Float64  # logits, (n, 4)
    right: NDArray[np.bool_]  # which are fruit, (n,)


def photo_places(
    detector: CompactDetector,
    photographs: Sequence[Photograph],
    progress: Callable[[int, int], None] | None = None,
) -> JudgedPlaces:
    """Return places in photographs at their own scale; every place without a label counts as no fruit."""

    def judged() -> Iterator[tuple[Float64, NDArray[np.bool_]]]:
        for number, photo in enumerate(photographs):
            # least score of the finder's own for a place to be fitted on
            places, _, features = searching(detector, photo, 0.2).look(
                photo.picture(), photo.K, 0.0
            )
            boxes = np.array([place.box for place in places]).reshape(-1, 4)
            yield (
                features,
                match_boxes(boxes, np.array([place.score for place in places]), photo.boxes, SAME),
            )
            if progress is not None:
                progress(number + 1, len(photographs))

    return _joined(judged())


def frame_places(
    detector: CompactDetector,
    frames: FrameFolder,
    progress: Callable[[int, int], None] | None = None,
) -> JudgedPlaces:
    """Return places in rendered frames; those that overlap a fruit a little are left out."""

    def judged() -> Iterator[tuple[Float64, NDArray[np.bool_]]]:
        for index in range(len(frames)):
            annotation, picture = frames.annotation(index), frames.picture(index, halved=False)
            places, _, features = detector.look(picture, annotation.K, 0.0)
            boxes = np.array([place.box for place in places]).reshape(-1, 4)
            fruit = np.array(
                [item.box for item in annotation.objects if item.box], np.float64
            ).reshape(-1, 4)
            best = iou(boxes, fruit).max(axis=1, initial=0.0)
            clear = (best >= SAME) | (best < OTHER)
            yield features[clear], best[clear] >= SAME
            if progress is not None:
                progress(index + 1, len(frames))

    return _joined(judged())


def _joined(parts: Iterator[tuple[Float64, NDArray[np.bool_]]]) -> JudgedPlaces:
    features, right = [np.empty((0, FEATURES))], [np.empty(0, np.bool_)]
    for some, which in parts:
        features.append(some)
        right.append(which)
    return JudgedPlaces(np.concatenate(features), np.concatenate(right))


def fit_score(domains: Sequence[JudgedPlaces], seed: int = 0) -> FusedScore | None:
    """Return the score of largest likelihood; domains count the same, whatever their number of places.

    Returns:
        None where a domain has fewer than ten places, or all of them are fruit or none.
    """
    if not domains or any(len(d.right) < 10 or d.right.all() or not d.right.any() for d in domains):
        return None
    x = np.clip(np.concatenate([domain.features for domain in domains]), -LARGEST, LARGEST)
    y = np.concatenate([domain.right for domain in domains]).astype(np.float64)
    w = np.concatenate([np.full(len(d.right), 1.0 / len(d.right)) for d in domains]) / len(domains)
    mean, spread = w @ x, np.sqrt(np.maximum(w @ (x - w @ x) ** 2, 1e-6))
    z = np.column_stack([(x - mean) / spread, np.ones(len(x))])
    nets = [_fit_net(z, y, w, np.random.default_rng((seed, net))) for net in range(NETS)]
    hidden = np.concatenate([net[0] for net in nets])
    # The net reads logits as they are: their mean and spread go into weights and biases.
    scaled = hidden[:, :FEATURES] / spread
    bias = hidden[:, FEATURES] - scaled @ mean
    output = (
        np.concatenate([*(net[1][:-1] for net in nets), [sum(net[1][-1] for net in nets)]]) / NETS
    )
    return FusedScore(np.column_stack([scaled, bias]), output)


def _fit_net(
    z: Float64, y: Float64, w: Float64, rng: np.random.Generator
) -> tuple[Float64, Float64]:
    """Return weights (units, 5) and (units + 1,) of one net, by Adam on the weighted cross entropy."""
    hidden, output = rng.normal(0.0, 0.5, (UNITS, FEATURES + 1)), rng.normal(0.0, 0.3, UNITS + 1)
    parts = [hidden, output]
    first, second = [np.zeros_like(part) for part in parts], [np.zeros_like(part) for part in parts]
    for step in range(STEPS):
        units = np.tanh(z @ hidden.T)
        wide = np.column_stack([units, np.ones(len(z))])
        error = w * (1.0 / (1.0 + np.exp(-(wide @ output))) - y)
        back = error[:, None] * output[:-1] * (1.0 - units**2)
        gradients = [
            back.T @ z + DECAY * hidden / len(hidden),
            wide.T @ error + DECAY * output / len(hidden),
        ]
        rate = RATE * (1.0 - step / STEPS)
        for part, gradient, mean, square in zip(parts, gradients, first, second, strict=True):
            mean += 0.1 * (gradient - mean)
            square += 0.001 * (gradient**2 - square)
            part -= (
                rate
                * (mean / (1.0 - 0.9 ** (step + 1)))
                / (np.sqrt(square / (1.0 - 0.999 ** (step + 1))) + 1e-8)
            )
    return hidden, output
