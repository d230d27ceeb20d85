"""A cell file: YAML in which every value knows its line, read through accessors that say what is wrong and where.

name: bench
options:                       # what `--set` may change; "{place}" below stands for the value
  place: 3
workspace: {table_z: -120 mm, lower: [-0.5, -0.8, -0.1], upper: [0.5, 0.0, 0.6]}
devices:
  arm: {driver: motoman, host: 192.168.1.31}
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from drivers.errors import CellFileError
from executive.values.units import QUANTITIES

_PLAIN_NUMBER = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*", re.ASCII)
_REFERENCE = re.compile(r"\{([^{}]*)\}")


def parse_quantity(text: str, kind: str) -> float:
    """A number in SI units, with the unit that its kind demands; kind 'number' takes none.

    Raises:
        ValueError: not a finite number, no unit, or one that does not measure `kind`; the text is for a person.
    """
    if kind != "number":
        return QUANTITIES[kind].parse(text)
    if _PLAIN_NUMBER.fullmatch(text) is None or not np.isfinite(value := float(text)):
        raise ValueError(f"'{text.strip()}' is not a number; no unit is meant here")
    return value


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A hint for a misspelt word: the nearest known one, else all of them."""
    names = sorted(known)
    near = difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    return f"did you mean '{near[0]}'?" if near else f"known: {', '.join(names) or 'none'}"


class Settings:
    """A mapping of a cell file: accessors convert, check and remember what was read; `finish` complains of the rest.

    Every accessor raises CellFileError with the place of the value. A key without a default must be there.
    """

    def __init__(self, path: Path, node: yaml.MappingNode, options: Mapping[str, str], title: str = "") -> None:
        self.path, self.title = path, title
        self._node, self._options = node, options
        self._values: dict[str, yaml.Node] = {}
        self._seen: set[str] = set()
        for key, value in node.value:
            if str(key.value) in self._values:
                raise self._at(key, f"'{key.value}' is written twice")
            self._values[str(key.value)] = value

    def error(self, message: str, key: str | None = None, hint: str = "") -> CellFileError:
        """An error at the value of `key`, or at this mapping."""
        return self._at(self._values.get(key or "", self._node), message, hint)

    def names(self) -> tuple[str, ...]:
        """The keys that the section has, in the file's order."""
        return tuple(self._values)

    def has(self, key: str) -> bool:
        """Whether the key is there with a value other than null."""
        self._seen.add(key)
        return key in self._values and self._scalar(key) not in ("", "~", "null")

    def finish(self) -> None:
        """Raise for the first key that nobody asked for."""
        for key, _ in self._node.value:
            if str(key.value) not in self._seen:
                hint = did_you_mean(str(key.value), self._seen)
                raise self._at(key, f"{self.title or 'the file'} has no setting '{key.value}'", hint)

    # ------------------------------------------------------------------------------------------- accessors

    def text(self, key: str, default: str | None = None) -> str:
        value = self._read(key, default)
        return value if isinstance(value, str) else self._need_scalar(key)

    def choice(self, key: str, known: Iterable[str], default: str | None = None) -> str:
        """One of the known words; the default where the key is missing, if there is one."""
        names = tuple(known)
        value = self.text(key, default)
        if value not in names:
            raise self.error(f"{self._name(key)} cannot be '{value}'", key, did_you_mean(value, names))
        return value

    def boolean(self, key: str, default: bool | None = None) -> bool:
        """`true` or `false`."""
        value = self.choice(key, ("true", "false"), None if default is None else str(default).lower())
        return value == "true"

    def number(
        self,
        key: str,
        kind: str = "number",
        default: float | None = None,
        low: float = -np.inf,
        high: float = np.inf,
    ) -> float:
        """A number in SI units; `kind` is what it measures: number, length, angle, time, speed, force, mass or rate."""
        if default is not None and not self.has(key):
            return float(default)
        text = self.text(key)
        try:
            value = parse_quantity(text, kind)
        except ValueError as error:
            raise self.error(f"{self._name(key)}: {error}", key) from error
        if not low <= value <= high:
            raise self.error(f"{self._name(key)} is {text}, it must lie between {low:g} and {high:g}", key)
        return value

    def integer(self, key: str, default: int | None = None, low: int = -(2**31), high: int = 2**31) -> int:
        """A whole number within [low, high]."""
        value = self.number(key, "number", default, low, high)
        if value != int(value):
            raise self.error(f"{self._name(key)} must be a whole number, not {value:g}", key)
        return int(value)

    def span(self, key: str, kind: str = "number", default: tuple[float, float] | None = None) -> tuple[float, float]:
        """A value or a range: 0.8 gives (0.8, 0.8), [0.7, 0.9] and 0.7..0.9 give (0.7, 0.9)."""
        if default is not None and key not in self._values:
            self._seen.add(key)
            return default
        if isinstance(self._values.get(key), yaml.SequenceNode):
            low, high = map(float, self.vector(key, 2, kind))
        else:
            first, dots, last = self.text(key).partition("..")
            try:
                low = parse_quantity(first, kind)
                high = parse_quantity(last, kind) if dots else low
            except ValueError as error:
                raise self.error(f"{self._name(key)}: {error}", key) from error
        if low > high:
            raise self.error(f"{self._name(key)} is a range from {low:g} down to {high:g}", key)
        return low, high

    def vector(self, key: str, size: int | None, kind: str = "number") -> NDArray[np.float64]:
        """Numbers in SI units, shape (size,), any number of them for None: a list, or a text with one unit at its end.

        `[90 mm, 80 mm]` and `90 80 mm` are the same.
        """
        node = self._read(key, None)
        if isinstance(node, str) and kind != "number":
            return self._row(key, node, size, kind)
        if not isinstance(node, yaml.SequenceNode) or (size is not None and len(node.value) != size):
            raise self.error(f"{self._name(key)} must be a list of {size or 'any number of'} numbers", key)
        try:
            return np.array([parse_quantity(str(item.value), kind) for item in node.value])
        except ValueError as error:
            raise self.error(f"{self._name(key)}: {error}", key) from error

    def _row(self, key: str, text: str, size: int | None, kind: str) -> NDArray[np.float64]:
        *numbers, unit = text.split()
        if size is not None and len(numbers) != size:
            raise self.error(f"{self._name(key)} must be {size} numbers and a unit", key)
        try:
            return np.array([parse_quantity(f"{number} {unit}", kind) for number in numbers])
        except ValueError as error:
            raise self.error(f"{self._name(key)}: {error}", key) from error

    def file(self, key: str, hint: str = "") -> Path:
        """An existing file or folder; a relative path is meant from the cell file's folder.

        Args:
            key: in this mapping.
            hint: what to do when there is no such file.
        """
        path = self.path.parent / Path(self.text(key)).expanduser()
        if not path.exists():
            raise self.error(f"{self._name(key)}: {path} does not exist", key, hint)
        return path.resolve()

    def section(self, key: str) -> Settings:
        """A mapping in this mapping."""
        node = self._read(key, None)
        if not isinstance(node, yaml.MappingNode):
            raise self.error(f"{self._name(key)} must be a mapping", key)
        return Settings(self.path, node, self._options, self._name(key))

    def sections(self, key: str) -> list[Settings]:
        """A list of mappings in this mapping; empty when the key is missing."""
        self._seen.add(key)
        if key not in self._values:
            return []
        node = self._values[key]
        if not isinstance(node, yaml.SequenceNode) or not all(isinstance(x, yaml.MappingNode) for x in node.value):
            raise self.error(f"{self._name(key)} must be a list of mappings", key)
        return [Settings(self.path, x, self._options, f"{self._name(key)} {i + 1}") for i, x in enumerate(node.value)]

    # ------------------------------------------------------------------------------------------- internals

    def _name(self, key: str) -> str:
        return f"{self.title}.{key}" if self.title else key

    def _scalar(self, key: str) -> str:
        """The value's text with options filled in; 'mapping' or 'list' for what is no scalar."""
        node = self._values[key]
        if not isinstance(node, yaml.ScalarNode):
            return "list" if isinstance(node, yaml.SequenceNode) else "mapping"

        def fill(match: re.Match[str]) -> str:
            if match[1] not in self._options:
                raise self._at(node, f"there is no option '{match[1]}'", did_you_mean(match[1], self._options))
            return self._options[match[1]]

        return _REFERENCE.sub(fill, str(node.value))

    def _read(self, key: str, default: str | None) -> yaml.Node | str:
        self._seen.add(key)
        if key in self._values and not isinstance(self._values[key], yaml.ScalarNode):
            return self._values[key]
        if self.has(key):
            return self._scalar(key)
        if default is None:
            raise self.error(f"{self.title or 'the file'} needs '{key}'", key)
        return default

    def _need_scalar(self, key: str) -> str:
        raise self.error(f"{self._name(key)} must be a single value, not a {self._scalar(key)}", key)

    def _at(self, node: yaml.Node, message: str, hint: str = "") -> CellFileError:
        mark = node.start_mark
        return CellFileError(self.path, mark.line + 1, mark.column + 1, message, hint)


def read_cell_file(path: Path, overrides: Mapping[str, str] | None = None, text: str | None = None) -> Settings:
    """Read a cell file; `overrides` replace values of its `options`, `text` is read instead of what is on the disk.

    Raises:
        CellFileError: it cannot be read, is no mapping, or an override names no option.
    """
    try:
        content = path.read_text(encoding="utf-8") if text is None else text
        node = yaml.compose(content, Loader=yaml.SafeLoader)
    except (OSError, UnicodeDecodeError) as error:
        raise CellFileError(path, 0, 0, f"cannot be read: {error}") from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (0, 0)
        raise CellFileError(path, line, column, f"is not YAML: {error.problem or error.context}") from error
    except yaml.YAMLError as error:
        raise CellFileError(path, 0, 0, f"is not YAML: {error}") from error
    if not isinstance(node, yaml.MappingNode):
        raise CellFileError(path, 1, 1, "a cell file is a mapping with name, kind and devices")
    options = _options(path, node)
    for key, value in (overrides or {}).items():
        if key not in options:
            raise CellFileError(path, 0, 0, f"the cell has no option '{key}'", did_you_mean(key, options))
        options[key] = str(value)
    settings = Settings(path, node, options)
    settings._seen.add("options")
    return settings


def cell_options(path: Path) -> dict[str, str]:
    """The options of a cell file with their defaults: the keys that `overrides` may hold."""
    settings = read_cell_file(path)
    return dict(settings._options)


def _options(path: Path, node: yaml.MappingNode) -> dict[str, str]:
    for key, value in node.value:
        if key.value == "options":
            if not isinstance(value, yaml.MappingNode):
                raise CellFileError(path, value.start_mark.line + 1, value.start_mark.column + 1, "options: a mapping")
            section = Settings(path, value, {}, "options")
            return {name: section.text(name, "") for name in section.names()}
    return {}
