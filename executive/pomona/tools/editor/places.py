"""Where the cursor stands in a tree file, also in one that is being written and is no YAML yet."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

_KEY = re.compile(r"(\s*)((?:-\s+)*)([A-Za-z_][\w]*)\s*:(?=\s|$)")
_DASHES = re.compile(r"(\s*)((?:-\s+)+|-$)")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Place:
    """The place of the cursor in a file."""

    parents: tuple[str, ...]  # keys around it, from the inside to the outside
    siblings: frozenset[str] = field(
        default_factory=frozenset
    )  # keys that stand beside it in the same mapping
    starts: bool = False  # it is the first of a list's item, or of a mapping
    key: str = ""  # the key before it on its line, when it is a value
    flow: bool = False  # it stands in braces or brackets on one line
    # the characters between `{` and the cursor, inside a text; None outside
    braces: str | None = None
    before: str = ""  # all of the line before the cursor

    @property
    def parent(self) -> str:
        """The key directly around it; empty at the top."""
        return self.parents[0] if self.parents else ""


def place_at(lines: Sequence[str], row: int, column: int) -> Place:
    """Return the place of a position, both from 0."""
    line = lines[row] if row < len(lines) else ""
    before = line[:column]
    quoted = _quote_before(before)
    braces = None
    if quoted is not None:
        inside = before[quoted + 1 :]
        if inside.rfind("{") > inside.rfind("}"):
            braces = inside[inside.rfind("{") + 1 :]
    found = _KEY.match(before)
    dashes = _DASHES.match(before)
    indent = len(before) - len(before.lstrip())
    at = len(found[1]) + len(found[2]) if found else len(dashes[0]) if dashes else indent
    dashed = bool(dashes) and not (found and not found[2])
    parents, siblings = _around(lines, row, at, dashed)
    if found is None:
        return Place(parents, siblings, dashed or not siblings, "", False, braces, before)
    key = found[3]
    opened = _open_flow(before[found.end() :])
    if opened is None:
        return Place(parents, siblings, False, key, False, braces, before)
    inner_parents, inner_siblings, inner_key = opened
    return Place(
        (*inner_parents, key, *parents), inner_siblings, False, inner_key, True, braces, before
    )


def word_at(line: str, column: int) -> tuple[str, int]:
    """Return the word under the cursor and its column; empty when there is none."""
    for found in _WORD.finditer(line):
        if found.start() <= column <= found.end():
            return found[0], found.start()
    return "", column


def _quote_before(text: str) -> int | None:
    """Where the quotes begin in which a text ends."""
    opened: int | None = None
    for index, character in enumerate(text):
        if opened is None:
            if character in "\"'" and (index == 0 or text[index - 1] in " {[,:-"):
                opened = index
        elif character == text[opened]:
            opened = None
    return opened


def _open_flow(text: str) -> tuple[tuple[str, ...], frozenset[str], str] | None:
    """Return keys around the end of a text in braces, keys beside it, and the key before it; None outside braces."""
    stack: list[tuple[str, set[str]]] = []
    key = ""
    start = 0
    quote = ""
    for index, character in enumerate(text):
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        elif character in "{[":
            stack.append((key, set()))
            key = ""
            start = index + 1
        elif character in "}]":
            if stack:
                stack.pop()
            key = ""
            start = index + 1
        elif character == ",":
            key = ""
            start = index + 1
        elif character == ":" and stack:
            key = text[start:index].strip()
            stack[-1][1].add(key)
    if not stack:
        return None
    around = tuple(name for name, _ in reversed(stack) if name)
    return around, frozenset(stack[-1][1] - {key}), key


def _around(
    lines: Sequence[str], row: int, at: int, dashed: bool
) -> tuple[tuple[str, ...], frozenset[str]]:
    """Return keys around a column of a line, from the inside to the outside, and keys beside it."""
    parents: list[str] = []
    siblings: set[str] = set()
    limit = _first_dash(lines[row] if row < len(lines) else "", at)
    item = dashed
    beside = not dashed
    for line in reversed(lines[:row]):
        found = _KEY.match(line)
        if found is None or line.lstrip().startswith("#"):
            continue
        first = len(found[1])
        column = len(found[1]) + len(found[2])
        if beside and column == at:
            siblings.add(found[3])
            beside = not found[2]
            limit = first
            item = bool(found[2])
        elif column < limit or (
            item and column == limit and not found[2]
        ):  # a list may stand as far left as its key
            parents.append(found[3])
            beside = False
            limit = first
            item = bool(found[2])
    siblings |= _below(lines, row, at)
    return tuple(parents), frozenset(siblings)


def _first_dash(line: str, at: int) -> int:
    """Return the column of the item's dash on a line; the column itself without one."""
    found = _DASHES.match(line)
    return len(found[1]) if found and len(found[0]) <= max(at, 1) + 1 and found[2] else at


def _below(lines: Sequence[str], row: int, at: int) -> set[str]:
    """Return keys of the same mapping that stand below."""
    found: set[str] = set()
    for line in lines[row + 1 :]:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        indent = len(line) - len(line.lstrip())
        if indent < at or (indent == at and line.lstrip().startswith("-")):
            break
        key = _KEY.match(line)
        if key is not None and not key[2] and len(key[1]) == at:
            found.add(key[3])
    return found
