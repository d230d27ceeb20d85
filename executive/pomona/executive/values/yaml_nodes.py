"""YAML text → nodes with their place, and the readers of their values. Plain YAML only: no tags, no aliases, bounded.

Scalars stay text; the type of the port decides their meaning. So `no` can be a fruit's name instead of a boolean, and
`1:30` is not 90.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import yaml

from pomona.executive.values.findings import Edit, Findings, Located, Source, Spot, did_you_mean
from pomona.executive.values.yaml_errors import (
    MAX_DEPTH,
    TOO_DEEP,
    report_false_spaces,
    report_unreadable,
)

MAX_CHARACTERS = 512 * 1024
MAX_NODES = 100_000

_SCALAR = yaml.ScalarEvent
_MAPPING_END = yaml.MappingEndEvent
LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(slots=True, eq=False)
class YamlNode:
    """Where a node is written; lines and columns count from 1."""

    source: Source
    line: int
    column: int
    end_line: int
    end_column: int

    @property
    def length(self) -> int:
        """How many characters to underline."""
        return self.end_column - self.column if self.end_line == self.line else 1


@dataclass(slots=True, eq=False)
class YamlScalar(YamlNode):
    """Text; `plain` when it is written without quotes."""

    text: str
    plain: bool

    @property
    def is_null(self) -> bool:
        """Return True for an empty text, `~` or `null`."""
        return self.plain and self.text in ("", "~", "null")

    @property
    def text_column(self) -> int:
        """Column of the text's first character."""
        return self.column if self.plain else self.column + 1


@dataclass(slots=True, eq=False)
class YamlList(YamlNode):
    """A list, with the places of its items."""

    items: list[YamlNode]


@dataclass(slots=True, eq=False)
class YamlMapping(YamlNode):
    """A mapping with unique keys: if a key is written twice, the first stays and the second is a finding."""

    entries: dict[str, tuple[YamlScalar, YamlNode]]
    # an included file could not be read, which is a finding of its own; missing keys are not reported
    lacking: bool = False

    def get(self, key: str) -> YamlNode | None:
        """Return the value of a key, or None."""
        entry = self.entries.get(key)
        return None if entry is None else entry[1]


_UNSPACED_ITEM = re.compile(r"-[A-Za-z]")  # a list item without the space behind its dash


class Unreadable(Exception):
    """Stops reading; the finding has been made."""


def read_yaml(
    source: Source, findings: Findings, what: str = "a tree file", modifiers: Collection[str] = ()
) -> YamlNode | None:
    """Return the file's only document, or None when it cannot be read; every reason is a finding.

    `what` is the kind of file for messages, `modifiers` are words that stand beside a node's type.
    """
    if len(source.text) > MAX_CHARACTERS:
        message = f"the file has {len(source.text) // 1024} KiB; {what} has at most {MAX_CHARACTERS // 1024} KiB"
        findings.error(Spot(source, 1, 1), "too-large", message)
        return None
    if not source.text.isascii() and report_false_spaces(source, findings):
        return None
    loader: Any = None
    try:
        loader = LOADER(source.text)
        return Composer(source, findings, loader, what).document()
    except Unreadable:
        return None
    except yaml.MarkedYAMLError as error:
        report_unreadable(source, error, findings, modifiers)
    except (yaml.YAMLError, UnicodeError, ValueError) as error:
        read = source.text.encode(errors="replace")[: getattr(error, "position", 0)].decode(
            errors="replace"
        )
        spot = Spot(source, read.count("\n") + 1, len(read) - read.rfind("\n"))
        findings.error(
            spot,
            "yaml",
            f"not YAML: {str(error).splitlines()[0] if str(error) else 'cannot be read'}",
        )
    finally:
        if loader is not None:
            loader.dispose()
    return None


class Composer:
    """Makes nodes of libyaml's events."""

    def __init__(self, source: Source, findings: Findings, loader: Any, what: str) -> None:
        self.source = source
        self.findings = findings
        self.loader = loader
        self.what = what
        self.scalars: list[YamlScalar] = []
        """Those that may hold a #: a plain one on one line ends where a comment begins."""
        self.count = 0

    def document(self) -> YamlNode | None:
        """Return the only document; None when there is none."""
        get = self.loader.get_event
        get()  # stream start
        event = get()
        if isinstance(event, yaml.StreamEndEvent):
            hint = "begin it with 'pomona: 1'" if self.what == "a tree file" else ""
            self.findings.error(
                self._scalar_at(event),
                "empty",
                f"the file is empty, {self.what} is a mapping",
                hint,
            )
            return None
        root = self.node(get(), 0)
        get()  # document end
        event = get()
        if not isinstance(event, yaml.StreamEndEvent):
            self.findings.error(
                self._scalar_at(event),
                "yaml",
                f"{self.what} holds one document, here starts another",
            )
        self.find_comments(self.source.lines)
        return root

    def _scalar_at(self, event: Any) -> YamlScalar:
        start = event.start_mark
        end = event.end_mark
        return YamlScalar(
            self.source, start.line + 1, start.column + 1, end.line + 1, end.column + 1, "", True
        )

    def _refuse(self, event: Any, code: str, message: str, hint: str = "") -> Unreadable:
        self.findings.error(self._scalar_at(event), code, message, hint)
        return Unreadable()

    def node(self, event: Any, depth: int) -> YamlNode:
        """Return the node that an event begins."""
        kind = type(event)
        if kind is _SCALAR and event.tag is None and self.count < MAX_NODES and depth <= MAX_DEPTH:
            return self._scalar(event)  # nearly every node is one
        if depth > MAX_DEPTH:
            raise self._refuse(event, "too-deep", TOO_DEEP)
        if self.count >= MAX_NODES:
            raise self._refuse(event, "too-large", f"more than {MAX_NODES} values in one file")
        if kind is yaml.AliasEvent:
            message = f"YAML aliases (*) are not allowed in {self.what}"
            raise self._refuse(
                event, "alias", message, "write the value again, or make it a constant or a subtree"
            )
        if event.tag is not None and event.tag != "!":
            raise self._refuse(
                event, "tag", f"YAML tags ({event.tag}) are not allowed in {self.what}"
            )
        if kind is _SCALAR:
            return self._scalar(event)
        self.count += 1
        mark = event.start_mark
        line = mark.line + 1
        column = mark.column + 1
        if kind is yaml.SequenceStartEvent:
            items, mark = self._items(depth + 1)
            return YamlList(self.source, line, column, mark.line + 1, mark.column + 1, items)
        entries, mark = self._entries(depth + 1)
        return YamlMapping(self.source, line, column, mark.line + 1, mark.column + 1, entries)

    def _scalar(self, event: Any) -> YamlScalar:
        self.count += 1
        start = event.start_mark
        end = event.end_mark
        plain = not event.style
        line = start.line + 1
        end_line = end.line + 1
        scalar = YamlScalar(
            self.source, line, start.column + 1, end_line, end.column + 1, event.value, plain
        )
        if not plain or line != end_line:
            self.scalars.append(scalar)
        return scalar

    def _items(self, depth: int) -> tuple[list[YamlNode], Any]:
        get = self.loader.get_event
        items = []
        while type(event := get()) is not yaml.SequenceEndEvent:
            items.append(self.node(event, depth))
        return items, event.end_mark

    def _entries(self, depth: int) -> tuple[dict[str, tuple[YamlScalar, YamlNode]], Any]:
        get = self.loader.get_event
        node = self.node
        entries: dict[str, tuple[YamlScalar, YamlNode]] = {}
        while type(event := get()) is not _MAPPING_END:
            key = node(event, depth)
            value = node(get(), depth)
            if not isinstance(key, YamlScalar):
                hint = 'write braces that wire a port in quotes: "{name}"'
                self.findings.error(key, "key", "a key must be a word", hint)
            elif key.plain and _UNSPACED_ITEM.match(key.text):
                alike = re.compile(rf" {{{key.column - 1}}}-[A-Za-z]")
                lines = [
                    n
                    for n, text in enumerate(self.source.lines, 1)
                    if n >= key.line and alike.match(text)
                ]
                edits = [Edit(line, key.column + 1, 0, " ") for line in lines]
                self.findings.error(key, "yaml", "a space is missing behind '-'", edits=edits)
                raise Unreadable
            elif key.text in entries:
                first = entries[key.text][0].line
                message = f"'{key.text}' is given twice, first in line {first}: keep one of them"
                self.findings.error(key, "duplicate-key", message)
            else:
                entries[key.text] = (key, value)
        return entries, event.end_mark

    def find_comments(self, written: Sequence[str]) -> None:
        """Find the comments: text after a # at the start of a line or after a blank, outside every scalar."""
        lines = {number: text for number, text in enumerate(written, start=1) if "#" in text}
        covered: dict[int, list[tuple[int, int]]] = {}
        for scalar in self.scalars if lines else ():
            for line in range(scalar.line, scalar.end_line + 1):
                first = scalar.column if line == scalar.line else 1
                last = scalar.end_column if line == scalar.end_line else MAX_CHARACTERS
                covered.setdefault(line, []).append((first, last))
        for number, text in lines.items():
            at = text.find("#")
            while at >= 0:
                outside = not any(first <= at + 1 < last for first, last in covered.get(number, ()))
                if outside and (at == 0 or text[at - 1] in " \t"):
                    self.source.comments[number] = text[at + 1 :].strip()
                    if not text[:at].strip():
                        self.source.comment_lines.add(number)
                    break
                at = text.find("#", at + 1)


def written(node: YamlNode) -> str:
    """Return a node on one line: `{a: 1, b: [x, y]}`, scalars without quotes."""
    if isinstance(node, YamlScalar):
        return node.text
    if isinstance(node, YamlList):
        return f"[{', '.join(map(written, node.items))}]"
    assert isinstance(node, YamlMapping)
    return (
        "{"
        + ", ".join(f"{key.text}: {written(value)}" for key, value in node.entries.values())
        + "}"
    )


class ShapeCheck:
    """Asks a node to be of one shape; reports and answers None when it is not."""

    def __init__(self, findings: Findings) -> None:
        self.findings = findings

    def mapping(self, node: YamlNode, what: str) -> YamlMapping | None:
        """Return the node as a mapping; anything else is reported, and gives None."""
        if isinstance(node, YamlMapping):
            return node
        self.findings.error(
            node, "shape", f"{what} is a mapping ('key: value'), this is {shape_of(node)}"
        )
        return None

    def entries(
        self, node: YamlNode | None, what: str, how: str
    ) -> list[tuple[YamlScalar, YamlNode]]:
        """Entries of a mapping that may be left out or empty."""
        if node is None or (isinstance(node, YamlScalar) and node.is_null):
            return []
        if isinstance(node, YamlMapping):
            return list(node.entries.values())
        self.findings.error(
            node, "shape", f"{what} are a mapping, this is {shape_of(node)}", f"write {how}"
        )
        return []

    def text(self, node: YamlNode | None) -> YamlScalar | None:
        """Return a scalar; None when it is left out."""
        if node is None or (isinstance(node, YamlScalar) and not node.is_null):
            return node
        self.findings.error(node, "shape", f"a word is expected here, this is {shape_of(node)}")
        return None

    def known_keys(self, node: YamlMapping, known: Iterable[str], what: str) -> None:
        """Report unknown keys, each with the most similar known key."""
        names = tuple(known)
        for key, _ in node.entries.values():
            if key.text not in names:
                hint = did_you_mean(key.text, names) or f"{what} has {', '.join(names)}"
                self.findings.error(key, "unknown-key", f"{what} has no '{key.text}'", hint)


def shape_of(node: YamlNode) -> str:
    """Name the node's shape in messages."""
    if isinstance(node, YamlMapping):
        return "a mapping"
    if isinstance(node, YamlList):
        return "a list"
    return "empty" if isinstance(node, YamlScalar) and node.is_null else "a single value"


_REFERENCE = re.compile(r"\{([^{}]*)\}")


class Refused(Exception):
    """A value that cannot be read; its finding has been made."""


class Unfit(ValueError):
    """A text that is no value of its kind, with the problem and the correction."""

    def __init__(self, message: str, hint: str = "", code: str = "value") -> None:
        self.message = message
        self.hint = hint
        self.code = code
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Reader:
    """Context that a kind needs to read a node."""

    findings: Findings  # receives every error and warning
    title: str = ""  # of the value, for messages: `devices.arm.lead`
    # values of `{name}`, or None in files without options
    options: Mapping[str, YamlScalar] | None = None

    def inside(self, key: str) -> Reader:
        """Return the reader of a value in this one."""
        return replace(self, title=f"{self.title}.{key}" if self.title else key)

    def refuse(self, where: Located, message: str, hint: str = "", code: str = "value") -> Refused:
        """Report the finding; the caller raises the returned error."""
        self.findings.error(where, code, message, hint)
        return Refused(message)

    def filled(self, node: YamlNode) -> YamlNode:
        """Return the node with options filled in. A text that is only one option gets the place of the option's value.

        Raises Refused: it names an option that does not exist.
        """
        options = self.options
        if options is None or not isinstance(node, YamlScalar) or "{" not in node.text:
            return node
        for name in _REFERENCE.findall(node.text):
            if name not in options:
                hint = did_you_mean(name, options) or f"options: {', '.join(options) or 'none'}"
                raise self.refuse(node, f"there is no option '{name}'", hint, "unknown-option")
        whole = _REFERENCE.fullmatch(node.text.strip())
        if whole is not None:
            return options[whole[1]]
        return replace(node, text=_REFERENCE.sub(lambda match: options[match[1]].text, node.text))
