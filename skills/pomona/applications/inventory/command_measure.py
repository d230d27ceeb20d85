"""`pomona measure`: count and measure the fruit in recorded frames, without a tree."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pomona.applications.inventory.fruit_page import FINDS, FRUIT, PAGE, PICTURES
from pomona.executive import (
    Event,
    Finding,
    NodeChanged,
    PortWritten,
    RunOrder,
    UsageError,
    find_cell,
    find_tree,
    format_finding,
    run_tree,
)

TREE, BAGS = "measure_fruit", (".bag", ".db3", ".mcap")
TOPICS = {"colour": "colour images", "depth": "their depth", "info": "their CameraInfo"}


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "measure", help="count and measure the fruit in recorded frames: tables and a page"
    )
    parser.add_argument(
        "frames", type=Path, metavar="FOLDER|VIDEO|BAG", help="recorded colour images with depth"
    )
    parser.add_argument(
        "--kind", default="apple", help="kind of fruit: a name in the catalogue, or a path (apple)"
    )
    parser.add_argument("--score", default="0.5", help="minimum detection score, 0 to 1 (0.5)")
    parser.add_argument(
        "--width",
        default="all",
        help="the one width at which a picture is searched [px] (several, up to its own)",
    )
    parser.add_argument(
        "--method",
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
        "--no-join",
        action="store_true",
        help="each frame without a given camera pose is a separate scene",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("measured"),
        help="new folder for tables and page (measured)",
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Run the tree; return 0, 2 when something cannot be used or written, or 130 when it was interrupted.

    Raises UsageError: the frames, an option or the folder cannot be used; nothing was written.
    """
    if not options.frames.exists():
        raise UsageError(f"{options.frames}: there is no such folder or file")
    bag = _is_bag(options.frames)
    topics = {key: named for key in TOPICS if (named := getattr(options, key))}
    if topics and not bag:
        raise UsageError(
            f"--{next(iter(topics))}-topic: {options.frames} is no bag, so it has no topics"
        )
    settings = {
        "bag" if bag else "folder": str(options.frames.absolute()),
        "every": options.every,
        "kind": options.kind,
        "score": options.score,
        "width": options.width,
        "method": options.method,
        "join": "false" if options.no_join else "true",
        "out": str(options.out),
        **topics,
    }
    progress = _Progress()
    order = RunOrder(
        tree=find_tree(TREE), cell=find_cell("bag" if bag else "frames"), settings=settings
    )
    try:
        result = run_tree(order, [progress.on_event]).result
    except UsageError as error:
        raise UsageError(_in_own_words(error, order)) from error
    if result.outcome == "success" or progress.unreadable:
        sys.stdout.write(f"written to {options.out}: {PAGE}, {FRUIT}, {FINDS} and {PICTURES}\n")
    if result.outcome == "success":
        return 0
    if result.interrupted:
        there = (options.out / PAGE).is_file()
        what = f"{options.out} holds the results so far" if there else "nothing was measured yet"
        sys.stderr.write(f"interrupted: {what}\n")
        return 130
    if progress.unreadable:
        sys.stderr.write(
            f"{progress.unreadable} of the frames could not be read: {options.out / PAGE} has the reasons\n"
        )
        return 2
    why = (
        [reason.message for reason in result.reason.leaves()] if result.reason else [result.outcome]
    )
    sys.stderr.write(f"pomona measure: {why[-1]}\n")
    return 2


def _is_bag(path: Path) -> bool:
    """Return True for a bag's file, or a folder with one, even without the metadata of a bag."""
    names = [part.name for part in path.iterdir()] if path.is_dir() else [path.name]
    return "metadata.yaml" in names or any(name.lower().endswith(BAGS) for name in names)


def _in_own_words(error: UsageError, order: RunOrder) -> str:
    """Return the problem without the tree, the cell and the settings that the user has not written."""
    findings: Sequence[Finding] = getattr(error.__cause__, "findings", ())
    ours = str(order.tree), str(order.cell)
    theirs = [found for found in findings if found.path not in ours]
    lines = [_line(found, ours) for found in theirs or findings]
    return "\n".join(dict.fromkeys(lines)) or str(error)


def _line(found: Finding, ours: Sequence[str]) -> str:
    setting = found.path.removeprefix("--set ")
    if setting == found.path and found.path not in ours:
        return format_finding(found)
    name, _, text = setting.partition("=") if setting != found.path else ("", "", "")
    option = (
        f"--{name}{'-topic' if name in TOPICS else ''} {text}: "
        if name not in ("", "folder", "bag")
        else ""
    )
    said = re.sub(r"^(?:devices\.)?(?:camera|[A-Z]\w+)(?:\.\w+)?: |^[A-Z]\w+\.", "", found.message)
    said = re.sub(r"the option '(\w+)'", r"--\1-topic", said)
    return f"{option}{said}" + (f": {found.hint}" if found.hint else "")


class _Progress:
    """A line for each frame, in the words of CountFruit."""

    def __init__(self) -> None:
        self.unreadable = 0
        self._said = ""

    def on_event(self, event: Event) -> None:
        if isinstance(event, PortWritten) and event.key == "/unreadable_frames":
            self.unreadable = event.value
        if (
            isinstance(event, NodeChanged)
            and "CountFruit" in event.path
            and event.feedback not in ("", self._said)
        ):
            self._said = event.feedback
            sys.stdout.write(f"{event.feedback}\n")
            sys.stdout.flush()
