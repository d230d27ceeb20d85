"""Places of fruit: in the finder's maps, and from a search of a picture at several widths.

The finder finds fruit of one range of sizes in its input. Several widths of the same picture cover all sizes in it.
Boxes are x, y, w, h [px].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64
from pomona.executive.values.later import Later
from pomona.skills.perception.detection.close_look import (
    FINDER_STRIDE,
    HEAT,
    QUALITY,
    REACHES,
    SIZE_OF_BOX,
)
from pomona.skills.perception.detection.errors import BadMaps

cv2: Any = Later("cv2")

STEPS = (64, 96, 128, 160, 224, 320, 448, 640, 896, 1280, 1792, 2560, 3584)
"""Longer sides of the finder's input [px]. With steps of 2 instead of about 1.4, recall at precision 0.90 on orchard
tiles was 3 points lower, and the search a third cheaper."""

# longer side at which larger pictures are searched [px]: time and memory are bounded
LARGEST_SIDE = 4096
# the picture's own side takes the place of a step that is closer to it than this ratio
CLOSEST = 1.2

SMALLEST_FRUIT = 24.0
LARGEST_FRUIT = 130.0
"""Longer sides of fruit in the finder's input that are kept [px]: recall on labelled apples is below a half outside."""

SURE_SMALLEST = 28.0
SURE_LARGEST = 110.0
"""Longer sides in the finder's input at which fruit should be found [px]: the score counts a miss there."""

BEST_FRUIT = 50.0  # longer side in the finder's input at which boxes are most exact [px]

LEARNT_FRUIT = 46.0  # median longer side of fruit in the finder's input when it learnt [px]

LARGEST_WHOLE = 1920  # an input with a longer side than this is searched in tiles [px]: the memory of one is 0.7 GB
TILE = 1600
OVERLAP = 192
"""Largest side of a tile, and overlap of two [px]: the largest fruit lies whole in one of them, 31 px from its border,
and a tile takes no more memory than the largest whole input."""

SAME = 0.5  # boxes of the same fruit at two widths have at least this intersection over union
INSIDE = 0.8  # a box of which this part lies in a surer one, or the reverse, is the same fruit or a part of it
FUSED = 0.6  # boxes with at least this intersection over union are averaged


def search_sides(width: int, height: int) -> tuple[int, ...]:
    """Return the longer sides [px], rising, at which a picture of this size is searched; it is never enlarged."""
    own = min(max(width, height), LARGEST_SIDE)
    return *(side for side in STEPS if CLOSEST * side <= own), own


def width_for(distance: float, size: float, fx: float, width: int) -> int:
    """Return the width at which fruit at a distance is as large in the finder's input as most that it learnt from.

    Args:
        distance: along the camera's axis [m].
        size: diameter of the fruit [m].
        fx: focal length along the rows [px].
        width: of the picture [px], which is never enlarged.
    """
    wanted = round(LEARNT_FRUIT * width * distance / (fx * size))
    return min(max(wanted, STEPS[0]), width, LARGEST_SIDE)


@dataclass(frozen=True, slots=True)
class PictureTile:
    """A part of a picture. Each pixel lies in the core of exactly one tile."""

    left: int  # left, top, width, height: of the tile [px]
    top: int
    width: int
    height: int
    core: tuple[
        float, float, float, float
    ]  # left, top, right, bottom of the part whose finds count [px]

    def owns(self, boxes: Float64) -> NDArray[np.bool_]:
        """Return which boxes (n, 4) of the whole picture have their middle in the core, (n,)."""
        middle = boxes[:, :2] + 0.5 * boxes[:, 2:]
        low = np.array(self.core[:2])
        high = np.array(self.core[2:])
        return np.asarray(((middle >= low) & (middle < high)).all(axis=1), np.bool_)


def megapixels(width: int, height: int) -> int:
    """Return the size of an input in megapixels, rounded up: the limit on the number of peaks holds for each."""
    return max(1, -(-width * height // 1_000_000))


def tiles(width: int, height: int) -> list[PictureTile]:
    """Return the tiles in which an input of this size [px] is searched; one, if it is small enough."""
    if max(width, height) <= LARGEST_WHOLE:
        return [PictureTile(0, 0, width, height, (-np.inf, -np.inf, np.inf, np.inf))]
    return [
        PictureTile(left, top, right - left, bottom - top, (low_x, low_y, high_x, high_y))
        for top, bottom, low_y, high_y in _cuts(height)
        for left, right, low_x, high_x in _cuts(width)
    ]


def _cuts(length: int) -> list[tuple[int, int, float, float]]:
    """Return start and end of each tile along one side, and of its core: as few tiles as possible, of one length."""
    count = max(1, -(-(length - OVERLAP) // (TILE - OVERLAP)))
    tile = -(-(length + (count - 1) * OVERLAP) // count)
    starts = [min(k * (tile - OVERLAP), length - tile) for k in range(count)]
    ends = [start + tile for start in starts]
    borders = [0.5 * (end + start) for end, start in zip(ends, starts[1:], strict=False)]
    return list(zip(starts, ends, [-np.inf, *borders], [*borders, np.inf], strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class MergedPlace:
    """One place of fruit from the finds of all widths."""

    box: Float64  # mean of the members' boxes, (4,) [px of the picture]
    members: tuple[
        int, ...
    ]  # indices of its finds, at most one for each width, first the one that was kept


def merge(
    boxes: Float64, scores: Float64, levels: NDArray[np.int64], factors: Float64
) -> list[MergedPlace]:
    """Return one place for each fruit that several widths found, the surest first.

    Args:
        boxes: of all widths' finds in the picture (n, 4) [px].
        scores: of the finds, 0..1 (n,).
        levels: index of each find's width (n,).
        factors: pixels of the input per pixel of the picture, of each width (m,).
    """
    order = np.argsort(-scores, kind="stable").tolist()
    corners = np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)
    kept: list[int] = []
    for k in order:
        one = boxes[k : k + 1]
        others = boxes[kept]
        if not ((iou(one, others) >= SAME) | (shared_part(one, others) >= INSIDE)).any():
            kept.append(k)
    owner = np.zeros(len(boxes), np.int64)
    most = np.full(len(boxes), -1.0)
    for k in kept:  # each find supports the place that it overlaps most
        overlap = iou(boxes[k : k + 1], boxes)[0]
        owner[overlap > most], most = k, np.maximum(overlap, most)
    weights = np.maximum(
        scores * _nearness(boxes[:, 2:].max(axis=1, initial=0.0) * factors[levels]), 1e-12
    )
    places = []
    for k in kept:
        mine = np.nonzero((owner == k) & (most >= SAME))[0]
        same = [k, *(i for i in mine[np.argsort(-scores[mine], kind="stable")].tolist() if i != k)]
        members = [i for n, i in enumerate(same) if levels[i] not in levels[same[:n]]]
        fused = [i for i in members if most[i] >= FUSED]
        low_x, low_y, high_x, high_y = np.average(corners[fused], axis=0, weights=weights[fused])
        places.append(
            MergedPlace(np.array([low_x, low_y, high_x - low_x, high_y - low_y]), tuple(members))
        )
    return places


def shared_part(a: Float64, b: Float64) -> Float64:
    """Part of the smaller box that lies in the other one, of each of `a` (n, 4) with each of `b` (m, 4); (n, m)."""
    shared, area_a, area_b = _areas(a, b)
    return np.asarray(shared / np.maximum(np.minimum(area_a, area_b), 1e-12), np.float64)


def _nearness(sizes: Float64) -> Float64:
    """Weight of a longer side in the finder's input (n,) [px]: 1 at `BEST_FRUIT`, less for smaller and larger ones."""
    return np.asarray(np.exp(-np.square(np.log(np.maximum(sizes, 1e-9) / BEST_FRUIT))), np.float64)


def agreed_score(
    scores: Float64, levels: NDArray[np.int64], size: float, factors: Float64
) -> float:
    """Return one score of a place: geometric mean of the best score, and the mean of all widths that should find it.

    Args:
        scores: of the members, 0..1 (n,), n at least 1.
        levels: index of each member's width (n,).
        size: longer side of the place's box in the picture [px].
        factors: pixels of the input per pixel of the picture, of each width (m,).
    """
    at_level = np.zeros(len(factors))
    at_level[levels] = scores
    expected = (size * factors >= SURE_SMALLEST) & (size * factors <= SURE_LARGEST)
    best = float(scores.max())
    return float(np.sqrt(best * at_level[expected].mean())) if expected.any() else best


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
    v = v[order]
    u = u[order]
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
    places = sorted(
        (place for place in places if place.score >= threshold), key=lambda place: -place.score
    )
    return [places[k] for k in distinct(np.array([place.box for place in places]).reshape(-1, 4))]


def distinct(boxes: Float64) -> list[int]:
    """Return indices of the boxes (n, 4), surest first, that no kept one before covers by `SAME_FRUIT`."""
    overlaps = iou(boxes, boxes)
    kept: list[int] = []
    for k in range(len(boxes)):
        if overlaps[k, kept].max(initial=0.0) < SAME_FRUIT:
            kept.append(k)
    return kept


def iou(a: Float64, b: Float64) -> Float64:
    """Intersection over union of each box of `a` (n, 4) with each of `b` (m, 4), x, y, w, h; (n, m)."""
    shared, area_a, area_b = _areas(a, b)
    return np.asarray(shared / np.maximum(area_a + area_b - shared, 1e-12), np.float64)


def _areas(a: Float64, b: Float64) -> tuple[Float64, Float64, Float64]:
    """Return the shared area of each box of `a` (n, 4) with each of `b` (m, 4), (n, m), and their own areas."""
    a, b = a[:, None], b[None]
    ends = np.minimum(a[..., :2] + a[..., 2:], b[..., :2] + b[..., 2:])
    shared = np.clip(ends - np.maximum(a[..., :2], b[..., :2]), 0.0, None).prod(axis=2)
    return shared, a[..., 2:].prod(axis=2), b[..., 2:].prod(axis=2)
