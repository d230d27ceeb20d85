"""The tree of a record, drawn as `pomona show --svg` draws it."""

from __future__ import annotations

from pathlib import Path

from pomona.executive.errors import PomonaError
from pomona.executive.language.check import read_document
from pomona.executive.recording.plain_file import is_plain
from pomona.tools.dashboard.drawing import show_svg

MOST_TREE = 1_000_000  # bytes of a tree file that is drawn


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
