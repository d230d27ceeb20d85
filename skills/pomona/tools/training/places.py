"""Where the finder proposes fruit in the training frames: the close look must learn the appearance of its mistakes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.tools.training.samples import FrameFolder

# least score of a place: half of the detector's, since elsewhere it may be proposed
THRESHOLD = 0.12


def find_places(
    detector: CompactDetector,
    frames: FrameFolder,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Float64]:
    """Return the finder's places by frame name: rows (u, v, size [px], score), shape (n, 4).

    `progress` is called with (frames searched, frames in all).
    """
    places = {}
    for index in range(len(frames)):
        found = detector.places(frames.picture(index), THRESHOLD)
        rows = [[*place.centre, place.size, place.score] for place in found]
        places[frames.name(index)] = np.array(rows, np.float64).reshape(-1, 4)
        if progress is not None:
            progress(index + 1, len(frames))
    return places


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
    """Read the file of `save_places`: (n, 4) for each name."""
    with np.load(path) as content:
        ends = np.cumsum(content["counts"])
        return dict(
            zip(content["names"].tolist(), np.split(content["rows"], ends[:-1]), strict=True)
        )
