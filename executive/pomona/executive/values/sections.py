"""Sections of files, declared as dataclasses: allowed values, units and defaults.

    @dataclass(frozen=True, slots=True, kw_only=True)
    class GripperOptions:
        speed_max: float = value(Measure(SPEED, "1 mm/s", "1 m/s"), "200 mm/s", "fastest that the fingers move")
        home: bool = value(Flag(), False, "find the reference when the run starts")

        def problems(self) -> Iterator[Problem]: ...   # checks across values

The reader, the JSON Schema and the documentation all use the class.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, runtime_checkable

from pomona.executive.values.findings import Located, did_you_mean
from pomona.executive.values.kinds import Kind, ScalarKind, Schema
from pomona.executive.values.removed import report_removed
from pomona.executive.values.yaml_nodes import (
    Reader,
    Refused,
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
    shape_of,
)

S = TypeVar("S")
_KIND = "kind"
_REQUIRED = dataclasses.MISSING


class Problem(NamedTuple):
    """A conflict between valid values; `key` is the one to change. A warning does not stop the command.

    `where` is its place in another file, such as the section of a device in the cell file.
    """

    key: str
    message: str
    hint: str = ""
    warning: bool = False
    where: Located | None = None


@runtime_checkable
class SelfJudging(Protocol):
    """A section that looks at its values together."""

    def problems(self) -> Iterable[Problem]:
        """Yield the conflicts between the section's valid values."""


def value(kind: Kind[Any], default: Any = _REQUIRED, help: str = "") -> Any:
    """Declare a value of a section, with its help in one line.

    The default is the value when the file holds none; a text is parsed like a written one. Without it the value is
    required.
    """
    written = default
    if isinstance(default, str) and isinstance(kind, ScalarKind):
        default = kind.parse(default)
    metadata = {_KIND: kind, "help": help, "default": written}
    if default is _REQUIRED:
        return dataclasses.field(metadata=metadata)
    if isinstance(default, dict):
        return dataclasses.field(default_factory=dict, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True, slots=True)
class DeclaredValue:
    """One value that a section may have."""

    name: str
    kind: Kind[Any]
    help: str
    required: bool
    default: Any


def declared(section: type) -> Iterator[DeclaredValue]:
    """Yield the values that a section may hold, in their order."""
    for field in dataclasses.fields(section):
        if _KIND in field.metadata:
            meta = field.metadata
            default = None if meta["default"] is _REQUIRED else meta["default"]
            yield DeclaredValue(
                field.name, meta[_KIND], meta["help"], meta["default"] is _REQUIRED, default
            )


@dataclass(frozen=True, slots=True)
class Placed(Generic[S]):
    """A section that was read, and where its values stand."""

    values: S
    node: YamlMapping
    reader: Reader

    def refuse(self, problem: Problem) -> Refused | None:
        """Make a finding at a value's place, or at the section when it was not written; a warning refuses nothing."""
        if problem.warning:
            self.reader.findings.warning(
                self.place(problem.key), "value", self._titled(problem), problem.hint
            )
            return None
        return self.reader.refuse(self.place(problem.key), self._titled(problem), problem.hint)

    def place(self, key: str) -> YamlNode:
        """Where a value is given, `a.b` inside `a`, `a.2` in a list: an option's own place when it comes from one."""
        node: YamlNode | None = self.node
        for name in key.split("."):
            if isinstance(node, YamlList):
                node = node.items[int(name) - 1]
            else:
                node = node.get(name) if isinstance(node, YamlMapping) else None
        try:
            return self.node if node is None else self.reader.filled(node)
        except Refused:
            return self.node

    def _titled(self, problem: Problem) -> str:
        title = self.reader.inside(problem.key).title if problem.key else self.reader.title
        return f"{title}: {problem.message}" if title else problem.message


class Section(Kind[S]):
    """A mapping whose keys are the fields of the dataclass `of`, declared with `value`; other code reads `ignore`."""

    def __init__(self, of: type[S], ignore: tuple[str, ...] = ()) -> None:
        self.of = of
        self.ignore = ignore
        self.words = "a mapping"

    def read(self, node: YamlNode, reader: Reader) -> S:
        return self.read_placed(node, reader).values

    def read_placed(self, node: YamlNode, reader: Reader) -> Placed[S]:
        """Return the section with its places.

        Raises Refused: something in it is wrong; all of it is in the findings.
        """
        what = reader.title or "the file"
        if not isinstance(node, YamlMapping):
            raise reader.refuse(
                node, f"{what} must be a mapping, not {shape_of(node)}", code="shape"
            )
        known = {entry.name: entry for entry in declared(self.of)}
        refused = self._unknown(node, reader, (*known, *self.ignore), what)
        given: dict[str, Any] = {}
        for name, entry in known.items():
            try:
                written = node.get(name)
                if written is None or _is_null(reader.filled(written)):
                    if entry.required and node.lacking:
                        raise Refused(name)
                    if entry.required:
                        raise reader.refuse(
                            written or node, f"{what} needs '{name}'", entry.help, "missing-key"
                        )
                else:
                    given[name] = entry.kind.read(written, reader.inside(name))
            except Refused as error:
                refused = error
        if refused is not None:
            raise refused
        placed = Placed(self.of(**given), node, reader)
        for problem in placed.values.problems() if isinstance(placed.values, SelfJudging) else ():
            refused = placed.refuse(problem) or refused
        if refused is not None:
            raise refused
        return placed

    def _unknown(
        self, node: YamlMapping, reader: Reader, known: tuple[str, ...], what: str
    ) -> Refused | None:
        refused = None
        for key, _ in node.entries.values():
            if key.text in known:
                continue
            if report_removed(reader.findings, key, "setting", f"{what}.{key.text}"):
                refused = Refused(key.text)
            else:
                hint = (
                    did_you_mean(key.text, known)
                    or f"{what} has {', '.join(known) or 'no settings'}"
                )
                refused = reader.refuse(
                    key, f"{what} has no setting '{key.text}'", hint, "unknown-key"
                )
        return refused

    def schema(self, options: bool = False) -> Schema:
        properties: dict[str, Schema] = {}
        for entry in declared(self.of):
            found = dict(entry.kind.schema(options))
            if entry.help:
                found["description"] = entry.help
            if entry.default is not None:
                found["default"] = _plain(entry.default)
            properties[entry.name] = found
        required = [entry.name for entry in declared(self.of) if entry.required]
        return {
            "type": "object",
            "description": (self.of.__doc__ or "").strip().split("\n")[0],
            "properties": properties,
            "additionalProperties": False,
            **({"required": required} if required else {}),
        }


def _is_null(node: YamlNode) -> bool:
    """Return True for an option whose text is empty, quoted or not."""
    return isinstance(node, YamlScalar) and (node.is_null or not node.text)


def _plain(default: Any) -> Any:
    if dataclasses.is_dataclass(default):
        return {
            f.name: _plain(v)
            for f in dataclasses.fields(default)
            if (v := getattr(default, f.name)) is not None
        }
    if isinstance(default, tuple):
        return [_plain(item) for item in default]
    return dict(default) if isinstance(default, Mapping) else default
