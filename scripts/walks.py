"""Measure the walks of one simulated pick: the files of Pomona that one tick, frame, wrench sample or cell file passes
through.

    python scripts/walks.py            # the table
    python scripts/walks.py --check    # 1 when a walk visits more files than its bound in scripts/size.json
    python scripts/walks.py --files    # also the files of each walk

A walk is a call of one function in a run of `pick_apple` on the simulated cell, seed 7; the cell file is read and
connected once more after the run, when all is imported. Files and functions are those of Python frames below `pomona/`;
compiled loops count as one call. Files are the median over the calls.
"""

from __future__ import annotations

import importlib
import json
import statistics
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

BOUNDS = Path(__file__).with_name("size.json")


@dataclass
class Walk:
    """One function, and the files and functions that its calls pass through."""

    name: str
    module: str
    attribute: str
    calls: int
    """Calls that are followed; a profiled call is slower."""
    skipped: int = 0
    """First calls that are not followed: they differ from those in the middle of a run."""
    files: list[frozenset[str]] = field(default_factory=list)
    functions: list[int] = field(default_factory=list)

    def follow(self) -> None:
        """Replace the function by one that notes the files of its calls."""
        owner: Any = importlib.import_module(self.module)
        *classes, name = self.attribute.split(".")
        for each in classes:
            owner = getattr(owner, each)
        setattr(owner, name, self._followed(getattr(owner, name)))

    def _followed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        seen = 0

        def call(*arguments: Any, **named: Any) -> Any:
            nonlocal seen
            seen += 1
            if seen <= self.skipped or len(self.files) >= self.calls:
                return function(*arguments, **named)
            visited: set[tuple[str, str]] = set()

            def note(frame: FrameType, event: str, _argument: object) -> None:
                code = frame.f_code
                if event == "call" and "/pomona/" in code.co_filename:
                    visited.add((code.co_filename.rpartition("/pomona/")[2], code.co_qualname))

            before = sys.getprofile()
            sys.setprofile(note)
            try:
                return function(*arguments, **named)
            finally:
                sys.setprofile(before)
                self.files.append(frozenset(file for file, _ in visited))
                self.functions.append(len(visited))

        return call


def walks() -> list[Walk]:
    """Return the walks, in the order of a pick."""
    return [
        Walk("tick", "pomona.executive.running.runner", "Runner._tick", calls=400),
        Walk("frame through Detect", "pomona.skills.shared.looking", "find_in_frame", calls=5),
        Walk("frame through Refine", "pomona.skills.refine", "_measure", calls=5),
        Walk(
            "wrench sample", "pomona.skills.grip.hold", "Hold._on_sample", calls=3000, skipped=150
        ),
    ]


def cell_walk() -> Walk:
    """Return the walk from the file of the simulated cell to connected devices."""
    from pomona.executive.cell.connect import load_cell
    from pomona.executive.files import find_cell

    walk = Walk("cell file", "pomona.executive.cell.connect", "load_cell", calls=1)
    walk._followed(load_cell)(find_cell("sim"), seed=7).close()
    return walk


def main(arguments: Sequence[str]) -> int:
    """Run the pick and print the table; return 1 when `--check` finds a walk above its bound."""
    from pomona.executive.execute import RunOrder, execute
    from pomona.executive.files import find_cell, find_tree

    followed = walks()
    for walk in followed:
        walk.follow()
    executed = execute(RunOrder(tree=find_tree("pick_apple"), cell=find_cell("sim"), seed=7))
    if executed.result.outcome != "success":
        sys.stderr.write(
            f"the pick ended with {executed.result.outcome}; a walk is measured on a pick that succeeds\n"
        )
        return 2
    followed.append(cell_walk())
    bounds: dict[str, float] = json.loads(BOUNDS.read_text("utf-8"))["bounds"]
    above = False
    for walk in followed:
        if not walk.files:
            sys.stderr.write(f"{walk.name}: {walk.module}.{walk.attribute} was not called\n")
            return 2
        files = statistics.median(len(each) for each in walk.files)
        bound = bounds.get(f"walk: {walk.name}", files)
        above |= files > bound
        functions = statistics.median(walk.functions)
        most = bounds.get(f"walk: functions of {walk.name}", functions)
        above |= functions > most
        mark = "  above its bound" if files > bound or functions > most else ""
        line = f"{walk.name:24} files {files:4g} (bound {bound:g})   functions {functions:4g}   calls {len(walk.files)}"
        sys.stdout.write(f"{line}{mark}\n")
        if "--files" in arguments:
            sys.stdout.writelines(
                f"    {file}\n" for file in sorted(frozenset().union(*walk.files))
            )
    return 1 if above and "--check" in arguments else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
