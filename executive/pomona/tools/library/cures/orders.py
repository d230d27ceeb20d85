"""Other orders of the children of a sequence or a fallback, as changes of the file."""

from __future__ import annotations

from collections.abc import Iterator

from pomona.executive.language.model import TreeNode
from pomona.tools.library.cures.change import SingleChange, TextPiece, offset

ORDERED = ("sequence", "sequence_with_memory", "reactive_sequence", "fallback", "reactive_fallback")
MOST_MOVES = 2  # a child is moved over at most so many others


def moved(parent: TreeNode, child: int) -> Iterator[tuple[SingleChange, int]]:
    """Yield the orders in which one child stands elsewhere, each with the number of places that it moved."""
    if parent.kind not in ORDERED:
        return
    for distance in range(1, MOST_MOVES + 1):
        for target in (child + distance, child - distance):
            if 0 <= target < len(parent.children):
                order = list(range(len(parent.children)))
                order.insert(target, order.pop(child))
                yield ordered(parent, order), distance


def ordered(parent: TreeNode, order: list[int]) -> SingleChange:
    """Return the change that puts the children of a composite into another order: the old index of each."""
    texts = [_span(child) for child in parent.children]
    source = parent.key.source
    pieces = tuple(
        TextPiece(*texts[place], source.text[slice(*texts[index])])
        for place, index in enumerate(order)
        if place != index
    )  # fmt: skip
    labels = [child.label for child in parent.children]
    first = next((place for place, index in enumerate(order) if place != index), 0)
    return SingleChange(
        "order",
        f"{parent.kind} {parent.label}" if parent.name is not None else parent.kind,
        source.path,
        parent.children[first].key.line,
        ", ".join(labels[place] for place, index in enumerate(order) if place != index),
        ", ".join(labels[index] for place, index in enumerate(order) if place != index),
        1.0,
        {},
        pieces,
    )


def _span(node: TreeNode) -> tuple[int, int]:
    """Return where a node's text begins and ends: without the blanks behind it, with comments inside it."""
    text = node.key.source.text
    at = node.at
    start = offset(text, at.line, at.column)
    end = offset(text, at.end_line, at.end_column)
    return start, start + len(text[start:end].rstrip())
