"""`pomona detect`: the fruit in pictures, without a tree: a table, and the pictures with boxes."""

from __future__ import annotations

import argparse
import csv
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import cv2
import numpy as np

from pomona.executive.running.signals import raise_again
from pomona.executive.values.arrays import UInt8
from pomona.executive.values.kinds import Number
from pomona.executive.values.pictures import ENDINGS, UnusablePicture, read_picture, write_picture
from pomona.executive.values.plain_text import is_file

if TYPE_CHECKING:
    from pomona.skills.perception.detection.box_model import ScoredBox
    from pomona.skills.perception.detection.compact_detector import CompactDetector
    from pomona.skills.perception.detection.found_fruit import FoundFruit

DEPTH = "_depth_mm.png"  # of an RGB-D frame, beside its colour: no picture to find fruit in
TABLE = "found.csv"
COLUMNS = ("picture", "fruit", "score", "left_px", "top_px", "width_px", "height_px", "visible")
COLOUR = (255, 176, 46)  # of boxes and numbers, RGB: `pomona.executive.palette.OVERLAY["found"]`


Search = Callable[[UInt8], "Sequence[FoundFruit | ScoredBox]"]  # finds the fruit in a picture (h, w, 3) uint8 RGB


class UnusableInput(Exception):
    """A file that is no picture, or a folder without any."""


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("detect", help="find the fruit in pictures: a table, and the pictures with boxes")
    parser.add_argument("pictures", type=Path, nargs="+", metavar="PICTURE", help="files, or folders of them")
    parser.add_argument("--fruit", default="apple", help="name in the catalogue, or a path (apple)")
    parser.add_argument(
        "--weights",
        help="another weights file, or the name of a shipped one: apple.weights is that of the simulated cell (the "
        "fruit's photo_weights, else its weights)",
    )
    parser.add_argument("--boxes", type=Path, help="a detector of boxes as an ONNX file, instead of weights")
    parser.add_argument(
        "--score", type=Number(0, 1).option, default=0.5, help="lowest score of a detection, 0 to 1 (0.5)"
    )
    parser.add_argument("--width", type=int, default=1280, help="width at which a picture is searched [px] (1280)")
    parser.add_argument("--out", type=Path, default=Path("detected"), help="new folder for all of it (detected)")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Find, write and count; return 0, or 2 when a picture, the weights or the folder cannot be used.

    KeyboardInterrupt passes; the table then holds the pictures that were done.
    """
    from pomona.skills.perception.detection.errors import DetectError
    from pomona.skills.perception.fruit.errors import FruitError

    table = options.out / TABLE
    try:
        if not 64 <= options.width <= 4096:
            raise UnusableInput("--width must lie in 64 … 4096 px")
        if table.exists():
            raise UnusableInput(f"{table} is there already: name another folder with --out")
        files = list(_files(options.pictures))
        search = _search(options)
        options.out.mkdir(parents=True, exist_ok=True)
        with table.open("x", newline="", encoding="utf-8") as stream:
            unusable = _all(files, search, options.score, options.out, stream)
    except (UnusableInput, DetectError, FruitError, OSError) as error:
        sys.stderr.write(f"pomona detect: {error}\n")
        return 2
    except KeyboardInterrupt:
        if table.is_file():
            sys.stderr.write(f"interrupted: {table} holds the results so far\n")
        raise
    sys.stdout.write(f"written to {options.out}: {TABLE}, and each picture with its boxes\n")
    return 2 if unusable else 0


def _files(given: Sequence[Path]) -> Iterator[Path]:
    for path in given:
        if not path.is_dir():
            if not is_file(path):
                raise UnusableInput(f"{path}: there is no such file")
            yield path
            continue
        inside = sorted(file for file in path.iterdir() if _is_picture(file.name))
        if not inside:
            raise UnusableInput(f"{path} holds no pictures ({', '.join(ENDINGS)})")
        yield from inside


def _is_picture(name: str) -> bool:
    return name.lower().endswith(ENDINGS) and not name.startswith(".") and not name.endswith(DEPTH)


def _search(options: argparse.Namespace) -> Search:
    """Return the search of one picture, by a detector of boxes or by weights.

    Raises:
        UnusableInput, DetectError, FruitError: the options do not go together, or a file cannot be used.
    """
    from pomona.skills.perception.detection.box_model import load_boxes
    from pomona.skills.perception.detection.compact_detector import CompactDetector
    from pomona.skills.perception.detection.errors import BadWeights
    from pomona.skills.perception.detection.options import DetectorOptions
    from pomona.skills.perception.fruit import find_weights, load_fruit

    fruit = load_fruit(options.fruit)
    if options.boxes is not None:
        if options.weights is not None:
            raise UnusableInput("--boxes and --weights: name one of them")
        return load_boxes(options.boxes, fruit.name, options.width).find
    weights = fruit.photo_weights or fruit.weights
    if options.weights is not None:
        weights = find_weights(Path(), options.weights)
        if weights is None:
            raise BadWeights(options.weights, "is neither a file nor the name of shipped weights")
    if weights is None:
        raise BadWeights(options.fruit, f"train some: pomona train detect --fruit {options.fruit}")
    # places that are looked at closely in one picture
    detector = CompactDetector.load(weights, DetectorOptions(working_width=options.width, most_fruit=200))
    return lambda colour: find_fruit(detector, colour)


def _all(files: Sequence[Path], search: Search, score: float, out: Path, stream: TextIO) -> int:
    """Return each picture with its line on the screen and its rows in the table; how many could not be used."""
    from pomona.skills.perception.detection.errors import BadFrame

    table = csv.writer(stream)
    table.writerow(COLUMNS)
    unusable = total = 0
    for number, file in enumerate(files):
        raise_again()
        try:
            picture = read_picture(file)
            found = [fruit for fruit in search(picture) if fruit.score >= score]
        except (UnusablePicture, BadFrame) as error:
            sys.stderr.write(f"pomona detect: {_shown(file)}: {error}\n")
            unusable += 1
            continue
        write_picture(out / f"{number + 1:04d}_{file.stem}.jpg", _draw(picture, found))
        height, width = picture.shape[:2]
        table.writerows(
            (
                _shown(file),
                k + 1,
                f"{fruit.score:.3f}",
                *(f"{value:.1f}" for value in fruit.outline(width, height)),
                "" if math.isnan(fruit.visibility) else f"{fruit.visibility:.2f}",
            )
            for k, fruit in enumerate(found)
        )
        stream.flush()
        total += len(found)
        sys.stdout.write(f"{number + 1}/{len(files)}  {_shown(file)}: {len(found)} found\n")
        sys.stdout.flush()
    used = len(files) - unusable
    sys.stdout.write(f"{total} fruit in {used} {'picture' if used == 1 else 'pictures'}\n")
    return unusable


def _shown(file: Path) -> str:
    """Return a name that every screen can show: bytes that are not UTF-8 as \\xNN."""
    return os.fsencode(file).decode("utf-8", "backslashreplace")


def find_fruit(detector: CompactDetector, colour: UInt8) -> list[FoundFruit]:
    """Find all fruit in a picture (h, w, 3) uint8 RGB of an unknown camera; only boxes and scores are valid."""
    height, width = colour.shape[:2]
    K = np.array([[width, 0.0, 0.5 * width], [0.0, width, 0.5 * height], [0.0, 0.0, 1.0]])
    return detector.find(np.ascontiguousarray(colour), K)


def _draw(picture: Any, found: Sequence[FoundFruit | ScoredBox]) -> Any:
    drawn = picture.copy()
    height, width = picture.shape[:2]
    thick = max(1, round(width / 800))
    for k, fruit in enumerate(found):
        x, y, w, h = (round(float(value)) for value in fruit.outline(width, height))
        cv2.rectangle(drawn, (x, y), (x + w, y + h), COLOUR, thick)
        cv2.putText(drawn, str(k + 1), (x, max(y - 3, 12)), cv2.FONT_HERSHEY_SIMPLEX, 0.4 * thick, COLOUR, thick)
    return drawn
