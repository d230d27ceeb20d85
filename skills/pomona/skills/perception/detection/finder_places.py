"""Places of fruit in the finder's maps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from pomona.executive.values.arrays import Float32, Float64
from pomona.skills.perception.detection.box_evaluation import iou
from pomona.skills.perception.detection.close_look import SIZE_OF_BOX
from pomona.skills.perception.detection.errors import BadMaps
from pomona.skills.perception.detection.outputs import FINDER_STRIDE, HEAT, QUALITY, REACHES

LEAST_HEAT = 0.02  # peaks with less heat are not read
MOST_PEAKS = 200  # peaks that are read in a frame, hottest first: adversarial maps must not cost unbounded time
SAME_FRUIT = 0.6  # of two boxes that overlap by at least this intersection over union, the less certain one is dropped


@dataclass(frozen=True, eq=False)
class Proposal:
    """A box in which the finder proposes fruit."""

    box: Float64  # around its visible part, x, y, w, h (4,) [px]
    heat: float  # of the peak, logit
    quality: float  # expected intersection over union of the box, logit

    @cached_property
    def score(self) -> float:
        """Geometric mean of heat and quality, 0..1."""
        return float(1.0 / np.sqrt((1.0 + np.exp(-self.heat)) * (1.0 + np.exp(-self.quality))))

    @property
    def centre(self) -> Float64:
        """Pixel in the middle of the box, (2,): the first look is aimed there, also at fruit that a border cuts.

        Aimed at the whole fruit's middle, looks at cut spheres pass as fruit: 13 false detections in 60 frames, not 8.
        """
        return self.box[:2] + 0.5 * self.box[2:] - 0.5

    @property
    def size(self) -> float:
        """Apparent size of the fruit, as `keypoint_size` has it, from the box's longer side [px]."""
        return SIZE_OF_BOX * float(self.box[2:].max())

    def scaled(self, factor: float) -> Proposal:
        """Return the same place in a picture that is larger by this factor."""
        return Proposal(self.box * factor, self.heat, self.quality)


def read_places(
    maps: Float32, width: float, height: float, threshold: float = 0.0, most: int = MOST_PEAKS
) -> list[Proposal]:
    """Return places in the finder's maps, by falling score.

    Args:
        maps: (6, h, w), rows as named in `outputs`; cells that are not finite hold no fruit.
        width, height: of the picture in the finder's input [px]; boxes are cut there.
        threshold: least score.
        most: peaks that are read, hottest first.

    Raises BadMaps: another number of maps.
    """
    if maps.ndim != 3 or maps.shape[0] != QUALITY + 1:
        raise BadMaps("finder maps (6, h, w)", f"{maps.shape}")
    heat = np.where(np.isfinite(maps).all(axis=0), maps[HEAT], -np.inf).astype(np.float32)
    highest = cv2.dilate(heat, np.ones((3, 3), np.uint8))
    v, u = np.nonzero((heat >= highest) & (heat > np.log(LEAST_HEAT / (1.0 - LEAST_HEAT))))
    order = np.argsort(-heat[v, u], kind="stable")[:most]
    v, u = v[order], u[order]
    reaches = np.exp(np.clip(maps[REACHES, v, u].astype(np.float64), -6.0, 6.0))
    middles = np.stack([u + 0.5, v + 0.5])
    limits = np.array([[width], [height]])
    low = np.clip(FINDER_STRIDE * (middles - reaches[:2]), 0.0, limits)
    high = np.clip(FINDER_STRIDE * (middles + reaches[2:]), 0.0, limits)
    boxes = np.concatenate([low, high - low]).T
    places = [
        Proposal(box, float(heat[y, x]), float(maps[QUALITY, y, x]))
        for box, y, x in zip(boxes, v.tolist(), u.tolist(), strict=True)
        if box[2:].min() > 0.0
    ]
    places = sorted((place for place in places if place.score >= threshold), key=lambda place: -place.score)
    return [places[k] for k in distinct(np.array([place.box for place in places]).reshape(-1, 4))]


def distinct(boxes: Float64) -> list[int]:
    """Return indices of the boxes (n, 4), surest first, that no kept one before covers by `SAME_FRUIT`."""
    overlaps = iou(boxes, boxes)
    kept: list[int] = []
    for k in range(len(boxes)):
        if overlaps[k, kept].max(initial=0.0) < SAME_FRUIT:
            kept.append(k)
    return kept
