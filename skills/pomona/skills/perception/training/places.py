"""Where the finder sees fruit in the training frames: what its mistakes look like is what the close look must learn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.options import WORKING_WIDTH
from pomona.skills.perception.training.photographs import PhotoSet, fruit_scale
from pomona.skills.perception.training.samples import FrameFolder

THRESHOLD = 0.12
"""Least belief of a place: half of the detector's, since a place that is nearly proposed here is proposed elsewhere."""


def find_places(
    detector: CompactDetector,
    frames: FrameFolder,
    progress: Callable[[int, int], None] | None = None,
    most: int | None = None,
) -> dict[str, Float64]:
    """Places by frame name: rows (u, v, size [px], belief), (n, 4).

    Args:
        detector: whose finder is asked.
        frames: to search.
        progress: called with (frames searched, frames in all).
        most: frames that are searched, evenly from all; None for all.
    """
    places = {}
    for index in range(0, len(frames), _stride(len(frames), most)):
        found = detector.places(frames.picture(index, halved=False), THRESHOLD)
        rows = [[*place.keypoints[8], place.size, place.belief] for place in found]
        places[frames.name(index)] = np.array(rows, np.float64).reshape(-1, 4)
        if progress is not None:
            progress(index + 1, len(frames))
    return places


def find_photo_places(
    detector: CompactDetector,
    photographs: PhotoSet,
    progress: Callable[[int, int], None] | None = None,
    most: int | None = None,
) -> dict[str, Float64]:
    """Places as of `find_places`, (n, 4), in photographs shrunk as the finder learns from them, by their names."""
    places, scale = {}, fruit_scale(photographs.train)
    searched = [*photographs.train[:: _stride(len(photographs.train), most)], *photographs.empty]
    for number, photo in enumerate(searched):
        width = 2 * WORKING_WIDTH if photo.empty else max(16, round(scale * photo.width))
        options = replace(detector.options, working_width=width)
        found = detector.looking(options).places(photo.picture(), THRESHOLD)
        rows = [[*place.keypoints[8], place.size, place.belief] for place in found]
        places[photo.name] = np.array(rows, np.float64).reshape(-1, 4)
        if progress is not None:
            progress(number + 1, len(searched))
    return places


def _stride(count: int, most: int | None) -> int:
    return 1 if most is None else max(1, -(-count // most))


def save_places(path: Path, places: dict[str, Float64]) -> None:
    """Write places atomically; read them with `load_places`."""
    part = path.with_suffix(".part.npz")
    np.savez(
        part,
        names=np.array(list(places)),
        counts=[len(p) for p in places.values()],
        rows=np.concatenate([np.empty((0, 4)), *places.values()]),
    )
    part.replace(path)


def load_places(path: Path) -> dict[str, Float64]:
    """What `save_places` wrote: (n, 4) for each name."""
    with np.load(path) as content:
        ends = np.cumsum(content["counts"])
        return dict(zip(content["names"].tolist(), np.split(content["rows"], ends[:-1]), strict=True))
