"""Reading a YAML text again that was changed here and there: items of lists whose lines stayed are not parsed again.

In the text that is parsed, each of them is one short mapping, `- 0:`, and blank lines. Where the parser meets exactly
this mapping, the text before it has not changed what an item's lines mean there, and the item's nodes take its place;
wherever it meets anything else, all is read as if nothing were known.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from pomona.executive.values.findings import Findings, Source
from pomona.executive.values.yaml_nodes import (
    LOADER,
    MAX_CHARACTERS,
    MAX_NODES,
    Composer,
    Unreadable,
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
)

_KEY = "0"


@dataclass(slots=True, eq=False)
class _Item:
    """A mapping in a list whose lines, `first` to `last`, have only moved.

    Attributes:
        depth: how deep it stands.
        by: how many lines it has moved.
        met: the mapping that stood for it; None before the parser has come there.
    """

    node: YamlMapping
    depth: int
    first: int
    last: int
    by: int = 0
    met: YamlMapping | None = None


def read_again(source: Source, findings: Findings, before: YamlNode, wrong: Collection[int]) -> YamlNode | None:
    """The text's nodes, partly those of an older text, which have moved into this one and are of no use there any more.

    Args:
        source: the new text.
        findings: get what is wrong with what was parsed again.
        before: root of the older text's nodes.
        wrong: lines of the older text with findings, which are parsed again.

    Returns:
        what `read_yaml` would; None when it must be asked.
    """
    if len(source.text) > MAX_CHARACTERS or not (_counted_alike(source) and _counted_alike(before.source)):
        return None
    items = list(_Unchanged(source, before.source, wrong).below(before, 0))
    if not items:
        return None
    own = Findings()
    loader: Any = None
    try:
        loader = LOADER("\n".join(_with_stand_ins(source, items)))
        composer = _Composer(source, own, loader, items)
        root = composer.document()
    except (Unreadable, yaml.YAMLError, UnicodeError, ValueError):
        return None
    finally:
        if loader is not None:
            loader.dispose()
    if composer.count + sum(map(_take, items)) > MAX_NODES:
        source.comments.clear()
        source.comment_lines.clear()
        return None
    findings.extend(own.sorted())
    return root


def _counted_alike(source: Source) -> bool:
    """Whether the parser and we count the text's lines alike, which differ in rare characters that end a line."""
    text, lines = source.text, source.lines
    return len(lines) == text.count("\n") + (not text.endswith("\n")) and bool(text)


class _Unchanged:
    """Finds the items that stay: the outermost whose lines are as they were."""

    def __init__(self, source: Source, before: Source, wrong: Collection[int]) -> None:
        self.before, self.wrong = before, sorted(wrong)
        old, new = before.lines, source.lines
        shorter, same = min(len(old), len(new)), 0
        while same < shorter and old[same] == new[same]:
            same += 1
        self.head = same
        """Lines that are the same from the beginning."""
        same = 0
        while same < shorter - self.head and old[-1 - same] == new[-1 - same]:
            same += 1
        self.tail = len(old) - same
        """Lines behind this one are the same up to the end."""
        self.by = len(new) - len(old)
        self.ends = 0 if source.text.endswith("\n") else len(new)
        """The line that the text's end cuts off, which is a place that nodes may end at; 0 when there is none."""

    def below(self, node: YamlNode, depth: int) -> Iterator[_Item]:
        """The items in a node."""
        if isinstance(node, YamlMapping):
            for _, value in node.entries.values():
                if not isinstance(value, YamlScalar):
                    yield from self.below(value, depth + 1)
        elif isinstance(node, YamlList):
            for inner in node.items:
                item = self.item(inner, depth + 1)
                if item is not None:
                    yield item
                elif not isinstance(inner, YamlScalar):
                    yield from self.below(inner, depth + 1)

    def item(self, node: YamlNode, depth: int) -> _Item | None:
        """The node as an item that stays."""
        source = self.before
        if not isinstance(node, YamlMapping) or node.source is not source:
            return None  # no node, or gone over into another text
        if source.excerpt(node.line)[: node.column - 1].strip() != "-":
            return None
        last = node.end_line
        if not source.excerpt(last)[: node.end_column - 1].strip():
            last -= 1  # it ends where the next word begins
        while last > node.line and (last in source.comment_lines or not source.excerpt(last).strip()):
            last -= 1
        stands = max(last + 1, node.end_line) <= self.head  # with what follows, which may have become a part of it
        if not stands and node.line <= self.tail:
            return None
        by = 0 if stands else self.by
        if last + by == self.ends or _ends_in_lines(node) or any(node.line <= line <= last for line in self.wrong):
            return None
        return _Item(node, depth, node.line, last, by)


def _ends_in_lines(node: YamlNode) -> bool:
    """Whether a node's last text has several lines: what follows it may belong to it."""
    last: YamlNode | None = node
    while isinstance(last, YamlMapping | YamlList):
        last = _last(last)
    return last is not None and last.line != last.end_line


def _last(node: YamlMapping | YamlList) -> YamlNode | None:
    """The last value in a collection."""
    if isinstance(node, YamlList):
        return node.items[-1] if node.items else None
    return next(reversed(node.entries.values()))[1] if node.entries else None


def _with_stand_ins(source: Source, items: list[_Item]) -> list[str]:
    """The text's lines, with something short in place of the items."""
    lines = [*source.lines, ""] if source.text.endswith("\n") else list(source.lines)
    for item in items:
        first, last = item.first + item.by, item.last + item.by
        lines[first - 1] = f"{lines[first - 1][: item.node.column - 1]}{_KEY}:"
        lines[first:last] = [""] * (last - first)
    return lines


class _Composer(Composer):
    def __init__(self, source: Source, findings: Findings, loader: Any, items: list[_Item]) -> None:
        super().__init__(source, findings, loader, "a tree file")
        self.standing = {(item.first + item.by, item.node.column): item for item in items}
        self.items = items

    def node(self, event: Any, depth: int) -> YamlNode:
        node = super().node(event, depth)
        if isinstance(node, YamlMapping):
            item = self.standing.get((node.line, node.column))
            if item is not None and depth == item.depth and _stands_in(node):
                item.met = node
                return item.node
        return node

    def find_comments(self, written: Sequence[str]) -> None:
        if any(item.met is None for item in self.items):
            raise Unreadable
        lines, source = list(written), self.source
        for item in self.items:
            known, by = item.node.source, item.by
            for line in range(item.first, item.last + 1):
                lines[line + by - 1] = ""
                if line in known.comments:
                    source.comments[line + by] = known.comments[line]
                if line in known.comment_lines:
                    source.comment_lines.add(line + by)
        super().find_comments(lines)


def _stands_in(node: YamlMapping) -> bool:
    value = node.get(_KEY)
    return len(node.entries) == 1 and isinstance(value, YamlScalar) and value.plain and not value.text


def _take(item: _Item) -> int:
    """Let an item's nodes stand in the new text; how many there are more than stood for them."""
    root, met, by = item.node, item.met, item.by
    assert met is not None
    source, count = met.source, -3
    end: YamlNode | None = root
    while isinstance(end, YamlMapping | YamlList) and _is_block(end):
        end.end_line, end.end_column = met.end_line - by, met.end_column
        end = _last(end)
    stack: list[YamlNode] = [root]
    while stack:
        node = stack.pop()
        node.source = source
        node.line += by
        node.end_line += by
        count += 1
        if isinstance(node, YamlMapping):
            for key, value in node.entries.values():
                stack += (key, value)
        elif isinstance(node, YamlList):
            stack += node.items
    return count


def _is_block(node: YamlNode) -> bool:
    """Whether a collection is written in lines of its own, not in brackets: then it ends where the next word begins."""
    return node.source.excerpt(node.line)[node.column - 1] not in "{["
