"""The tree of a record, drawn as `pomona show --svg` draws it; after a reload with the recorded differences."""

from __future__ import annotations

import re
from pathlib import Path

from pomona.executive.errors import PomonaError
from pomona.executive.language.check import read_document
from pomona.executive.language.read import read
from pomona.executive.recording.folder import EVENTS, events_file
from pomona.executive.recording.plain_file import is_plain, parse_object
from pomona.executive.recording.scan import scan
from pomona.tools.dashboard.drawing import show_svg

MOST_TREE = 1_000_000  # bytes of a tree file that is drawn
_HUNK = re.compile(r"@@ -(\d{1,9})(?:,(\d{1,9}))? \+\d+(?:,(\d{1,9}))? @@")
_BEGINS = (b'{"event":"RunStarted"', b'{"event":"TreeChanged"')


def drawing(folder: Path) -> str | None:
    """Return the picture (SVG), or None for a record without a tree that can be drawn."""
    path = folder / "tree.yaml"
    if not is_plain(path) or path.stat().st_size > MOST_TREE:
        return None
    try:
        document = read_document(path)
    except (PomonaError, OSError):
        return None
    return None if document.main.main is None else show_svg(document)


def redrawing(folder: Path, until: float) -> str | None:
    """Return the picture (SVG) of the tree at a time of the run [s]; None for a record without a tree to draw."""
    first = drawing(folder)
    if first is None or until <= 0.0:
        return first
    text = (folder / "tree.yaml").read_text("utf-8")
    path = ""
    for found in scan(events_file(folder), topics=EVENTS.__eq__):
        if found.content.startswith(_BEGINS):
            event = parse_object(found.content)
            path = str(event.get("tree_path", path))
            if float(event.get("t", 0.0)) <= until:
                text = patched(text, str(event.get("difference", "")), path)
    document = read(text[:MOST_TREE], folder / "tree.yaml")
    return first if document.main.main is None else show_svg(document)


def patched(text: str, difference: str, name: str) -> str:
    """Return a text after the changes of the file `name` in a unified diff without context."""
    lines = text.splitlines()
    rows = difference.splitlines()
    at = 0
    here = False
    shift = 0
    while at < len(rows):
        hunk = _HUNK.match(rows[at])
        if hunk is None:
            if rows[at].startswith("--- "):
                here = rows[at] == f"--- {name}"
                shift = 0
            at += 1
            continue
        old, new = (int(count) if count else 1 for count in hunk.group(2, 3))
        if here:
            first = int(hunk[1]) + shift - (old > 0)
            lines[first : first + old] = [
                row[1:] for row in rows[at + 1 + old : at + 1 + old + new]
            ]
            shift += new - old
        at += 1 + old + new
    return "".join(f"{line}\n" for line in lines)
