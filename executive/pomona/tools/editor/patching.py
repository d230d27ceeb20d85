"""Changes of a tree file's text: lines and values taken out and put in; everything else stays byte for byte."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from pomona.executive.values.findings import Findings, Source
from pomona.executive.values.yaml_nodes import (
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
    read_yaml,
)
from pomona.tools.editor.format import STEP
from pomona.tools.editor.written_tree import EditError, WrittenNode, WrittenTree, values_in

IN_FLOW = re.compile(r"[,\[\]{}]")  # characters that end a plain text in braces
_COLON = re.compile(r"[ \t]*:(?=\s|$|[,\[\]{}\"'])")


@dataclass(frozen=True, slots=True)
class LiftedNode:
    """A node taken out of its place: lines without the indentation of its first line, and the comments above it."""

    comments: tuple[str, ...]
    lines: tuple[str, ...]
    column: int  # in which the first line began

    def indented(self, column: int, lead: str = "") -> list[str]:
        """Return its lines for a place: the first character stands in this column, behind `lead`."""
        left = column - len(lead)
        rest = [shifted(line, column - self.column) for line in self.lines[1:]]
        return [
            *(" " * left + comment for comment in self.comments),
            " " * left + lead + self.lines[0],
            *rest,
        ]


def shifted(line: str, by: int) -> str:
    """Return a line with more or less indentation. Raises EditError: a tab indents it."""
    bare = line.lstrip(" ")
    if by and bare[:1] == "\t":
        raise EditError("a tab indents a line of this node; replace it by spaces")
    return " " * max(0, len(line) - len(bare) + by) + bare if line else line


def indented(lines: Sequence[str], column: int) -> list[str]:
    """Return lines further to the right; empty ones stay empty."""
    return [" " * column + line if line else line for line in lines]


@dataclass(slots=True, eq=False)
class TextPatch:
    """Changes of one text that ends with a line break, all given by places in the text before."""

    tree: WrittenTree
    changes: list[tuple[int, int, str]] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)  # comments that are taken out on purpose

    def result(self) -> str:
        """Return the text with all changes. Raises EditError: two of them overlap."""
        text = self.tree.text
        out = []
        at = 0
        for start, end, new in sorted(
            self.changes, key=lambda change: (change[0], change[1] > change[0])
        ):
            if start < at:
                raise EditError("two parts of this edit change the same place")
            out += [text[at:start], new]
            at = end
        return "".join([*out, text[at:]])

    def replace(self, start: int, end: int, new: str) -> None:
        """Put a text in the place of another."""
        self.changes.append((start, end, new))

    # ------------------------------------------------------------------------------------------------- lines

    def insert_lines(self, row: int, lines: Sequence[str]) -> None:
        """Put lines before a line."""
        at = self.tree.starts[row]
        self.replace(at, at, "".join(line + self.tree.eol for line in lines))

    def delete_lines(self, first: int, last: int) -> None:
        """Take lines out, with their line breaks."""
        self.replace(self.tree.starts[first], self.tree.starts[last + 1], "")

    def drop_comments(self, first: int, last: int) -> None:
        """Note that the comments of these lines are taken out on purpose."""
        found = self.tree.source.comments
        self.dropped += [found[row + 1] for row in range(first, last + 1) if row + 1 in found]

    # ------------------------------------------------------------------------------------------------- regions

    def leading(self, row: int, column: int) -> int:
        """Return the first of the comment lines directly above a line that belong to it, or the line itself."""
        tree = self.tree
        while row > 0 and tree.is_comment(row - 1) and tree.indent(row - 1) <= column:
            row -= 1
        return row

    def trailing(self, row: int, column: int) -> int:
        """Return the last of the comment lines directly below a line that stand deeper than a column, or the line."""
        tree = self.tree
        while (
            row + 1 < len(tree.starts)
            and tree.is_comment(row + 1)
            and tree.indent(row + 1) > column
        ):
            row += 1
        return row

    def item_rows(self, holder: YamlList, index: int) -> tuple[int, int, int]:
        """Return the lines of an item of a list with dashes: the first comment's, the dash's, the last.

        Raises EditError: it does not stand on lines of its own.
        """
        tree = self.tree
        item = holder.items[index]
        column = holder.column - 1
        floor = tree.row(tree.end(holder.items[index - 1])) if index else holder.line - 2
        row = item.line - 1
        while row > floor and tree.line(row)[: column + 1].lstrip(" ") != "-":
            row -= 1
        if row <= floor:
            raise EditError("this list item does not stand on lines of its own; edit it as text")
        last = max(row, tree.row(tree.end(item)))
        return self.leading(row, column), row, self.trailing(last, column)

    def entry_rows(self, key: YamlScalar, value: YamlNode) -> tuple[int, int, int]:
        """Return the lines of a key and its value: the first comment's, the key's, the last."""
        tree = self.tree
        row = key.line - 1
        first = self.leading(row, key.column - 1) if tree.indent(row) == key.column - 1 else row
        last = max(tree.row(tree.end(value)), tree.row(tree.end(key)))
        return first, row, self.trailing(last, key.column - 1)

    def rows_of(self, node: WrittenNode) -> tuple[int, int, int]:
        """Return the lines of a node: the first comment's, the dash's or the key's, the last."""
        step = node.path[-1]
        if isinstance(node.holder, YamlList):
            return self.item_rows(node.holder, int(step))
        return self.entry_rows(*node.holder.entries[str(step)])

    def after_colon(self, key: YamlScalar) -> int | None:
        """Return the offset behind the colon of a key; None when it has none (`{Beep}`)."""
        found = _COLON.match(self.tree.text, self.tree.end(key))
        return found.end() if found else None

    # ------------------------------------------------------------------------------------------------- entries

    def set_entry(self, at: YamlMapping, word: str, value: Snippet) -> None:
        """Give a key of a mapping a value; a new key comes last."""
        entry = at.entries.get(word)
        if entry is not None:
            self.set_value(at, *entry, value)
        elif self.tree.is_flow(at):
            self.add_in_flow(at, f"{word}: {value.flow()}")
        elif id(at) in self.tree.pairs:
            self.replace(self.tree.start(at), self.tree.start(at), "{")
            self.replace(self.tree.end(at), self.tree.end(at), f", {word}: {value.flow()}}}")
        else:
            self.add_entry(at, value.below(word))

    def add_entry(self, at: YamlMapping, lines: Sequence[str]) -> None:
        """Put lines behind the last entry of a mapping without braces."""
        last = self.trailing(self.tree.row(self.tree.end(at)), at.column - 1)
        self.insert_lines(last + 1, indented(lines, at.column - 1))

    def add_in_flow(self, at: YamlNode, new: str) -> None:
        """Put an item last in braces or brackets."""
        items = values_in(at)
        if items:
            end = max(self.tree.end(item) for item in items[-2:])
            self.replace(end, end, f", {new}")
        else:
            self.replace(self.tree.start(at) + 1, self.tree.end(at) - 1, new)

    def set_value(self, at: YamlMapping, key: YamlScalar, old: YamlNode, value: Snippet) -> None:
        """Put a value in the place of another."""
        tree = self.tree
        start = tree.start(old)
        end = tree.end(old)
        colon = self.after_colon(key)
        inside = tree.is_flow(at) or id(at) in tree.pairs
        flow = inside or value.on_one_line
        head, *rest = [f": {value.flow() if inside else value.line}"] if flow else value.below("")
        new = head[1:]
        if colon is None:
            self.replace(tree.end(key), tree.end(key), head)
        elif start == end:
            self.replace(colon, colon, new)
        elif old.line == key.line or inside:
            self.replace(start if flow else colon, end, new[1:] if flow else new)
        else:
            last = self.entry_rows(key, old)[2]
            self.drop_comments(key.line, last)
            self.delete_lines(key.line, last)
            self.replace(colon, colon, new)
            end = tree.line_end(key.line - 1)
        if rest:
            row = tree.row(max(end, tree.end(key))) + 1
            self.insert_lines(row, indented(rest, key.column - 1))

    def remove_entry(self, at: YamlMapping, word: str) -> None:
        """Take a key and its value out of a mapping. Raises EditError: a comment would be lost."""
        tree = self.tree
        names, (key, value) = list(at.entries), at.entries[word]
        if tree.is_flow(at):
            pairs = [(tree.start(k), max(tree.end(k), tree.end(v))) for k, v in at.entries.values()]
            self.remove_in_flow(at, pairs, names.index(word))
            return
        first, row, last = self.entry_rows(key, value)
        self.drop_comments(first, last)
        if tree.indent(row) == key.column - 1:
            self.delete_lines(first, last)
        elif len(names) > 1 and tree.line(row)[: key.column - 1].strip(" ") == "-":
            follower = at.entries[names[1]][0]
            kept = [
                " " * tree.indent(row) + tree.line(n).lstrip(" ")
                for n in range(last + 1, follower.line - 1)
            ]
            self.insert_lines(row, [line for line in kept if line.strip()])
            self.replace(tree.start(key), tree.start(follower), "")
        else:
            raise EditError(f"'{word}' does not stand on a line of its own; edit it as text")

    def remove_in_flow(self, at: YamlNode, spans: Sequence[tuple[int, int]], index: int) -> None:
        """Take an item out of braces or brackets, with its comma."""
        (start, end), count = spans[index], len(spans)
        if count == 1:
            start = self.tree.start(at) + 1
            end = self.tree.end(at) - 1
        elif index + 1 < count and not (index and self._stands_between(spans, index)):
            end = spans[index + 1][0]
        else:
            start = spans[index - 1][1]
        self.replace(start, end, "")

    def _stands_between(self, spans: Sequence[tuple[int, int]], index: int) -> bool:
        """Return True if an item is the last one of a line and not the first: the next line must stay apart."""
        before = spans[index - 1][1]
        first = spans[index][0]
        after = spans[index + 1][0]
        return self.tree.row(before) == self.tree.row(first) != self.tree.row(after)


@dataclass(frozen=True, slots=True, eq=False)
class Snippet:
    """A value or a node that comes from outside, as YAML."""

    tree: WrittenTree
    at: YamlNode
    comments: tuple[str, ...] = ()  # lines of comment above it

    @property
    def on_one_line(self) -> bool:
        """Return True if it can stand behind a colon as it is written."""
        block = not isinstance(self.at, YamlScalar) and not self.tree.is_flow(self.at)
        return not block and self.at.line == self.at.end_line and not self.comments

    @property
    def line(self) -> str:
        """The value as written, on one line. Raises EditError: a comment behind it has no place."""
        if self.tree.source.comments:
            comment = next(iter(self.tree.source.comments.values()))
            raise EditError(
                f"a value on one line is given without a comment: take '# {comment}' out; `comment` sets one"
            )
        return self.tree.raw(self.at)

    def lifted(self) -> LiftedNode:
        """Return it as a node without a place."""
        raw = (
            self.tree.text[self.tree.start(self.at) :].rstrip().split("\n")
        )  # a comment may stand behind it
        return LiftedNode(self.comments, tuple(raw), self.at.column - 1)

    def flow(self) -> str:
        """Return it on one line, for braces. Raises EditError: it holds comments."""
        if self.tree.source.comments:
            raise EditError("it holds comments, for which braces on one line have no place")
        return in_braces(self.tree, self.at)

    def below(self, word: str) -> list[str]:
        """Return the lines of an entry `word: value`."""
        if self.on_one_line:
            return [f"{word}: {self.line}"]
        if isinstance(self.at, YamlScalar) and self.tree.raw(self.at)[:1] in ("|", ">"):
            first, *rest = self.lifted().lines
            return [f"{word}: {first}", *rest]
        return [f"{word}:", *self.lifted().indented(STEP)]


def in_braces(tree: WrittenTree, at: YamlNode) -> str:
    """Return a value on one line, as it stands in braces; quotes stay, comments do not."""
    if isinstance(at, YamlScalar):
        raw = tree.raw(at)
        one_line = at.line == at.end_line and not (not at.plain and raw[:1] in "|>")
        if at.is_null:
            return raw
        return (
            raw
            if one_line and not (at.plain and IN_FLOW.search(raw))
            else json.dumps(at.text, ensure_ascii=False)
        )
    if tree.is_flow(at) and at.line == at.end_line:
        return tree.raw(at)
    if isinstance(at, YamlList):
        return "[" + ", ".join(in_braces(tree, item) or "null" for item in at.items) + "]"
    assert isinstance(at, YamlMapping)
    pairs = (f"{tree.raw(key)}: {in_braces(tree, value)}" for key, value in at.entries.values())
    return "{" + ", ".join(pairs) + "}"


def read_snippet(text: str, what: str, tree: WrittenTree) -> Snippet:
    """Return a value given as YAML. Raises EditError: it is none."""
    text = text.replace("\r\n", "\n").rstrip() + "\n"
    source = Source("", text)
    findings = Findings()
    at = read_yaml(source, findings, what) if text.strip() else None
    found = findings.sorted()
    if at is None or found:
        raise EditError(f"{what} is no YAML: {found[0].message}" if found else f"{what} is empty")
    written = WrittenTree("", tree.types)
    written.text = text
    written.source = source
    written.starts = [0, *(match.end() for match in re.finditer("\n", text))]
    above = [written.line(row).strip() for row in range(at.line - 1)]
    if text[written.end(at) :].strip() or any(line and line[0] != "#" for line in above):
        behind = text[written.end(at) :].strip()
        if not behind.startswith("#") or "\n" in behind:
            raise EditError(f"{what} is one value and nothing else")
    return Snippet(written, at, tuple(filter(None, above)))


def lift(patch: TextPatch, node: WrittenNode) -> LiftedNode:
    """Return a node with its comments, as it stands; nothing is taken out."""
    tree = patch.tree
    at = node.at
    start = tree.start(at)
    column = at.column - 1
    if tree.is_flow(node.holder):
        raw = tree.raw(at)
        text = f"{{{raw}}}" if isinstance(at, YamlMapping) and not tree.is_flow(at) else raw
        return LiftedNode((), tuple(re.split(r"\r\n|[\n\r]", text)), column)
    first, head, last = patch.rows_of(node)
    comments = [tree.line(row).strip() for row in range(first, head)]
    behind = [row for row in range(head, at.line - 1) if row + 1 in tree.source.comments]
    comments += [tree.text[tree.comment_start(row) : tree.line_end(row)].rstrip() for row in behind]
    lines = [
        tree.text[start : tree.line_end(at.line - 1)],
        *(tree.line(row) for row in range(at.line, last + 1)),
    ]
    return LiftedNode(tuple(comments), tuple(lines), column)
