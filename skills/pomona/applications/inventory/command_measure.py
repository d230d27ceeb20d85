"""`pomona measure`: sizes and positions of the fruit in recorded RGB-D frames, beside calipers where there are some."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pomona.applications.inventory.calipers import (
    CaliperedFruit,
    UnusableCalipers,
    compare,
    figures,
    learn,
    read_calipers,
    written,
)
from pomona.applications.inventory.fruit_table import Row, doubt_of_all, row_of, write_tables
from pomona.applications.inventory.measured_frame import FruitInFrame, draw, measure_frame
from pomona.drivers import Camera, CellFileError, FrameSequence, FrameUnreadable, load_cell
from pomona.executive import (
    Cell,
    Finding,
    Number,
    OrWord,
    UsageError,
    Whole,
    find_cell,
    format_finding,
    raise_again,
    write_picture,
)
from pomona.skills.perception import (
    DetectError,
    FruitError,
    FruitModel,
    TooFewFruit,
    depth_elsewhere,
    load_fruit,
)

BAGS = (".bag", ".db3", ".mcap")
TOPICS = {"colour": "colour images", "depth": "their depth", "info": "their CameraInfo"}


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "measure", help="sizes and positions of the fruit in recorded frames with depth"
    )
    parser.add_argument(
        "frames", type=Path, metavar="FOLDER|VIDEO|BAG", help="recorded colour images with depth"
    )
    parser.add_argument(
        "--kind", default="apple", help="kind of fruit: a name in the catalogue, or a path (apple)"
    )
    parser.add_argument(
        "--score", type=Number(0, 1).option, default=0.5, help="minimum detection score (0.5)"
    )
    parser.add_argument(
        "--width",
        type=OrWord(Whole(64, 4096), "all").option,
        help="the one width at which a picture is searched [px] (several, up to its own)",
    )
    parser.add_argument(
        "--method",
        choices=("uniform", "shape", "paper"),
        default="uniform",
        help="refinement of the size: uniform, shape, paper (uniform)",
    )
    parser.add_argument("--every", default="1", metavar="N", help="use every N-th frame (1)")
    for key, what in TOPICS.items():
        words = "camera_info beside colour" if key == "info" else "that of realsense2_camera"
        spelt = [f"--{key}-topic", *(["--color-topic"] if key == "colour" else [])]
        parser.add_argument(
            *spelt, dest=key, metavar="TOPIC", help=f"a bag's topic of {what} ({words})"
        )
    parser.add_argument(
        "--calipers",
        type=Path,
        metavar="TABLE",
        help="fruit measured by hand: frame, name, x, y, w, h [px], width_mm, height_mm",
    )
    parser.add_argument(
        "--learn",
        type=Path,
        metavar="FILE",
        help="with --calipers: write the sizes of this kind, for fruit.yaml",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("measured"), help="new folder for the results (measured)"
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Measure and write; return 0, or 2 when a frame could not be read or the calipers do not fit.

    Raises UsageError: frames, an option or the folder cannot be used; nothing was written. KeyboardInterrupt passes;
    the tables then hold the frames that were done.
    """
    if options.learn is not None and options.calipers is None:
        raise UsageError("--learn needs --calipers: sizes are learnt from fruit measured by hand")
    try:
        calipered = read_calipers(options.calipers) if options.calipers else []
        model = load_fruit(options.kind)
        if model.weights is None:
            raise UsageError(f"there are no weights to find {model.name} by")
        cell = _open(options)
        if options.out.exists():
            raise UsageError(f"{options.out} is there already: name another folder with --out")
        options.out.mkdir(parents=True)
    except (UnusableCalipers, FruitError) as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        raise UsageError(f"{error.filename}: {error.strerror}") from error
    run = _Measurement(options, cell, model)
    try:
        for line in run.frames():
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()
        return 2 if run.unreadable or not run.conclude(calipered) else 0
    except DetectError as error:
        sys.stderr.write(f"pomona measure: {error}\n")
        return 2
    except OSError as error:
        sys.stderr.write(f"pomona measure: {error.filename}: {error.strerror}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write(f"interrupted: {options.out} holds the results so far\n")
        raise
    finally:
        cell.close()


class _Measurement:
    """One run of the command."""

    def __init__(self, options: argparse.Namespace, cell: Cell, model: FruitModel) -> None:
        self._options = options
        self._cell = cell
        self._model = model
        self._fruit: list[FruitInFrame] = []
        self.unreadable = 0

    def frames(self) -> Iterator[str]:
        """Measure frame by frame, with a line for each; the tables are written at the end, also after an error."""
        sequence = self._cell.device(FrameSequence)
        rows: list[Row] = []
        try:
            for number in range(1, sequence.count + 1):
                raise_again()
                yield f"{number} of {sequence.count} frames, {self._measure(number, rows)}"
                sequence.advance()
        finally:
            write_tables(rows, self._options.out)

    def _measure(self, number: int, rows: list[Row]) -> str:
        options = self._options
        try:
            frame = self._cell.device(Camera).latest()
        except FrameUnreadable as error:
            self.unreadable += 1
            return error.message
        assert frame is not None, "a recorded frame is there at once"
        fruit = measure_frame(frame, self._model, options.score, options.width, options.method)
        doubt = depth_elsewhere(frame, or_nowhere=True)
        rows.extend(row_of(each, doubt) for each in fruit)
        self._fruit += fruit
        label = re.sub(r"[^A-Za-z0-9._-]+", "_", frame.label)[:60]
        write_picture(options.out / f"{number:04d}_{label}.jpg", draw(frame.colour, fruit))
        measured = sum(each.measured is not None for each in fruit)
        line = f"{frame.label}: {len(fruit)} found, {measured} measured"
        return f"{line}; in doubt: {doubt}" if doubt else line

    def conclude(self, calipered: list[CaliperedFruit]) -> bool:
        """Print what holds for all frames; return False if the calipers do not fit."""
        options = self._options
        sys.stdout.write(f"written to {options.out}: fruit.csv, fruit.json and a picture a frame\n")
        if doubt := doubt_of_all(self._fruit):
            sys.stderr.write(f"these sizes are not reliable: {doubt}\n")
        if not calipered:
            return True
        try:
            compared = compare(self._fruit, calipered)
            sys.stdout.write(f"{figures(compared)}\n")
            if options.learn is not None:
                sizes, words = learn(compared)
                options.learn.write_text(written(sizes), encoding="utf-8")
                sys.stdout.write(
                    f"{words}\nwritten to {options.learn}: `sizes: {{include: FILE}}` in fruit.yaml\n"
                )
        except (UnusableCalipers, TooFewFruit) as error:
            sys.stderr.write(f"pomona measure: {options.calipers}: {error}\n")
            return False
        return True


def _open(options: argparse.Namespace) -> Cell:
    """Return the cell whose camera shows the frames. Raises UsageError: they cannot be used."""
    if not options.frames.exists():
        raise UsageError(f"{options.frames}: there is no such folder or file")
    bag = _is_bag(options.frames)
    topics = {key: named for key in TOPICS if (named := getattr(options, key))}
    if topics and not bag:
        named = next(iter(topics))
        raise UsageError(f"--{named}-topic: {options.frames} is no bag, so it has no topics")
    place = {"bag" if bag else "folder": str(options.frames.absolute()), "every": options.every}
    path = find_cell("bag" if bag else "frames")
    try:
        return load_cell(path, overrides={**place, **topics})
    except CellFileError as error:
        lines = [_line(found, str(path)) for found in error.findings]
        raise UsageError("\n".join(dict.fromkeys(lines))) from error


def _is_bag(path: Path) -> bool:
    """Return True for a bag's file, or a folder with one, even without the metadata of a bag."""
    names = [part.name for part in path.iterdir()] if path.is_dir() else [path.name]
    return "metadata.yaml" in names or any(name.lower().endswith(BAGS) for name in names)


def _line(found: Finding, cell: str) -> str:
    """Return a finding without the cell and the settings that the user has not written."""
    if found.path != cell and not found.path.startswith("--set "):
        return format_finding(found)
    option = "--every: " if found.path.startswith("--set every=") else ""
    message = re.sub(r"^(?:devices\.)?camera(?:\.\w+)?: ", "", found.message)
    message = re.sub(r"the option '(\w+)'", r"--\1-topic", message)
    return f"{option}{message}" + (f": {found.hint}" if found.hint else "")
