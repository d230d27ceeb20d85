"""Files of a package that a call passes through, for the READMEs that follow one thing through a package."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any


def files_visited(package: Path, call: Callable[[], Any]) -> set[str]:
    """Return the files of a package, relative to it, whose functions a call runs; compiled loops do not count."""
    seen: set[str] = set()

    def note(frame: FrameType, event: str, _argument: object) -> None:
        if (
            event == "call"
            and frame.f_code.co_name != "<module>"
            and frame.f_code.co_filename.startswith(f"{package}/")
        ):
            seen.add(str(Path(frame.f_code.co_filename).relative_to(package)))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(before)
    return seen


def files_named(page: str) -> set[str]:
    """Return the Python files that a page names, as it writes them."""
    return set(re.findall(r"(?<![\w/.])((?:\w+/)*\w+\.py)", page))


def steps_of(page: str, heading: str) -> list[str]:
    """Return the files in the numbered rows of the table under a heading."""
    part = page.split(f"## {heading}")[1].split("\n## ")[0]
    return re.findall(r"^\| \d+ \| ([\w/]+\.py) \|", part, re.MULTILINE)


def names_defined(package: Path, page: str) -> set[str]:
    """Return the names of classes, methods and functions in code style that no file of the package defines."""
    texts = "\n".join(path.read_text("utf-8") for path in package.rglob("*.py"))
    named = {name.split(".")[-1] for name in re.findall(r"`([A-Za-z_][\w.]*)`", page)}
    return {name for name in named if not re.search(rf"\b{name}\b", texts)}
