"""Finds from which the kinds of fruit are learnt: pictures with one kind each, and photographs with boxes of apples."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64, UInt8
from pomona.executive.values.pictures import UnusablePicture, read_picture
from pomona.executive.values.plain_text import NoTableError, read_table
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.skills.perception.detection.places import iou
from pomona.tools.fruit_kinds.kind_head import NONE, find_picture
from pomona.tools.photographs.photo_folder import read_photographs
from pomona.tools.photographs.photographs import camera_of

COLUMNS = ("picture", "kind", "split")
SPLITS = ("train", "val", "test")
SIDE = 128  # of the pictures of finds that are kept: random windows of 96 px are cut from them [px]
LEAST = 0.05  # finds with less score are not kept
MOST = 20  # finds of one picture that are learnt from: neighbours on a shelf are alike
UNSURE = 0.15  # a find without a label and with less score is taken for none; others are mostly unlabelled apples
APART = 0.1  # largest intersection over union of such a find with a label
UNKNOWN = -1  # kind of a find that is left out
LEAST_KIND = 0.25  # finds of a picture of one kind count in full from this score on


@dataclass(frozen=True, slots=True, eq=False)
class KindPicture:
    """A picture that shows fruit of one kind, or apples with boxes."""

    path: Path
    kind: str
    split: str  # one of `SPLITS`
    source: str  # pictures of one source count alike in all, however many there are
    group: str = ""  # pictures of one group show the same place
    boxes: Float64 | None = (
        None  # labelled apples, x, y, w, h (n, 4) [px]; None for a picture of one kind
    )


@dataclass(frozen=True, slots=True, eq=False)
class KindFinds:
    """Finds of many pictures."""

    pictures: UInt8  # (n, SIDE, SIDE, 3)
    scores: Float64  # of the finder, (n,)
    kinds: NDArray[np.int64]  # index of the kind, or `UNKNOWN`, (n,)
    weights: Float64  # (n,), 0 to 1
    owners: NDArray[np.int64]  # index of the picture, (n,)


def read_kind_table(path: Path, kinds: Sequence[str]) -> list[KindPicture]:
    """Read a table of pictures; its columns are `COLUMNS`, paths are relative to its folder.

    Raises BadPhotographs: naming the file and the line.
    """
    try:
        rows = list(read_table(path, COLUMNS))
    except NoTableError as error:
        raise BadPhotographs(path, str(error)) from error
    pictures = []
    for line, row in rows:
        picture, kind, split = (row[name] or "" for name in COLUMNS)
        if kind not in (*kinds, NONE):
            raise BadPhotographs(
                path, f"line {line}: the kind '{kind}' is not one of {', '.join(kinds)}, {NONE}"
            )
        if split not in SPLITS:
            raise BadPhotographs(
                path, f"line {line}: the split '{split}' is not one of {', '.join(SPLITS)}"
            )
        if not (path.parent / picture).is_file():
            raise BadPhotographs(path, f"line {line}: there is no picture {path.parent / picture}")
        pictures.append(KindPicture(path.parent / picture, kind, split, f"{path}:{kind}", picture))
    return pictures


def labelled_pictures(folder: Path, most: int) -> list[KindPicture]:
    """Return up to `most` photographs with boxes of apples of each split; each second group of val is for the test.

    Raises BadPhotographs: as of `read_photographs`.
    """
    photos = read_photographs(folder)
    groups = sorted({photo.group or photo.name for photo in photos.val})
    found = []
    for split, some in (("train", photos.train), ("val", photos.val)):
        count = min(most, len(some))
        for k in np.linspace(0, len(some) - 1, count).round().astype(int).tolist():
            group = some[k].group or some[k].name
            is_test = split == "val" and groups.index(group) % 2
            part = "test" if is_test else split
            found.append(
                KindPicture(some[k].path, "apple", part, str(folder), group, some[k].boxes)
            )
    return found


def collect(
    detector: CompactDetector,
    pictures: Sequence[KindPicture],
    kinds: Sequence[str],
    work: Path,
    progress: Callable[[int, int], None] | None = None,
) -> KindFinds:
    """Search the pictures and return their finds; each picture's are kept in `work`, so that a later call goes on.

    Args:
        detector: searches at several widths, without a kind.
        kinds: names, without `NONE`.

    Raises BadPhotographs: a picture cannot be read.
    """
    work.mkdir(parents=True, exist_ok=True)
    parts: list[tuple[UInt8, Float64, Float64]] = []
    for number, picture in enumerate(pictures):
        kept = work / f"{hashlib.sha256(str(picture.path.resolve()).encode()).hexdigest()[:20]}.npz"
        if not kept.is_file():
            _search(detector, picture.path, kept)
        with np.load(kept) as stored:
            parts.append((stored["pictures"], stored["scores"], stored["boxes"]))
        if progress is not None:
            progress(number + 1, len(pictures))
    judged = [
        _judged(picture, part[1], part[2], kinds)
        for picture, part in zip(pictures, parts, strict=True)
    ]
    return KindFinds(
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([kind for kind, _ in judged]),
        np.concatenate([weight for _, weight in judged]),
        np.repeat(np.arange(len(parts)), [len(part[1]) for part in parts]),
    )


def _search(detector: CompactDetector, path: Path, kept: Path) -> None:
    try:
        colour = np.ascontiguousarray(read_picture(path))
    except UnusablePicture as error:
        raise BadPhotographs(path, str(error)) from error
    height, width = colour.shape[:2]
    found = [
        fruit for fruit in detector.find(colour, camera_of(width, height)) if fruit.score >= LEAST
    ]
    boxes = np.array([fruit.outline(width, height) for fruit in found]).reshape(-1, 4)
    crops = [find_picture(colour, box, SIDE) for box in boxes]
    part = kept.with_suffix(".part")
    with part.open("wb") as stream:
        np.savez(
            stream,
            pictures=np.array(crops, np.uint8).reshape(-1, SIDE, SIDE, 3),
            scores=np.array([fruit.score for fruit in found], np.float64),
            boxes=boxes,
        )
    part.replace(kept)


def _judged(
    picture: KindPicture, scores: Float64, boxes: Float64, kinds: Sequence[str]
) -> tuple[NDArray[np.int64], Float64]:
    """Return kind and weight of each find of a picture, (n,) each."""
    names = [*kinds, NONE]
    if picture.boxes is None:
        sure = scores >= LEAST_KIND
        return np.full(len(scores), names.index(picture.kind)), np.where(sure, 1.0, 0.5)
    overlap = iou(boxes, picture.boxes).max(axis=1, initial=0.0)
    stray = (overlap < APART) & (scores < UNSURE)
    found = np.where(
        overlap >= 0.5, names.index(picture.kind), np.where(stray, names.index(NONE), UNKNOWN)
    )
    return found, np.where(stray, 0.3, 1.0)
