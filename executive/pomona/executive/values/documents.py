"""Files of values: YAML with blocks that other files share, and options that `--set` changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pomona.executive.values.findings import Finding, Findings, Source, did_you_mean
from pomona.executive.values.kinds import Schema
from pomona.executive.values.plain_text import is_file, read_plain_text
from pomona.executive.values.removed import report_removed
from pomona.executive.values.yaml_nodes import (
    Reader,
    Refused,
    YamlMapping,
    YamlNode,
    YamlScalar,
    read_yaml,
    shape_of,
)

MAX_INCLUDES = 8  # a file may include one that includes another, so deep
_INCLUDE = "a file, or a block of one (sim.yaml#world), whose entries hold where this mapping has none of its own"


@dataclass(frozen=True, slots=True)
class Option:
    """A value of a file that `--set` may change: its default as written, and the description in the file's comment."""

    name: str
    default: str
    help: str


@dataclass(frozen=True, slots=True)
class Outline:
    """The description of a cell file that a form needs: its kind, and the options that may be changed."""

    kind: str
    options: tuple[Option, ...]


@dataclass(slots=True)
class ValueFile:
    """A file as it is written, with the blocks that it includes."""

    # the mapping, includes filled in: of a whole file, or of a block inside one (`sim.yaml#world`). Keys that stand
    # beside an `include` come before the included ones.
    root: YamlMapping
    reader: Reader  # for its values
    options: tuple[Option, ...] = ()  # the values that may be changed
    # text of every file that was read, by its path from the folder of the first
    files: dict[str, str] = field(default_factory=dict)


def read_value_file(
    path: Path,
    findings: Findings,
    what: str,
    *,
    overrides: Mapping[str, str | YamlScalar] | None = None,
    texts: Mapping[str, str] | None = None,
    shipped: Path | None = None,
) -> ValueFile | None:
    """Read a file whose root is a mapping; None when it cannot be used at all.

    Args:
        what: the kind of file for messages, for example 'a cell file'.
        overrides: of its options: texts, or scalars that know where they are written. None for a file in which
            `options` and braces mean nothing.
        texts: contents of files, by path, that are not to be read from the disk.
        shipped: folder in which an included file is looked for that does not stand beside the one that includes it.
    """
    opener = _Opener(findings, what, path.parent, texts or {}, shipped)
    root = opener.open(path, None, ())
    if root is None:
        return None
    reader = Reader(findings)
    if overrides is None:
        return ValueFile(root, reader, files=opener.files)
    options, values = _options(root, reader, findings)
    for name, given in overrides.items():
        node = given if isinstance(given, YamlScalar) else set_scalar(name, given)
        if name not in values:
            hint = did_you_mean(name, values) or f"options: {', '.join(values) or 'none'}"
            findings.error(node, "unknown-option", f"the cell has no option '{name}'", hint)
        values[name] = node
    return ValueFile(root, replace(reader, options=values), options, opener.files)


def with_includes(schema: Mapping[str, Any]) -> Schema:
    """Return the JSON Schema of such files as written: an `include` may replace the required keys of any mapping."""
    found = dict(schema)
    for key in ("items", "additionalProperties"):
        if isinstance(found.get(key), Mapping):
            found[key] = with_includes(found[key])
    for key in ("anyOf", "oneOf"):
        if key in found:  # the included file may hold the keys that select one alternative
            found["anyOf"] = [with_includes(one) for one in found.pop(key)]
    if "properties" in found:
        own = {name: with_includes(inner) for name, inner in found["properties"].items()}
        found["properties"] = {"include": {"type": "string", "description": _INCLUDE}, **own}
    if "required" in found:
        found |= {"if": {"required": ["include"]}, "else": {"required": found.pop("required")}}
    return found


def set_scalar(name: str, text: str) -> YamlScalar:
    """Return a value from the command line, as if it stood in a file."""
    return YamlScalar(Source(f"--set {name}={text}", text), 0, 0, 0, 0, text, True)


@dataclass(slots=True)
class _Opener:
    findings: Findings
    what: str
    folder: Path
    texts: Mapping[str, str]
    shipped: Path | None
    files: dict[str, str] = field(default_factory=dict)

    def open(
        self, path: Path, included_at: YamlScalar | None, chain: tuple[Path, ...]
    ) -> YamlMapping | None:
        text = self._text(path, included_at)
        if text is None:
            return None
        source = Source(str(path), text)
        root = read_yaml(source, self.findings, self.what)
        if root is None:
            return None
        if not isinstance(root, YamlMapping):
            self.findings.error(
                root, "shape", f"{self.what} is a mapping ('key: value'), this is {shape_of(root)}"
            )
            return None
        return self._expanded(root, path, (*chain, path))

    def _text(self, path: Path, included_at: YamlScalar | None) -> str | None:
        try:
            text = self.texts[str(path)] if str(path) in self.texts else read_plain_text(path)
        except (OSError, ValueError) as error:
            problem = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        else:
            self.files[_relative(path, self.folder)] = text
            return text
        if included_at is not None:
            if not report_removed(self.findings, included_at, "cell", path.stem):
                self.findings.error(included_at, "file", f"{path} {problem}")
        else:
            self.findings.add(Finding(str(path), 0, 0, "error", "file", problem))
        return None

    def _expanded(self, node: YamlMapping, path: Path, chain: tuple[Path, ...]) -> YamlMapping:
        entries: dict[str, tuple[YamlScalar, YamlNode]] = {}
        lacking = node.lacking
        for name, (key, value) in node.entries.items():
            if name == "include":
                included = self._included(value, path, chain)
                lacking = lacking or included is None
                entries = (included or {}) | entries
            else:
                inner = (
                    self._expanded(value, path, chain) if isinstance(value, YamlMapping) else value
                )
                entries[name] = (key, inner)
        return replace(node, entries=entries, lacking=lacking)

    def _included(
        self, node: YamlNode, path: Path, chain: tuple[Path, ...]
    ) -> dict[str, tuple[YamlScalar, YamlNode]] | None:
        """Return its entries; None when it cannot be read, which is a finding."""
        if not isinstance(node, YamlScalar) or node.is_null:
            self.findings.error(
                node, "shape", "'include' names a file", "write include: shared/workspace.yaml"
            )
            return None
        file, _, block = node.text.partition("#")
        target = self._target(path.parent, file)
        if target in chain or len(chain) > MAX_INCLUDES:
            words = (
                "includes itself"
                if target in chain
                else f"is included more than {MAX_INCLUDES} files deep"
            )
            self.findings.error(node, "include", f"{target} {words}")
            return None
        opened = self.open(target, node, chain)
        return None if opened is None else self._block(opened, block, node)

    def _target(self, folder: Path, file: str) -> Path:
        beside = folder / file
        if self.shipped is None or str(beside) in self.texts or is_file(beside):
            return beside
        shipped = self.shipped / file
        return shipped if str(shipped) in self.texts or is_file(shipped) else beside

    def _block(
        self, root: YamlMapping, path: str, at: YamlScalar
    ) -> dict[str, tuple[YamlScalar, YamlNode]] | None:
        """Return the entries of a mapping inside a file, by its keys, `devices/camera`, or of the whole file."""
        for name in filter(None, path.split("/")):
            inner = root.get(name)
            if not isinstance(inner, YamlMapping):
                words = f"{at.text.partition('#')[0]} has no block '{name}'"
                self.findings.error(at, "include", words, did_you_mean(name, root.entries))
                return None
            root = inner
        return root.entries


def _options(
    root: YamlMapping, reader: Reader, findings: Findings
) -> tuple[tuple[Option, ...], dict[str, YamlScalar]]:
    node = root.get("options")
    if node is None or (isinstance(node, YamlScalar) and node.is_null):
        return (), {}
    if not isinstance(node, YamlMapping):
        findings.error(
            node, "shape", f"options are a mapping from names to values, this is {shape_of(node)}"
        )
        return (), {}
    values: dict[str, YamlScalar] = {}
    options = []
    for name, (key, written) in node.entries.items():
        try:
            if not isinstance(written, YamlScalar):
                raise reader.refuse(
                    written, f"the option '{name}' must be a single value", code="shape"
                )
        except Refused:
            continue
        values[name] = written
        options.append(Option(name, written.text, key.source.comments.get(key.line, "")))
    return tuple(options), values


def _relative(path: Path, folder: Path) -> str:
    try:
        return str(path.relative_to(folder))
    except ValueError:
        return str(path)
