"""Search of photographs at one width and at several: recall, precision, finds on other fruit, time and memory.

python -m benchmarks.bench_photos FOLDER [--most 50] [--table kinds.csv]

FOLDER holds photographs of apples with boxes: every folder in it that has images.csv; those to measure on are searched.
Tables list pictures of one kind each, as `pomona train kinds` reads them; those of the split test are searched.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.bench_detect import processor_name, progress
from pomona.executive.values.arrays import UInt8
from pomona.executive.values.pictures import read_picture, write_picture
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.fruit import load_fruit
from pomona.tools.fruit_kinds.kind_head import NONE
from pomona.tools.photographs.box_evaluation import (
    JudgedPicture,
    box_figures,
    intervals,
    judge,
    recall_and_precision,
)
from pomona.tools.photographs.command_detect_pictures import find_fruit, photo_options
from pomona.tools.photographs.photo_folder import read_photographs
from pomona.tools.photographs.photographs import Photograph
from pomona.tools.training.command_kinds import KINDS as NAMES
from pomona.tools.training.kind_finds import read_kind_table

BEFORE = 1280  # the one width at which `pomona detect` searched before [px]
SCORE = 0.5  # its default
KINDS = NAMES.split(",")
LARGE = (3000, 4000)  # height and width of the picture for time and memory [px]: 12 megapixels


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder of photographs")
    parser.add_argument(
        "--most", type=int, default=50, help="pictures of each folder, evenly chosen; 0: all (50)"
    )
    parser.add_argument(
        "--table",
        type=Path,
        action="append",
        default=[],
        help="pictures of one kind each; repeat it",
    )
    options = parser.parse_args()
    weights = load_fruit("apple").photo_weights
    assert weights is not None
    detector = CompactDetector.load(weights)
    ways = photo_options(BEFORE), photo_options(None), photo_options(None, "apple")
    searches = [detector.looking(way) for way in ways]
    print(
        f"Score ≥ {SCORE:g}, IoU 0.5, 95 % intervals from groups drawn again. {processor_name()}\n"
    )
    print(
        "| pictures | figure | one width, 1280 px | several widths | and the kind |\n|---|---|---|---|---|",
        flush=True,
    )
    folders = sorted({path.parent for path in options.data.rglob("images.csv")})
    for folder in folders:
        for line in labelled(searches, folder, chosen(read_photographs(folder).val, options.most)):
            print(line, flush=True)
    for table in options.table:
        pictures = [picture for picture in read_kind_table(table, KINDS) if picture.split == "test"]
        for title, right in (
            ("apples", True),
            ("other fruit", False),
            ("no fruit of these kinds", None),
        ):
            some = [p for p in pictures if (None if p.kind == NONE else p.kind == "apple") is right]
            if some:
                print(
                    counted(searches, f"{table.stem}: {title}", [picture.path for picture in some]),
                    flush=True,
                )
    if folders:
        for line in large(read_photographs(folders[0]).val):
            print(line, flush=True)


def chosen(photographs: Sequence[Photograph], most: int) -> list[Photograph]:
    """Return this many of the photographs, evenly over the list; all for 0."""
    count = min(most or len(photographs), len(photographs))
    return [photographs[int(k)] for k in np.linspace(0, len(photographs) - 1, count).round()]


def labelled(
    searches: Sequence[CompactDetector], folder: Path, photographs: Sequence[Photograph]
) -> list[str]:
    """Rows of a folder with labels."""
    judged: list[list[JudgedPicture]] = []
    for search in searches:
        pictures = []
        with progress(f"looking at {folder.name}") as looked:
            for number, photo in enumerate(photographs):
                fruit = find_fruit(search, photo.picture())
                boxes = np.array([one.outline(photo.width, photo.height) for one in fruit]).reshape(
                    -1, 4
                )
                scores = np.array([one.score for one in fruit])
                pictures.append(judge(boxes, scores, photo.boxes, photo.group or photo.name))
                looked(number + 1, len(photographs))
        judged.append(pictures)
    boxes_there = sum(len(photo.boxes) for photo in photographs)
    name = f"{folder.name}, {len(photographs)} pictures, {boxes_there} boxes"
    figures: list[tuple[str, Callable[[Sequence[JudgedPicture]], float]]] = [
        ("recall", lambda drawn: recall_and_precision(drawn, SCORE)[0]),
        ("precision", lambda drawn: recall_and_precision(drawn, SCORE)[1]),
        ("recall at precision 0.90", lambda drawn: box_figures(drawn).recall),
        ("AP50", lambda drawn: box_figures(drawn).ap50),
    ]
    return [
        f"| {name} | {title} | {' | '.join(with_interval(p, of) for p in judged)} |"
        for title, of in figures
    ]


def with_interval(
    pictures: Sequence[JudgedPicture], figure: Callable[[Sequence[JudgedPicture]], float]
) -> str:
    """Figure of pictures with its interval."""
    ((low, high),) = intervals(pictures, lambda drawn: [figure(drawn)])
    return f"{figure(pictures):.3f} ({low:.3f}–{high:.3f})"


def counted(searches: Sequence[CompactDetector], name: str, paths: Sequence[Path]) -> str:
    """Row of pictures without labels: finds per picture, with the interval from pictures drawn again."""
    cells, rng = [], np.random.default_rng(0)
    drawn = rng.integers(0, len(paths), (1000, len(paths)))
    for search in searches:
        found = (find_fruit(search, read_picture(path)) for path in paths)
        counts = np.array([sum(one.score >= SCORE for one in fruit) for fruit in found])
        low, high = np.quantile(counts[drawn].mean(axis=1), (0.025, 0.975))
        cells.append(
            f"{counts.mean():.2f} ({low:.2f}–{high:.2f}), in {(counts > 0).sum()} of {len(counts)}"
        )
    return f"| {name}, {len(paths)} pictures | finds per picture | {' | '.join(cells)} |"


def large(photographs: Sequence[Photograph]) -> list[str]:
    """Rows of one large picture, put together of photographs: processor time and memory of the whole command."""
    seconds: list[str] = []
    memory: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.jpg"
        write_picture(path, mosaic(photographs)[..., ::-1])
        for width in ((f"--width={BEFORE}",), ()):
            out = f"--out={folder}/{len(seconds)}"
            command = [
                sys.executable,
                "-m",
                "pomona.executive.cli",
                "detect",
                str(path),
                out,
                *width,
            ]
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
            seconds.append(f"{used.ru_utime + used.ru_stime:.1f} s")
            memory.append(f"{used.ru_maxrss * resource_unit() / 1e9:.2f} GB")
    name = f"{LARGE[1]} × {LARGE[0]} px, the whole command"
    rows = ("processor time", seconds), ("peak memory", memory)
    return [f"| {name} | {title} | {values[0]} | – | {values[1]} |" for title, values in rows]


def resource_unit() -> int:
    """Return bytes of one unit of `ru_maxrss`."""
    return 1 if sys.platform == "darwin" else 1024


def mosaic(photographs: Sequence[Photograph]) -> UInt8:
    """Picture of `LARGE`, BGR, from photographs side by side."""
    height, width = LARGE
    picture = np.zeros((height, width, 3), np.uint8)
    places = [
        (y, x)
        for y in range(0, height, photographs[0].height)
        for x in range(0, width, photographs[0].width)
    ]
    for number, (y, x) in enumerate(places):
        part = photographs[number % len(photographs)].picture()[: height - y, : width - x, ::-1]
        picture[y : y + part.shape[0], x : x + part.shape[1]] = part
    return picture


if __name__ == "__main__":
    main()
