"""Changes of a tree file: of its text, and beside it of the content as which the new text must read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar
from pomona.tools.editor.meaning import Content, content_of
from pomona.tools.editor.snippets import Snippet, indented, quoted
from pomona.tools.editor.written_tree import EditError, WrittenNode, WrittenTree, values_in

SECTIONS = ("parameters", "root", "subtrees")
"""Words at the top of a file whose order is kept, with a blank line behind a new one."""
_COLON = re.compile(r"[ \t]*:(?=\s|$|[,\[\]{}\"'])")


@dataclass(slots=True, eq=False)
class TextPatch:
    """Changes of one text that ends with a line break, all given by places in the text before.

    Lines and values are taken out and put in; everything else stays byte for byte.
    """

    tree: WrittenTree
    changes: list[tuple[int, int, str]] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)  # comments that are taken out on purpose
    meant: Content = field(init=False)  # the content of the new text
    content: dict[int, Content] = field(default_factory=dict)  # of each part, by its id

    def __post_init__(self) -> None:
        self.meant = content_of(self.tree.top, self.content)

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

    def rows_of(self, node: WrittenNode, *, word: bool = True) -> tuple[int, int, int]:
        """Return the lines of a node: the first comment's, the dash's or the key's, the last; or those below its word."""
        step = node.path[-1]
        if isinstance(node.holder, YamlList):
            return self.item_rows(node.holder, int(step))
        first, row, last = self.entry_rows(*node.holder.entries[str(step)])
        if not word:
            row = node.at.line - 1
            first = self.leading(row, node.at.column - 1)
        return first, row, last

    def after_colon(self, key: YamlScalar) -> int | None:
        """Return the offset behind the colon of a key; None when it has none (`{Beep}`)."""
        found = _COLON.match(self.tree.text, self.tree.end(key))
        return found.end() if found else None

    # ------------------------------------------------------------------------------------------------- entries

    def set_entry(self, at: YamlMapping, word: str, value: Snippet) -> None:
        """Give a key of a mapping a value; a new key comes last, but for the sections of a file."""
        entry = at.entries.get(word)
        self.content[id(at)][word] = content_of(value.at)
        if entry is not None:
            self.set_value(at, *entry, value)
        elif self.tree.is_flow(at):
            self.add_in_flow(at, f"{quoted(word)}: {value.flow()}")
        elif id(at) in self.tree.pairs:
            self.replace(self.tree.start(at), self.tree.start(at), "{")
            self.replace(
                self.tree.end(at), self.tree.end(at), f", {quoted(word)}: {value.flow()}}}"
            )
        else:
            self.add_entry(at, word, value.below(quoted(word)))

    def add_entry(self, at: YamlMapping, word: str, lines: Sequence[str]) -> None:
        """Put lines behind the last entry of a mapping without braces, or before the next section of a file."""
        is_section = at is self.tree.top and word in SECTIONS
        later = SECTIONS[SECTIONS.index(word) + 1 :] if is_section else ()
        follower = next((at.entries[other] for other in later if other in at.entries), None)
        if follower is not None:
            row = self.entry_rows(*follower)[0]
            lines = [*lines, ""]
        else:
            row = self.trailing(self.tree.row(self.tree.end(at)), at.column - 1) + 1
        self.insert_lines(row, indented(lines, at.column - 1))

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
        del self.content[id(at)][word]
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
