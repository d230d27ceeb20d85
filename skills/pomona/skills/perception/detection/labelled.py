"""Pictures and labels as the files of a data set give them, before they are checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from pomona.executive.values.pictures import ENDINGS
from pomona.skills.perception.detection.errors import BadPhotographs

PICTURES = ENDINGS

MOST_FILES = 200_000  # a folder with more files is refused: each is looked at

Boxes = list[tuple[float, float, float, float]]


@dataclass(slots=True)
class Labelled:
    """One picture with its labels as they are written."""

    path: Path  # of the picture
    says: str  # file of the labels, for messages
    split: str = ""  # split, group: as of `Photograph`; empty where nothing gives them
    group: str = ""
    size: tuple[int, int] | None = None  # width and height that the labels give [px]; None without
    parts: bool = False  # boxes are in parts of the picture, not in pixels
    boxes: Boxes = field(default_factory=list)  # x, y, w, h
    lines: list[str] = field(default_factory=list)  # place of each box in `says`
    crowd: list[bool] = field(default_factory=list)  # whether each box is of more than one fruit or marked as doubtful

    def add(self, box: tuple[float, float, float, float], line: str, crowd: bool = False) -> None:
        """Append a box with its place in the file of labels."""
        self.boxes.append(box)
        self.lines.append(line)
        self.crowd.append(crowd)


def files(folder: Path) -> list[Path]:
    """Return all files in a folder and its folders.

    Raises BadPhotographs: no such folder, or more than `MOST_FILES` files.
    """
    if not folder.is_dir():
        raise BadPhotographs(folder, "no such folder")
    found = list(islice((p for p in folder.rglob("*") if p.is_file()), MOST_FILES + 1))
    if len(found) > MOST_FILES:
        raise BadPhotographs(folder, f"holds more than {MOST_FILES} files: name a folder with fewer")
    return found
