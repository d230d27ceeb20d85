"""Labels of pictures in the one form that is read: COCO's JSON. Every other form is refused by its name."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pomona.executive import Float64, read_plain_text

T = TypeVar("T")

MOST_BYTES = 1 << 30  # of a file; a hundred thousand pictures with their outlines have less
SLACK = 3.0  # a box may end this far outside of its picture, as rounding leaves it, and is cut there [px]

CONVERTER = "convert them: datum convert -if {0} -i FOLDER -f coco -o coco (pip install datumaro)"
OTHER_FORMS = (
    ("*.xml", "Pascal VOC's XML", CONVERTER.format("voc")),
    ("*.txt", "YOLO's texts", CONVERTER.format("yolo")),
    ("*.csv", "a table", "write its rows as COCO's images, annotations and categories"),
    ("masks", "masks", "convert them to COCO's boxes"),
    ("*.json", "a folder", "name the JSON file in it"),
)
"""Patterns of other forms of labels, in the order in which they are tried, with their names and cures."""


class BadLabels(Exception):
    """A file of labels that cannot be used, in one line."""

    def __init__(self, path: Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}")


@dataclass(slots=True)
class LabelledPicture:
    """The labels of one picture."""

    name: Path  # as the file of labels has it, relative to any folder
    width: int  # [px]
    height: int
    boxes: list[Float64] = field(default_factory=list)  # x, y, w, h (4,) [px], of one fruit each
    crowds: list[Float64] = field(default_factory=list)  # the same, of several fruit each


def read_labels(path: Path, fruit: str) -> list[LabelledPicture]:
    """Read the boxes of one category, the fruit's, in a JSON file of COCO.

    Raises BadLabels: it is of another form, or an entry is missing, doubled or does not fit another one.
    """
    if path.suffix.lower() != ".json" or not path.is_file():
        raise BadLabels(path, _other_form(path))
    try:
        content = json.loads(read_plain_text(path, MOST_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        raise BadLabels(path, f"is no JSON: {error}") from error
    names = _by_id(path, content, "categories", lambda entry: str(entry["name"]))
    wanted = [number for number, name in names.items() if name.casefold() == fruit.casefold()]
    if len(wanted) != 1:
        there = ", ".join(names.values())[:200]
        raise BadLabels(path, f"has the categories {there}: expected one with the name {fruit}")
    pictures = _by_id(path, content, "images", _picture)

    def add(entry: dict[str, Any]) -> None:
        kind = entry["category_id"]
        owner = pictures[entry["image_id"]]
        if names[kind] == names[wanted[0]]:
            boxes = owner.crowds if entry.get("iscrowd", 0) else owner.boxes
            boxes.append(_box(entry["bbox"], owner))

    _read(path, content, "annotations", add)
    return list(pictures.values())


def _other_form(path: Path) -> str:
    """Return the name of a form of labels that is not read, and its cure."""
    if not path.exists():
        return "no such file"
    for pattern, name, cure in OTHER_FORMS:
        if path.match(pattern) or (path.is_dir() and next(path.rglob(pattern), None) is not None):
            return f"the labels are {name}, expected a JSON file of COCO: {cure}"
    return "holds no labels, expected a JSON file of COCO"


def _picture(entry: dict[str, Any]) -> LabelledPicture:
    name = Path(str(entry["file_name"]).replace("\\", "/"))
    return LabelledPicture(name, int(entry["width"]), int(entry["height"]))


def _box(given: Any, picture: LabelledPicture) -> Float64:
    """Return a box inside its picture. Raises ValueError: it is none, or lies outside, as corners mostly do."""
    x, y, w, h = (float(value) for value in given)
    low = np.array([x, y])
    high = np.array([x + w, y + h])
    side = np.array([picture.width, picture.height])
    if not (min(w, h) > 0.0 and (low >= -SLACK).all() and (high <= side + SLACK).all()):
        size = f"{picture.width} × {picture.height} px"
        raise ValueError(f"the bbox x, y, w, h {x:g}, {y:g}, {w:g}, {h:g} is not inside {size}")
    low = np.clip(low, 0.0, side)
    high = np.clip(high, 0.0, side)
    return np.concatenate([low, high - low])


def _by_id(path: Path, content: Any, key: str, read: Callable[[dict[str, Any]], T]) -> dict[Any, T]:
    """Return what is read of each entry of a list, by its id. Raises BadLabels: two have one id."""
    pairs = _read(path, content, key, lambda entry: (entry["id"], read(entry)))
    found = dict(pairs)
    if len(found) < len(pairs):
        raise BadLabels(path, f"two of its {key} have one id")
    return found


def _read(path: Path, content: Any, key: str, read: Callable[[dict[str, Any]], T]) -> list[T]:
    """Return what is read of each entry of a list. Raises BadLabels, with the place of one that cannot be used."""
    entries = content.get(key) if isinstance(content, dict) else None
    if not isinstance(entries, list):
        words = f"has no list of {key}, expected COCO's images, annotations and categories"
        raise BadLabels(path, words)
    found = []
    for number, entry in enumerate(entries):
        try:
            found.append(read(entry))
        except KeyError as error:
            words = f"{key}[{number}] has no {error.args[0]!r}, or no entry has this id"
            raise BadLabels(path, words) from error
        except (TypeError, ValueError, OverflowError) as error:
            raise BadLabels(path, f"{key}[{number}]: {error}") from error
    return found
