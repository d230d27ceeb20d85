"""Settings of an ONNX file of boxes: from its metadata, as Ultralytics writes it, or from `model.onnx.yaml` beside it.

| key | meaning |
|---|---|
| `names` | classes: a list, or `{53: apple}` |
| `task` | `detect`; of `segment` and `pose` the boxes alone are read |
| `kpt_shape` | number of points, and values of each, for the task `pose` |
| `imgsz` | height and width of an input without a fixed size [px] |
| `stride` | sides of an input without any size are multiples of it [px] |
| `fit` | `letterbox`: the picture keeps its shape, with grey at the sides; `stretch`: it fills the input |
| `mean`, `std` | of red, green and blue in 0..1: the input is (colour - mean) / std, times 255 for the range 0..255 |
| `order`, `range` | of the input's colours: `rgb` or `bgr`, `0..1` or `0..255` |
| `units` | of the boxes: `pixels` of the input, or `share` of its width and height |

The file beside the model overrides the metadata.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from pomona.executive.values.plain_text import read_plain_text
from pomona.skills.perception.detection.errors import BadWeights

ENDING = ".yaml"  # of the settings' file, after the whole name of the model's
MOST_SETTINGS = 65_536  # bytes of a settings' file that are read
MULTIPLE = 32  # stride of most networks [px]
LEAST_SIDE, MOST_SIDE = 32, 4096  # sides that `imgsz` may have [px]

DETECT, SEGMENT, POSE = "detect", "segment", "pose"  # tasks: boxes alone, with masks, with points

Three = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class BoxSettings:
    """Settings of a model; an empty text and None leave the choice to the form of its outputs."""

    names: Mapping[int, str]  # classes by number; empty if there are none
    task: str = DETECT
    kpt_shape: tuple[int, int] = (0, 0)  # number of points of a box, and values of each
    imgsz: tuple[int, int] | None = None  # height and width of an input without a fixed size [px]
    stride: int = MULTIPLE  # [px]
    fit: str = ""
    mean: Three | None = None  # of the colours in 0..1
    std: Three | None = None
    order: str = ""  # of the input's colours
    range: str = ""
    units: str = ""
    file: str = field(default="", compare=False)  # name of the settings' file, which errors name


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
        unknown = (
            [str(key) for key in content if key not in KEYS]
            if isinstance(content, dict)
            else [str(content)]
        )
        if unknown:
            raise BadWeights(file, f"has the key {unknown[0][:40]!r}, expected {', '.join(KEYS)}")
        values |= {key: _read(file, key, key, value) for key, value in content.items()}
    return BoxSettings(**{"names": {}, "file": file.name, **values})


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
    return {
        int(number): str(name)
        for number, name in (value.items() if isinstance(value, dict) else enumerate(value))
    }


def _two(least: int) -> Callable[[Any], tuple[int, int]]:
    def read(value: Any) -> tuple[int, int]:
        first, second = (
            int(part) for part in ((value, value) if isinstance(value, int) else value)
        )
        if not all(least <= part <= MOST_SIDE for part in (first, second)):
            raise ValueError(value)
        return first, second

    return read


def _stride(value: Any) -> int:
    stride = int(value)
    if not 1 <= stride <= MOST_SIDE:
        raise ValueError(value)
    return stride


def _three(least: float) -> Callable[[Any], Three]:
    def read(value: Any) -> Three:
        red, green, blue = (float(part) for part in value)
        if not all(least < part < 1e3 for part in (red, green, blue)):
            raise ValueError(value)
        return red, green, blue

    return read


def _one_of(*words: str) -> tuple[Callable[[Any], str], str]:
    def read(value: Any) -> str:
        if value not in words:
            raise ValueError(value)
        return str(value)

    return read, " or ".join(words)


KEYS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "names": (_names, "a list or {0: 'apple'}"),
    "task": _one_of(DETECT, SEGMENT, POSE),
    "kpt_shape": (_two(1), "two numbers: [17, 3]"),
    "imgsz": (_two(LEAST_SIDE), f"height and width from {LEAST_SIDE} to {MOST_SIDE} px"),
    "stride": (_stride, f"1 to {MOST_SIDE} px"),
    "fit": _one_of("letterbox", "stretch"),
    "mean": (_three(-1e3), "three numbers: [0.485, 0.456, 0.406]"),
    "std": (_three(0.0), "three numbers above 0: [0.229, 0.224, 0.225]"),
    "order": _one_of("rgb", "bgr"),
    "range": _one_of("0..1", "0..255"),
    "units": _one_of("pixels", "share"),
}
"""Each key's reader, and the words for a value that it refuses."""


class ClassUnknown(ValueError):
    """No class, or several, could be the fruit; the text lists the classes."""


OTHERS = frozenset(
    [
        "no",
        "not",
        "non",
        "without",
        "leaf",
        "leave",
        "tree",
        "trunk",
        "branch",
        "stem",
        "flower",
        "blossom",
        "bud",
    ]
)
"""Words beside that of a fruit with which a class is none; in the singular that `_words` gives."""


def class_of(names: Mapping[int, str], fruit: str) -> int:
    """Return the number of the fruit's class: the one of its name, else the only one whose name has it as a word.

    "red_apples" has the word apple; "pineapple" has not, and "apple_leaf" is another thing.

    Raises ClassUnknown: there is none, or several.
    """
    wanted = _words(fruit)
    by_falling_likeness: tuple[Callable[[str], bool], ...] = (
        lambda name: name.strip() == fruit,
        lambda name: name.strip().casefold() == fruit.casefold(),
        lambda name: _words(name) == wanted,
        lambda name: _has(_words(name), wanted) and not OTHERS & (set(_words(name)) - set(wanted)),
    )
    right: list[int] = []
    for like in by_falling_likeness:
        right = right or [number for number, name in names.items() if like(name)]
    if len(right) != 1:
        none = "none of them is" if not right else f"{len(right)} of them could be"
        listed = ", ".join(list(names.values())[:8]) + (", …" if len(names) > 8 else "")
        raise ClassUnknown(f"has the classes {listed}: {none} {fruit}")
    return right[0]


def _words(name: str) -> list[str]:
    """Return the words of a name in small letters and in the singular: "RedApples_2" is red, apple, 2."""
    parts = re.findall(r"[^\W\d_]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name))
    return [_singular(part.casefold()) for part in parts]


def _singular(word: str) -> str:
    for plural, singular in (("ies", "y"), ("oes", "o"), ("ches", "ch"), ("s", "")):
        if word.endswith(plural) and len(word) > len(plural) + 2 and not word.endswith("ss"):
            return word.removesuffix(plural) + singular
    return word


def _has(words: list[str], wanted: list[str]) -> bool:
    """Return True if the wanted words stand in a name one after the other."""
    return any(
        words[at : at + len(wanted)] == wanted for at in range(len(words) - len(wanted) + 1)
    ) and bool(wanted)
