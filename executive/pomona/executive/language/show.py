"""Draw a tree as text for the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from pomona.executive.language.model import Document
from pomona.executive.language.outline import DrawnNode, outline


def show_text(document: Document, *, width: int = 120) -> str:
    """Return the tree as text, one node a line."""
    lines = [f"{document.main.name}  {document.main.description}".rstrip()]
    root = outline(document)
    if root is not None:
        lines += (text if len(text) <= width else text[: width - 1] + "…" for text in _lines(root, "", ""))
    return "\n".join(lines)


def _lines(branch: DrawnNode, joint: str, below: str) -> Iterator[str]:
    """Yield a node's line, with the joint to its parent, and the lines below it."""
    lead = f"{branch.lead}: " if branch.lead else ""
    details = " · ".join(filter(None, (branch.ports, *branch.modifiers)))
    comment = f"  # {branch.comment}" if branch.comment else ""
    yield f"{joint}{branch.type.symbol} {lead}{branch.name}{f'  {details}' if details else ''}{comment}"
    for child in branch.branches:
        last = child is branch.branches[-1]
        yield from _lines(child, below + ("└─ " if last else "├─ "), below + ("   " if last else "│  "))
