"""Recognises boxes that are written as corners (x1, y1, x2, y2) from those written as sizes (x, y, w, h).

Corners that are read as sizes mostly leave the picture. Of those that stay in it, a single box shows nothing: (10, 10,
80, 80) may be either. Two things do. Of corners the third number is greater than the first and the fourth than the
second, in every box; several fruit of one picture are hardly all larger than their distance to its upper left corner
(in 0 of 1 490 photographs with two apples and more). An area, where a file gives one, is that of one reading.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.tools.photographs.photographs import Labelled

EXACT = 1e-3  # an area that a tool wrote is that of the box, or of the corners, to this part of it

CORNERS = "corners x1, y1, x2, y2"


def written(item: Labelled) -> Float64:
    """Return the four numbers of each box, (n, 4), as the file has them: in parts of the picture the middle leads."""
    boxes = np.array(item.boxes, np.float64).reshape(-1, 4)
    if item.parts:
        boxes[:, :2] += 0.5 * boxes[:, 2:]
    return boxes


def are_corners(boxes: Float64) -> bool:
    """Return True if all these boxes, (n, 4) as they are written, can be corners."""
    return len(boxes) > 0 and bool((boxes[:, 2:] > boxes[:, :2]).all())


def fit_as_corners(item: Labelled, limits: Float64) -> bool:
    """Return True if all boxes of a picture of this width and height (2,) [px] lie in it as corners."""
    boxes = written(item)
    within = boxes <= (1.0 if item.parts else np.tile(limits, 2))
    return item.sizes and are_corners(boxes) and bool(within.all())


def refuse_corners(labelled: Sequence[Labelled]) -> None:
    """Raise BadPhotographs: all boxes of a file, or of YOLO's folder of files, are corners beyond doubt."""
    files: dict[str, list[Labelled]] = defaultdict(list)
    for item in labelled:
        files[str(Path(item.says).parent) if item.parts else item.says].append(item)
    for says, items in files.items():
        pictures = [
            np.unique(written(item)[~np.array(item.crowd, np.bool_)], axis=0)
            for item in items
            if item.boxes
        ]
        boxes = np.vstack([np.empty((0, 4)), *pictures])
        most = max((int((some[:, :2] > 0.0).all(axis=1).sum()) for some in pictures), default=0)
        if most < 2 or not all(item.sizes for item in items) or not are_corners(boxes):
            continue
        x, y, right, bottom = boxes[int(np.argmax(boxes[:, 0]))]
        raise BadPhotographs(
            says,
            f"its boxes are {CORNERS}, expected {'the middle and ' if items[0].parts else ''}x, y, w, h: all "
            f"{len(boxes)} are wider than their x and higher than their y ({x:g}, {y:g}, {right:g}, {bottom:g}), with "
            f"up to {most} in a picture",
        )


def refuse_areas_of_corners(
    path: Path, labels: Sequence[tuple[str, tuple[float, float, float, float], float]]
) -> None:
    """Raise BadPhotographs: the areas [px²] of a file's labels (place, box, area) are of their boxes as corners."""
    boxes = np.array([box for _, box, _ in labels], np.float64).reshape(-1, 4)
    areas = np.array([area for _, _, area in labels], np.float64)
    if not are_corners(boxes):
        return
    with np.errstate(over="ignore", invalid="ignore"):  # boxes that are none are named later
        sizes, corners = boxes[:, 2] * boxes[:, 3], (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
        if (
            not np.allclose(areas, corners, EXACT, 0.0)
            or np.isclose(areas, sizes, EXACT, 0.0).any()
        ):
            return
    x, y, right, bottom = boxes[0]
    raise BadPhotographs(
        path,
        f"{labels[0][0]}: its bbox {x:g}, {y:g}, {right:g}, {bottom:g} are {CORNERS}, expected x, y, w, h: as sizes "
        f"they have {sizes[0]:g} px², its area is {areas[0]:g}; so it is with all {len(boxes)} that have an area",
    )
