"""Kinds of values in files: how each is read, its JSON Schema, and its name in messages."""

from __future__ import annotations

import argparse
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from pomona.executive.values.findings import did_you_mean
from pomona.executive.values.plain_text import exists
from pomona.executive.values.units import NUMBER, Quantity, is_number, is_within, with_article
from pomona.executive.values.yaml_nodes import (
    Reader,
    Refused,
    Unfit,
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
    shape_of,
)

T = TypeVar("T")
Schema = dict[str, Any]

_WHOLE = re.compile(r"\s*[-+]?\d{1,18}(\.0*)?\s*", re.ASCII)
OPTION: Schema = {
    "type": "string",
    "pattern": r"\{[^{}]+\}",
}  # a scalar with a placeholder for an option


class Kind(ABC, Generic[T]):
    """The set of values that a setting may have."""

    words = "a value"  # name of the kind in messages

    @abstractmethod
    def read(self, node: YamlNode, reader: Reader) -> T:
        """Return the value. Raises Refused: it is not of this kind; every reason is a finding."""

    @abstractmethod
    def schema(self, options: bool = False) -> Schema:
        """Return its JSON Schema; with `options`, a scalar may be a placeholder for one."""


class ScalarKind(Kind[T]):
    """A kind whose values are single scalars."""

    @abstractmethod
    def parse(self, text: str) -> T:
        """Return the value of a text. Raises Unfit: the text is not of this kind."""

    @abstractmethod
    def plain_schema(self) -> Schema:
        """Return the schema of the text itself."""

    def option(self, text: str) -> T:
        """Parse a value of the command line: the `type` of an argument.

        Raises argparse.ArgumentTypeError: the text is not of this kind; the message names the allowed values.
        """
        try:
            return self.parse(text)
        except Unfit as error:
            raise argparse.ArgumentTypeError(
                "; ".join(filter(None, (error.message, error.hint)))
            ) from None

    def read(self, node: YamlNode, reader: Reader) -> T:
        found = reader.filled(node)
        if not isinstance(found, YamlScalar):
            raise reader.refuse(
                found, f"{reader.title} must be {self.words}, not {shape_of(found)}", code="shape"
            )
        try:
            return self.parse(found.text)
        except Unfit as error:
            raise reader.refuse(
                found, f"{reader.title}: {error.message}", error.hint, error.code
            ) from None

    def schema(self, options: bool = False) -> Schema:
        plain = self.plain_schema()
        return {"anyOf": [plain, OPTION]} if options else plain


class Text(ScalarKind[str]):
    """A text; with `choices`, one of them; with `pattern`, one that matches it from end to end."""

    def __init__(self, *choices: str, pattern: str = "", words: str = "") -> None:
        self.choices = choices
        self.pattern = pattern
        self.words = words or ("one of " + ", ".join(choices) if choices else "a text")

    def parse(self, text: str) -> str:
        if self.choices and text not in self.choices:
            raise Unfit(f"it cannot be '{text}'", choose(text, self.choices))
        if self.pattern and re.fullmatch(self.pattern, text) is None:
            raise Unfit(f"'{text}' is not {self.words}")
        return text

    def plain_schema(self) -> Schema:
        if self.choices:
            numbers = [
                int(choice) for choice in self.choices if choice.isdecimal()
            ]  # so YAML reads them unquoted
            return {"enum": [*self.choices, *numbers]}
        return {"type": ["string", "number", "boolean"]} | (
            {"pattern": f"^{self.pattern}$"} if self.pattern else {}
        )


class Flag(ScalarKind[bool]):
    """true or false."""

    words = "true or false"

    def parse(self, text: str) -> bool:
        if text not in ("true", "false"):
            raise Unfit(f"it cannot be '{text}'", "write true or false")
        return text == "true"

    def plain_schema(self) -> Schema:
        return {"type": "boolean"}


class Number(ScalarKind[float]):
    """A number without a unit, in a closed range."""

    words = "a number"

    def __init__(self, low: float = -math.inf, high: float = math.inf) -> None:
        self.low = low
        self.high = high

    def parse(self, text: str) -> float:
        if not is_number(text) or not math.isfinite(value := float(text)):
            raise Unfit(f"'{text}' is not {self.words}; it takes no unit")
        return self.within(value, text)

    def within(self, value: float, text: str) -> float:
        """Return the value if it lies in the range; raise Unfit otherwise."""
        if not is_within(value, self.low, self.high):
            raise Unfit(
                f"it is {text.strip()}, but must be {between(self.low, self.high)}", code="range"
            )
        return value

    def plain_schema(self) -> Schema:
        return {"type": "number", **bounds_schema(self.low, self.high)}


class Whole(ScalarKind[int]):
    """A whole number in a closed range."""

    words = "a whole number"

    def __init__(self, low: float = -math.inf, high: float = math.inf) -> None:
        self._number = Number(low, high)

    def parse(self, text: str) -> int:
        if _WHOLE.fullmatch(text) is None:
            raise Unfit(f"it must be a whole number, not '{text}'")
        return int(self._number.within(float(text), text))

    def plain_schema(self) -> Schema:
        return {"type": "integer", **bounds_schema(self._number.low, self._number.high)}


class Measure(ScalarKind[float]):
    """A number with its unit, read into SI; `low` and `high`, with a unit each, bound a closed range."""

    def __init__(self, quantity: Quantity, low: str = "", high: str = "") -> None:
        self.quantity, self.words = quantity, with_article(quantity.name)
        self.low = quantity.parse(low) if low else -math.inf
        self.high = quantity.parse(high) if high else math.inf
        self._ends = low, high

    def parse(self, text: str) -> float:
        try:
            value = self.quantity.parse(text)
        except ValueError as error:
            raise Unfit(str(error)) from None
        if not is_within(value, self.low, self.high):
            low, high = self._ends
            limits = (
                f"between {low} and {high}"
                if low and high
                else f"at least {low}"
                if low
                else f"at most {high}"
            )
            raise Unfit(f"it is {text.strip()}, but must be {limits}", code="range")
        return value

    def plain_schema(self) -> Schema:
        return quantity_schema(self.quantity)


class Span(ScalarKind[tuple[float, float]]):
    """A value or a range: `0.8`, `0.7..0.9` or `[0.7, 0.9]`."""

    def __init__(self, of: Number | Measure) -> None:
        self.of = of
        self.words = f"{of.words} or a range 'from..to'"

    def parse(self, text: str) -> tuple[float, float]:
        first, dots, last = text.partition("..")
        low = self.of.parse(first)
        return self._ordered(low, self.of.parse(last) if dots else low)

    def _ordered(self, low: float, high: float) -> tuple[float, float]:
        if low > high:
            raise Unfit(
                f"it is a range from {low:g} down to {high:g}", "write the smaller end first"
            )
        return low, high

    def read(self, node: YamlNode, reader: Reader) -> tuple[float, float]:
        if not isinstance(node, YamlList):
            return super().read(node, reader)
        low, high = Row(self.of, 2).read(node, reader)
        try:
            return self._ordered(low, high)
        except Unfit as error:
            raise reader.refuse(node, f"{reader.title}: {error.message}", error.hint) from None

    def plain_schema(self) -> Schema:
        ends = self.of.plain_schema()
        text: Schema = {"type": "string", "pattern": r"\.\."}
        return {
            "anyOf": [ends, text, {"type": "array", "items": ends, "minItems": 2, "maxItems": 2}]
        }


class Row(Kind[tuple[float, ...]]):
    """Several numbers: a list, or a text with one unit at its end. `[90 mm, 80 mm]` and `90 80 mm` are the same."""

    def __init__(self, of: Number | Measure, size: int | None = None) -> None:
        self.of = of
        self.size = size
        self.words = f"a list of {f'{size} ' if size else ''}numbers" + (
            f" with a unit of {of.quantity.name}" if isinstance(of, Measure) else ""
        )

    def read(self, node: YamlNode, reader: Reader) -> tuple[float, ...]:
        found = reader.filled(node)
        if isinstance(found, YamlScalar) and isinstance(self.of, Measure):
            *numbers, unit = found.text.split() or [""]
            bare = not self.of.quantity.bare and re.fullmatch(NUMBER, unit) is not None
            if bare or not numbers or (self.size is not None and len(numbers) != self.size):
                raise self._refused(found, reader)
            texts: list[tuple[YamlNode, str]] = [(found, f"{number} {unit}") for number in numbers]
        elif isinstance(found, YamlList) and self.size in (None, len(found.items)) and found.items:
            items = [reader.filled(item) for item in found.items]
            texts = [
                (item, item.text if isinstance(item, YamlScalar) else shape_of(item))
                for item in items
            ]
        else:
            raise self._refused(found, reader)
        values = []
        for at, text in texts:
            try:
                values.append(self.of.parse(text))
            except Unfit as error:
                raise reader.refuse(
                    at, f"{reader.title}: {error.message}", error.hint, error.code
                ) from None
        return tuple(values)

    def _refused(self, node: YamlNode, reader: Reader) -> Refused:
        hint = (
            f"write [a, b, …], or 'a b … {self.of.quantity.si_unit}'"
            if isinstance(self.of, Measure)
            else ""
        )
        return reader.refuse(node, f"{reader.title} must be {self.words}", hint, "shape")

    def schema(self, options: bool = False) -> Schema:
        rows: list[Schema] = [
            {"type": "array", "items": self.of.schema(options), "minItems": self.size or 1}
        ]
        if self.size is not None:
            rows[0]["maxItems"] = self.size
        if isinstance(self.of, Measure):
            units = "|".join(map(escaped, self.of.quantity.units))
            count = f"{{{self.size}}}" if self.size else "+"
            rows.append({"type": "string", "pattern": rf"^\s*({NUMBER}\s+){count}({units})\s*$"})
        return {"anyOf": [*rows, OPTION] if options else rows}


class Counts(Kind[tuple[int, ...]]):
    """A list of `size` whole numbers, such as an image's width and height."""

    def __init__(self, size: int, low: int, high: int) -> None:
        self.of = Whole(low, high)
        self.size = size
        self.words = f"a list of {size} whole numbers"

    def read(self, node: YamlNode, reader: Reader) -> tuple[int, ...]:
        found = reader.filled(node)
        if not isinstance(found, YamlList) or len(found.items) != self.size:
            raise reader.refuse(found, f"{reader.title} must be {self.words}", code="shape")
        return tuple(read_each(self.of, [(item, reader) for item in found.items]))

    def schema(self, options: bool = False) -> Schema:
        return {
            "type": "array",
            "items": self.of.schema(options),
            "minItems": self.size,
            "maxItems": self.size,
        }


class OrWord(ScalarKind[Any]):
    """A value, or a word that stands for none: `auto`."""

    def __init__(self, of: ScalarKind[Any], word: str) -> None:
        self.of = of
        self.word = word
        self.words = f"{of.words} or '{word}'"

    def parse(self, text: str) -> Any:
        return None if text.strip() == self.word else self.of.parse(text)

    def read(self, node: YamlNode, reader: Reader) -> Any:
        return (
            self.of.read(node, reader) if isinstance(node, YamlList) else super().read(node, reader)
        )

    def plain_schema(self) -> Schema:
        return {"anyOf": [{"const": self.word}, self.of.plain_schema()]}


class PathTo(ScalarKind[Path]):
    """A file or a folder; a relative path starts at the folder of the file in which it is written.

    `what` is 'file' or 'folder'; `hint` is the remedy shown when it does not exist.
    """

    def __init__(self, what: str = "file", hint: str = "") -> None:
        self.what = what
        self.hint = hint
        self.words = f"the path of a {what}"

    def parse(self, text: str) -> Path:
        return Path(text)

    def read(self, node: YamlNode, reader: Reader) -> Path:
        given = super().read(node, reader)
        try:
            path = Path(node.source.path).parent / given.expanduser()
            there = path.is_dir() if self.what == "folder" else path.is_file()
        except (OSError, RuntimeError, ValueError):
            path = given
            there = False
        if not there:
            words = (
                f"{reader.title}: {path} does not exist"
                if not exists(path)
                else f"{path} is not a {self.what}"
            )
            raise reader.refuse(reader.filled(node), words, self.hint, "file")
        return path.resolve()

    def plain_schema(self) -> Schema:
        return {"type": "string"}


class Words(Kind[tuple[str, ...]]):
    """Words: a list, or a text with spaces between them; with `choices`, only these; with `once`, no word twice."""

    def __init__(self, *choices: str, once: bool = True) -> None:
        self.choices = choices
        self.once = once
        self.words = "a list of words" + (f" out of {', '.join(choices)}" if choices else "")

    def read(self, node: YamlNode, reader: Reader) -> tuple[str, ...]:
        found = reader.filled(node)
        if isinstance(found, YamlScalar):
            given = [(found, word) for word in found.text.split()]
        elif isinstance(found, YamlList):
            items = [reader.filled(item) for item in found.items]
            wrong = next((item for item in items if not isinstance(item, YamlScalar)), None)
            if wrong is not None:
                raise reader.refuse(wrong, f"{reader.title} must be {self.words}", code="shape")
            given = [(item, item.text) for item in items if isinstance(item, YamlScalar)]
        else:
            raise reader.refuse(found, f"{reader.title} must be {self.words}", code="shape")
        known = set[str]()
        for at, word in given:
            if self.choices and word not in self.choices:
                raise reader.refuse(
                    at, f"{reader.title}: there is no '{word}'", choose(word, self.choices)
                )
            if self.once and word in known:
                raise reader.refuse(
                    at, f"{reader.title}: '{word}' is given twice", code="duplicate"
                )
            known.add(word)
        return tuple(word for _, word in given)

    def schema(self, options: bool = False) -> Schema:
        word: Schema = (
            {"enum": list(self.choices)}
            if self.choices
            else {"type": ["string", "number", "boolean"]}
        )
        return {
            "anyOf": [
                {"type": "string"},
                {"type": "array", "items": word, "uniqueItems": self.once},
            ]
        }


class AsWritten(Kind[YamlScalar]):
    """A single value that its user will interpret; it keeps its line and column."""

    words = "a single value"

    def read(self, node: YamlNode, reader: Reader) -> YamlScalar:
        found = reader.filled(node)
        if not isinstance(found, YamlScalar) or found.is_null:
            raise reader.refuse(
                found, f"{reader.title} must be {self.words}, not {shape_of(found)}", code="shape"
            )
        return found

    def schema(self, options: bool = False) -> Schema:
        return {"type": ["string", "number", "boolean"]}


class ListOf(Kind[tuple[T, ...]]):
    """A list of values of one kind."""

    def __init__(self, of: Kind[T]) -> None:
        self.of = of
        self.words = f"a list, each item {of.words}"

    def read(self, node: YamlNode, reader: Reader) -> tuple[T, ...]:
        if not isinstance(node, YamlList):
            raise reader.refuse(
                node, f"{reader.title} must be {self.words}, not {shape_of(node)}", code="shape"
            )
        each = [
            (item, reader.inside(str(number))) for number, item in enumerate(node.items, start=1)
        ]
        return tuple(read_each(self.of, each))

    def schema(self, options: bool = False) -> Schema:
        return {"type": "array", "items": self.of.schema(options)}


class MappingOf(Kind[Mapping[str, T]]):
    """A mapping from names to values of one kind; may be empty."""

    def __init__(self, of: Kind[T]) -> None:
        self.of = of
        self.words = f"a mapping from names to {of.words}"

    def read(self, node: YamlNode, reader: Reader) -> Mapping[str, T]:
        if isinstance(node, YamlScalar) and node.is_null:
            return {}
        if not isinstance(node, YamlMapping):
            raise reader.refuse(
                node, f"{reader.title} must be a mapping, not {shape_of(node)}", code="shape"
            )
        entries = list(node.entries.values())
        values = read_each(self.of, [(value, reader.inside(key.text)) for key, value in entries])
        return dict(zip(node.entries, values, strict=True))

    def schema(self, options: bool = False) -> Schema:
        return {"type": ["object", "null"], "additionalProperties": self.of.schema(options)}


def read_each(kind: Kind[T], items: Iterable[tuple[YamlNode, Reader]]) -> list[T]:
    """Return every item's value; all are read, so that each mistake is a finding, before one is raised.

    Raises Refused: one of them cannot be read.
    """
    values = []
    refused = None
    for node, reader in items:
        try:
            values.append(kind.read(node, reader))
        except Refused as error:
            refused = error
    if refused is not None:
        raise refused
    return values


def choose(word: str, known: Iterable[str]) -> str:
    """Return a hint: the known word that is probably meant, or all of them."""
    names = list(known)
    return did_you_mean(word, names) or f"known: {', '.join(names) or 'none'}"


def between(low: float, high: float) -> str:
    """Return a closed range in words."""
    if math.isinf(high):
        return f"at least {low:g}"
    return f"at most {high:g}" if math.isinf(low) else f"between {low:g} and {high:g}"


def quantity_schema(quantity: Quantity) -> Schema:
    """Numbers with one of the quantity's units."""
    units = "|".join(map(escaped, quantity.units))
    text: Schema = {
        "type": "string",
        "pattern": rf"^\s*{NUMBER}\s*({units})\s*$",
        "examples": [f"1 {unit}" for unit in quantity.units],
    }
    return {"anyOf": [{"type": "number"}, text]} if quantity.bare else text


def escaped(text: str) -> str:
    """For a regular expression of JSON Schema."""
    return "".join(f"\\{c}" if c in "^/.*+?$()[]{}|\\" else c for c in text)


def bounds_schema(low: float | None, high: float | None) -> Schema:
    """Limits of a number; one that is infinite or None is none."""
    return {
        key: bound
        for key, bound in (("minimum", low), ("maximum", high))
        if bound is not None and math.isfinite(bound)
    }
