"""Settings of an ONNX file of boxes: from its metadata, as Ultralytics writes it, or from `model.onnx.yaml` beside it.

| key | meaning |
|---|---|
| `names` | classes: a list, or `{53: apple}` |
| `task` | `detect`; models of other tasks are refused |
| `imgsz` | height and width of an input without a fixed size [px] |
| `stride` | sides of an input without any size are multiples of it [px] |

The file beside the model overrides the metadata.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from pomona.executive.values.plain_text import read_plain_text
from pomona.skills.perception.detection.errors import BadWeights

ENDING = ".yaml"  # of the settings' file, after the whole name of the model's
MOST_SETTINGS = 65_536  # bytes of a settings' file that are read
MULTIPLE = 32  # stride of most networks [px]
# sides that `imgsz` may have [px]
LEAST_SIDE = 32
MOST_SIDE = 4096


@dataclass(frozen=True, slots=True)
class BoxSettings:
    """Settings of a model."""

    names: Mapping[int, str]  # classes by number; empty if there are none
    task: str = "detect"
    imgsz: tuple[int, int] | None = None  # height and width of an input without a fixed size [px]
    stride: int = MULTIPLE  # [px]

    def class_of(self, fruit: str) -> int:
        """Return the number of the class with the fruit's name. Raises ValueError: there is none, or several."""
        right = [
            number for number, name in self.names.items() if name.casefold() == fruit.casefold()
        ]
        if len(right) == 1:
            return right[0]
        listed = ", ".join(self.names.values())[:200] or "without names"
        raise ValueError(
            f"has the classes {listed}: expected one named {fruit}; write names: {{0: {fruit}}} into the model's {ENDING}"
        )


def settings_file(model: Path) -> Path:
    """Return the place of a model's settings: its own name, with `.yaml` at the end."""
    return model.with_name(model.name + ENDING)


def read_settings(model: Path, metadata: Mapping[str, str]) -> BoxSettings:
    """Return the settings from a model's metadata and from the file beside it.

    Raises BadWeights: a value has another form, or the file cannot be read or has another key.
    """
    values = {
        key: _read(model, f"metadata {key}", key, _literal(metadata[key]))
        for key in KEYS
        if key in metadata
    }
    file = settings_file(model)
    if file.exists():
        try:
            content = yaml.safe_load(read_plain_text(file, MOST_SETTINGS)) or {}
        except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
            raise BadWeights(file, " ".join(f"cannot be read: {error}".split())) from error
        given = list(content) if isinstance(content, dict) else [content]
        unknown = [str(key) for key in given if key not in tuple(KEYS)]  # a key may be a list
        if unknown:
            raise BadWeights(file, f"has the key {unknown[0][:40]!r}, expected {', '.join(KEYS)}")
        values |= {key: _read(file, key, key, value) for key, value in content.items()}
    return BoxSettings(**{"names": {}, **values})


def _literal(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError):
        return text


def _read(file: Path, where: str, key: str, value: Any) -> Any:
    read, expected = KEYS[key]
    try:
        return read(value)
    except (ValueError, TypeError, OverflowError):
        raise BadWeights(file, f"has {where} {str(value)[:40]!r}, expected {expected}") from None


def _names(value: Any) -> dict[int, str]:
    if isinstance(value, str):
        raise ValueError(value)
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    return {int(number): str(name).strip() for number, name in pairs}


def _task(value: Any) -> str:
    if value != "detect":
        raise ValueError(value)
    return str(value)


def _sides(value: Any) -> tuple[int, int]:
    height, width = (int(part) for part in ((value, value) if isinstance(value, int) else value))
    if not LEAST_SIDE <= min(height, width) <= max(height, width) <= MOST_SIDE:
        raise ValueError(value)
    return height, width


def _stride(value: Any) -> int:
    stride = int(value)
    if not 1 <= stride <= MOST_SIDE:
        raise ValueError(value)
    return stride


KEYS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "names": (_names, "a list or {0: 'apple'}"),
    "task": (_task, "detect: export a model of boxes alone"),
    "imgsz": (_sides, f"height and width from {LEAST_SIDE} to {MOST_SIDE} px"),
    "stride": (_stride, f"1 to {MOST_SIDE} px"),
}
"""Each key's reader, and the words for a value that it refuses."""
