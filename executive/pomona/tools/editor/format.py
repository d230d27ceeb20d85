"""One way to write a tree file: indentation, spacing and blank lines; words, quotes, columns and comments stay.

    formatted(text)    two spaces a level, lists indented below their key, `{a: 1, b: [2, 3]}`, one blank line at most,
                       one space behind a colon unless values are aligned, `5 s` behind `timeout`, `wait` and the like

Lines move as a whole, so that aligned columns stay aligned. The YAML content is the same before and after; otherwise
the text is not changed (`FormatError`).
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

import yaml

from pomona.executive.errors import PomonaError

STEP = 2
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_TIMED = frozenset(
    ["wait", "timeout", "delay", "cooldown", "within"]
)  # words whose value is a time

_JOINED = re.compile(r"^(\d+(?:\.\d+)?)(ms|s|min|h)$")
_OPENS = (yaml.FlowMappingStartToken, yaml.FlowSequenceStartToken)
_CLOSES = (yaml.FlowMappingEndToken, yaml.FlowSequenceEndToken)


class FormatError(PomonaError):
    """A text that is no YAML, or that cannot be formatted without a change of its content."""


def formatted(text: str) -> str:
    """Return the text, formatted; formatting it again changes nothing.

    Raises FormatError: it is no YAML, or could not be moved safely.
    """
    found = _formatted_once(text)
    before = text
    while found != before:  # values that were aligned may not be so at their new places
        found, before = _formatted_once(found), found
    return found


def _formatted_once(text: str) -> str:
    lines = [line.rstrip("\r") for line in text.split("\n")]
    try:
        root = yaml.compose("\n".join(lines), Loader=_LOADER)
        if root is None:
            return text
        layout = _Layout(lines)
        layout.place(root, 0)
        found = layout.written()
        same = _meaning(found) == _meaning(text) and _comments(found.split("\n")) == _comments(
            lines
        )
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise FormatError(f"it cannot be read as YAML: {error}") from error
    if not same:
        raise FormatError("it cannot be formatted without a change of its content")
    return found


class _Layout:
    """Where each line of a text shall begin."""

    def __init__(self, lines: list[str]) -> None:
        self.lines = lines
        self.old = [len(line) - len(line.lstrip()) for line in lines]
        self.new: dict[int, int] = {}
        self.follows: dict[
            int, int
        ] = {}  # lines in the middle of a value, by the line on which it begins
        self.verbatim: set[int] = set()

    def place(self, node: Any, indent: int) -> None:
        """Place the lines of a value whose block begins at a column."""
        line = node.start_mark.line
        if isinstance(node, yaml.ScalarNode) or node.flow_style:
            self.value(node)
        elif isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                self.new.setdefault(key.start_mark.line, indent)
                self.value(key)
                self.below(value, key.start_mark.line, indent)
        else:
            for item in node.value:
                at = item.start_mark.line
                dash = self.dash_before(at, line)
                self.new.setdefault(dash, indent)
                if at != dash and item.start_mark != item.end_mark:
                    self.new.setdefault(at, indent + STEP)
                self.place(item, indent + STEP)

    def below(self, value: Any, line: int, indent: int) -> None:
        if value.start_mark.index == value.end_mark.index:
            return
        if value.start_mark.line != line and (
            isinstance(value, yaml.ScalarNode) or value.flow_style
        ):
            self.new.setdefault(value.start_mark.line, indent + STEP)
        self.place(value, indent + STEP)

    def dash_before(self, line: int, first: int) -> int:
        while line > first and not self.lines[line].lstrip().startswith("-"):
            line -= 1
        return line

    def value(self, node: Any) -> None:
        """A scalar, or a value in braces or brackets: lines in its middle move with the one on which it begins."""
        first = node.start_mark.line
        last = node.end_mark.line
        block = isinstance(node, yaml.ScalarNode) and node.style in ("|", ">")
        if block:
            last -= node.end_mark.column == 0
        for line in range(first + 1, last + 1):
            if line < len(self.lines):
                self.follows.setdefault(line, first)
                if isinstance(node, yaml.ScalarNode):
                    self.verbatim.add(line)

    def written(self) -> str:
        spaced = _spaced(self.lines)
        out: list[str] = []
        for number, line in enumerate(spaced):
            bare = line.lstrip() if number in self.verbatim else line.strip()
            if not bare:
                if number in self.verbatim or (out and out[-1] != ""):
                    out.append("")
                continue
            out.append(" " * self.column(number, bare) + bare)
        return "\n".join(out).strip("\n") + "\n"

    def column(self, number: int, bare: str) -> int:
        if number in self.follows:
            first = self.follows[number]
            return max(
                0,
                self.old[number] + self.column(first, self.lines[first].strip()) - self.old[first],
            )
        if number in self.new:
            return self.new[number]
        if not bare.startswith("#"):
            return self.old[number]
        after = next((n for n in range(number + 1, len(self.lines)) if n in self.new), None)
        before = next((n for n in range(number - 1, -1, -1) if n in self.new), None)
        fits = [n for n in (after, before) if n is not None and self.old[n] == self.old[number]]
        near = fits[0] if fits else after if after is not None else before
        return self.old[number] if near is None else self.new[near]


def _spaced(lines: list[str]) -> list[str]:
    """Return the lines with the spaces that belong around `{`, `[`, `,`, `:`, `-` and before a comment."""
    cuts: dict[int, list[tuple[int, int, str]]] = {}

    def between(one: Any, other: Any, fewest: int, most: int | None) -> None:
        """Set the number of spaces between two tokens on one line."""
        end = one.end_mark
        start = other.start_mark
        if end.line == start.line and end.column <= start.column:
            gap = start.column - end.column
            wanted = max(gap, fewest) if most is None else min(max(gap, fewest), most)
            if wanted != gap and not lines[end.line][end.column : start.column].strip():
                cuts.setdefault(end.line, []).append((end.column, start.column, " " * wanted))

    tokens = [
        token for token in yaml.scan("\n".join(lines), Loader=_LOADER) if not _is_empty(token)
    ]
    begins = {
        (b.start_mark.line, b.start_mark.column)
        for a, b in pairwise(tokens)
        if isinstance(a, yaml.ValueToken)
    }
    for key, _, value in zip(tokens, tokens[1:], tokens[2:], strict=False):
        if (
            isinstance(key, yaml.ScalarToken)
            and key.value in _TIMED
            and isinstance(value, yaml.ScalarToken)
        ):
            joined = re.fullmatch(_JOINED, value.value) if value.plain else None
            if joined is not None:
                at = value.start_mark.column + joined.end(1)
                cuts.setdefault(value.start_mark.line, []).append((at, at, " "))
    for one, other in pairwise(tokens):
        if isinstance(other, (yaml.FlowEntryToken, *_CLOSES)) or isinstance(one, _OPENS):
            between(one, other, 0, 0)
        elif isinstance(one, yaml.BlockEntryToken):
            between(one, other, 1, 1)
        elif isinstance(one, yaml.FlowEntryToken):
            between(one, other, 1, None)
        elif isinstance(one, yaml.ValueToken):
            line = other.start_mark.line
            column = other.start_mark.column
            aligned = {(line - 1, column), (line + 1, column)} & begins
            between(one, other, 1, None if aligned else 1)
        elif isinstance(other, yaml.ValueToken):
            between(one, other, 0, 0)
    out = []
    for number, line in enumerate(lines):
        for start, end, spaces in sorted(cuts.get(number, ()), reverse=True):
            line = line[:start] + spaces + line[end:]
        out.append(line)
    ends = {token.end_mark.line: token.end_mark.column for token in tokens if token.end_mark.column}
    return [
        _comment_apart(line, lines[number], ends.get(number)) for number, line in enumerate(out)
    ]


def _comment_apart(line: str, before: str, end: int | None) -> str:
    """Keep at least two spaces between the content of a line and its comment."""
    if end is None or not re.match(r"\s+#", before[end:]):
        return line
    comment = before[end:].lstrip()
    said = line[: len(line) - len(before[end:])].rstrip()
    return f"{said}{' ' * max(len(before[end:]) - len(comment), 2)}{comment}"


def _is_empty(token: Any) -> bool:
    """Return True if a token stands for nothing in the text: the start of a block, of a key."""
    return bool(token.start_mark.index == token.end_mark.index) or isinstance(token, yaml.KeyToken)


def _meaning(text: str) -> object:
    """Return the content that a YAML reader finds in a text, quotes included, marks excluded."""
    kinds = (yaml.ScalarEvent,)
    return [
        (
            type(event).__name__,
            _JOINED.sub(r"\1 \2", event.value),
            event.style if isinstance(event, kinds) else None,
        )
        if isinstance(event, kinds)
        else (type(event).__name__, getattr(event, "flow_style", None), getattr(event, "tag", None))
        for event in yaml.parse(text, Loader=_LOADER)
    ]


def _comments(lines: list[str]) -> list[str]:
    """Everything behind a # that begins a line or follows a blank, in order."""
    return [found[1].rstrip() for line in lines if (found := re.search(r"(?:^|\s)(#.*)", line))]
