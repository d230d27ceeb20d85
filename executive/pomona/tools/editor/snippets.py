"""YAML on its way into a tree file: a value that comes from outside, or a node that leaves its place."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar
from pomona.tools.editor.format import STEP
from pomona.tools.editor.written_tree import EditError, WrittenTree

IN_FLOW = re.compile(r"[,\[\]{}]")  # characters that end a plain text in braces
_PLAIN = re.compile(r"[A-Za-z_µ°/(][^:#,\[\]{}\"'\n\t]*")


@dataclass(frozen=True, slots=True, eq=False)
class Snippet:
    """A value or a node as YAML without a place."""

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

    def flow(self) -> str:
        """Return it on one line, for braces. Raises EditError: it holds comments."""
        if self.tree.source.comments:
            raise EditError("it holds comments, for which braces on one line have no place")
        return in_braces(self.tree, self.at)

    def indented(self, column: int, lead: str = "") -> list[str]:
        """Return its lines for a place: the first character stands in this column, behind `lead`."""
        left = " " * (column - len(lead))
        first, *rest = self.tree.text[self.tree.start(self.at) :].removesuffix("\n").split("\n")
        return [
            *(left + comment for comment in self.comments),
            left + lead + first,
            *(shifted(line, column - self.at.column + 1) for line in rest),
        ]

    def below(self, word: str) -> list[str]:
        """Return the lines of an entry `word: value`."""
        if self.on_one_line:
            return [f"{word}: {self.line}"]
        if isinstance(self.at, YamlScalar) and self.tree.raw(self.at)[:1] in ("|", ">"):
            first, *rest = self.indented(0)
            return [f"{word}: {first}", *rest]
        return [f"{word}:", *self.indented(STEP)]

    def inside(self, lead: str) -> Snippet:
        """Return a list with it as the only item, of the lead `- `, or a mapping from a word, of `word:`."""
        lines = self.indented(2, lead) if lead == "- " else [lead, *self.indented(STEP)]
        return snippet_of(lines, self.tree)


def snippet_of(lines: Sequence[str], tree: WrittenTree) -> Snippet:
    """Return lines that hold one value as a snippet for a tree. Raises EditError: they hold none."""
    written = WrittenTree("\n".join([*lines, ""]), tree.types)
    at = written.root
    if at is None or written.problems:
        raise EditError(written.problems[0].message if written.problems else "it is empty")
    above = (written.line(row).strip() for row in range(at.line - 1))
    return Snippet(written, at, tuple(filter(None, above)))


def read_snippet(text: str, what: str, tree: WrittenTree) -> Snippet:
    """Return a value given as YAML. Raises EditError: it is none."""
    try:
        found = snippet_of(text.replace("\r\n", "\n").rstrip().split("\n"), tree)
    except EditError as error:
        raise EditError(f"{what} is no YAML: {error.reason}") from None
    behind = found.tree.text[found.tree.end(found.at) :].strip()
    beside = (*found.comments, *filter(None, [behind]))
    if "\n" in behind or any(line[0] != "#" for line in beside):
        raise EditError(f"{what} is one value and nothing else")
    return found


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


def braced(text: str) -> str:
    """Return a node in braces."""
    return text if text.startswith("{") else f"{{{text}}}"


def quoted(text: str) -> str:
    """Return a text as YAML, in quotes when it needs them."""
    if _PLAIN.fullmatch(text) and text == text.strip() and text not in ("null", "~"):
        return text
    escaped = (
        text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    )
    return f'"{escaped}"'


def shifted(line: str, by: int) -> str:
    """Return a line with more or less indentation. Raises EditError: a tab indents it."""
    bare = line.lstrip(" ")
    if by and bare[:1] == "\t":
        raise EditError("a tab indents a line of this node; replace it by spaces")
    return " " * max(0, len(line) - len(bare) + by) + bare if line else line


def indented(lines: Iterable[str], column: int) -> list[str]:
    """Return lines further to the right; empty ones stay empty."""
    return [" " * column + line if line else line for line in lines]
