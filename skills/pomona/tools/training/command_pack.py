"""`pomona data pack`: labelled photographs made small, to learn from them on another machine."""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from pomona.executive.values.arrays import UInt8
from pomona.executive.values.pictures import write_picture
from pomona.tools.training.progress_bar import ProgressBar

if TYPE_CHECKING:
    from pomona.tools.photographs.photographs import Photograph

SIDE, QUALITY = 448, 50
"""Longer side [px] and quality of WebP: tiles of an orchard's apples have 46 px fruit then, and 32 kB each."""

MOST_BYTES = 20_000_000  # of one part, small enough for a mail


def add(kinds: Any) -> None:
    """Register `pomona data pack`."""
    pack = kinds.add_parser(
        "pack",
        help="labelled photographs made small, as folders for `pomona train detect --photos`",
    )
    pack.add_argument(
        "photos",
        type=Path,
        help="folder of photographs with boxes, as `pomona train detect` reads it",
    )
    pack.add_argument(
        "--out", type=Path, required=True, help="new folder; part_1, part_2 … are written into it"
    )
    pack.add_argument("--fruit", default="apple", help="class of the boxes (apple)")
    pack.add_argument(
        "--side", type=int, default=SIDE, help=f"longer side of the pictures, at most [px] ({SIDE})"
    )
    pack.add_argument("--quality", type=int, default=QUALITY, help=f"of WebP, 1 to 100 ({QUALITY})")
    pack.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Write the parts; returns 0, or 2 with the reason."""
    from pomona.skills.perception.detection.errors import BadPhotographs
    from pomona.tools.photographs.photo_folder import read_photographs

    try:
        if options.side < 64 or not 1 <= options.quality <= 100:
            raise ValueError(
                f"--side {options.side} --quality {options.quality}: at least 64 px, and 1 to 100"
            )
        if options.out.exists() and any(options.out.iterdir()):
            raise ValueError(f"--out {options.out}: expected a new folder")
        with ProgressBar("photographs read") as show:
            photographs = read_photographs(options.photos, options.fruit, show)
        rows = [(photo, "train") for photo in photographs.train] + [
            (photo, "val") for photo in photographs.val
        ]
        parts = write_pack(options.out, rows, options.side, options.quality)
    except (BadPhotographs, OSError, ValueError) as error:
        sys.stderr.write(f"pomona data: {error}\n")
        return 2
    for part, size in parts:
        sys.stdout.write(f"{part}   {size / 1e6:.1f} MB\n")
    return 0


def write_pack(
    out: Path,
    photographs: Sequence[tuple[Photograph, str]],
    side: int,
    quality: int,
    most: int = MOST_BYTES,
) -> list[tuple[Path, int]]:
    """Write photographs with their splits as WebP of at most `side` [px], with tables; returns parts and sizes [byte].

    A part takes up to `most` bytes. Each part has photographs of each split, so that each has a scale of its own.
    Raises OSError: it cannot be written; BadPhotographs: a photograph can no longer be read.
    """
    scratch = out / ".pack"
    scratch.mkdir(parents=True)
    sizes, factors = [], []
    with ProgressBar("photographs written") as show:
        for number, (photo, _) in enumerate(photographs):
            factor = min(1.0, side / max(photo.width, photo.height))
            path = scratch / f"{number}.webp"
            write_picture(path, _shrunk(photo.picture(), factor), quality)
            sizes.append(path.stat().st_size)
            factors.append(factor)
            show(number + 1, len(photographs))
    count = max(1, -(-sum(sizes) // int(0.9 * most)))
    parts = []
    for part in range(count):
        mine = range(part, len(photographs), count)  # evenly: each part shows each place and split
        folder = out / f"part_{part + 1}"
        _write_part(folder, scratch, [(k, *photographs[k], factors[k]) for k in mine])
        parts.append(
            (folder, sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()))
        )
    scratch.rmdir()
    return parts


def _write_part(
    folder: Path, scratch: Path, photographs: Sequence[tuple[int, Photograph, str, float]]
) -> None:
    (folder / "images").mkdir(parents=True)
    with (
        (folder / "images.csv").open("w", encoding="utf-8", newline="") as images,
        (folder / "fruit.csv").open("w", encoding="utf-8", newline="") as fruit,
    ):
        pictures, boxes = csv.writer(images), csv.writer(fruit)
        pictures.writerow(("image", "group", "split"))
        boxes.writerow(("image", "x", "y", "w", "h", "crowd"))
        for number, photo, split, factor in photographs:
            name = f"{number:05d}_{photo.path.stem}.webp"
            (scratch / f"{number}.webp").rename(folder / "images" / name)
            pictures.writerow((name, photo.group, split))
            for box, crowd in zip(photo.boxes, photo.crowd, strict=True):
                boxes.writerow((name, *(f"{value:.2f}" for value in factor * box), int(crowd)))


def _shrunk(picture: UInt8, factor: float) -> UInt8:
    if factor == 1.0:
        return picture
    height, width = picture.shape[:2]
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
