"""Photographs with boxes around fruit, and the published data sets of apples.

- MinneApple (Häni and others, 2020), detection: `train/images/` beside `train/masks/`, one mask of the same name per
  picture, 0 for background and another value per apple. `test/` has no masks.
- KFuji RGB-DS (Gené-Mola and others, 2019): `preprocessed data/` with `images/NAMEhr.jpg`,
  `square_annotations1/NAME.xml` and `sets/train.txt`, `val.txt` and `test.txt` of names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64, UInt8
from pomona.executive.values.pictures import ENDINGS, UnusablePicture, read_picture, read_plane
from pomona.executive.values.plain_text import read_plain_text
from pomona.skills.perception.detection.errors import BadPhotographs

FRUIT_IN_INPUT = 45.6
"""Median longer side of the boxes in the finder's input [px]: as large as most rendered fruit, and in a probe on
orchard tiles the scale at which recall was highest."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """A picture file with its labelled boxes."""

    path: Path  # of the picture
    width: int  # width, height: [px]
    height: int
    boxes: Float64  # x, y, w, h (n, 4) [px], inside the picture
    crowd: NDArray[np.bool_]  # boxes of more than one fruit or marked as doubtful, (n,)
    group: str = ""  # pictures of one group show the same place, so that a group is either learnt from or measured on
    scale: float = 1.0  # factor by which it is shrunk for the finder, that of its set

    @property
    def name(self) -> str:
        """The picture's file name."""
        return self.path.name

    @property
    def K(self) -> Float64:
        """Camera matrix (3, 3) [px], as `camera_of` supposes it."""
        return camera_of(self.width, self.height)

    def picture(self) -> UInt8:
        """RGB, (h, w, 3), upright. Raises BadPhotographs: it can no longer be read."""
        try:
            return read_picture(self.path)
        except UnusablePicture as error:
            raise BadPhotographs(self.path, str(error)) from error


def camera_of(width: int, height: int) -> Float64:
    """Camera matrix (3, 3) [px] for a photograph that names none: long, so a close look is nearly a crop."""
    focal = 4.0 * max(width, height)
    return np.array(
        [[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]]
    )


@dataclass(frozen=True, slots=True)
class PhotoSet:
    """Labelled photographs: to learn from, and to measure on; and pictures without fruit to learn from."""

    train: tuple[Photograph, ...]
    val: tuple[Photograph, ...]
    empty: tuple[Photograph, ...] = ()


def scaled(photographs: PhotoSet) -> PhotoSet:
    """Return a set with one scale, by the boxes to learn from: each set has fruit of its own size."""
    scale = fruit_scale(photographs.train)
    train, val = (
        tuple(replace(photo, scale=scale) for photo in some)
        for some in (photographs.train, photographs.val)
    )
    return replace(photographs, train=train, val=val)


def joined(sets: Sequence[PhotoSet]) -> PhotoSet:
    """Return several sets as one; each photograph keeps the scale of its own."""
    several = chain.from_iterable
    return PhotoSet(
        tuple(several(s.train for s in sets)),
        tuple(several(s.val for s in sets)),
        tuple(several(s.empty for s in sets)),
    )


def fruit_scale(photographs: Sequence[Photograph]) -> float:
    """Return the factor by which photographs with boxes of fruit are shrunk for the finder."""
    longer = [photo.boxes[:, 2:].max(axis=1) for photo in photographs if len(photo.boxes)]
    return FRUIT_IN_INPUT / float(np.median(np.concatenate(longer)))


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
    sizes: bool = False  # boxes are written as x, y, w, h, for which corners may be taken
    boxes: Boxes = field(default_factory=list)  # x, y, w, h
    lines: list[str] = field(default_factory=list)  # place of each box in `says`
    crowd: list[bool] = field(
        default_factory=list
    )  # whether each box is of more than one fruit or marked as doubtful

    def add(self, box: tuple[float, float, float, float], line: str, crowd: bool = False) -> None:
        """Append a box with its place in the file of labels."""
        self.boxes.append(box)
        self.lines.append(line)
        self.crowd.append(crowd)


def require_folder(folder: Path) -> None:
    """Raise BadPhotographs where there is no such folder, or a file instead."""
    if folder.is_file():
        raise BadPhotographs(
            folder, "a file, expected the folder with the photographs and their labels"
        )
    if not folder.is_dir():
        raise BadPhotographs(folder, "no such folder")


def files(folder: Path) -> list[Path]:
    """Return all files in a folder and its folders but hidden ones, such as `._a.jpg` of a Mac.

    Raises BadPhotographs: no such folder, a file in its place, or more than `MOST_FILES` files.
    """
    require_folder(folder)
    found = list(islice((p for p in folder.rglob("[!.]*") if p.is_file()), MOST_FILES + 1))
    if len(found) > MOST_FILES:
        raise BadPhotographs(
            folder, f"holds more than {MOST_FILES} files: name a folder with fewer"
        )
    return found


ANNOTATIONS, SETS, COLOUR = "square_annotations1", "sets", "hr.jpg"
"""KFuji's folders of boxes and of names, and the ending of its colour pictures."""


def minneapple_folders(folder: Path) -> list[Path]:
    """Return the folders with `images/` and `masks/`: this one, or those in it or in its `detection/`."""
    places = [folder, *sorted(folder.glob("*")), *sorted(folder.glob("detection/*"))]
    return [place for place in places if (place / "masks").is_dir() and (place / "images").is_dir()]


def minneapple(folder: Path) -> list[Labelled]:
    """Read the pictures and masks of MinneApple; pictures of one sequence, by their names, are one group.

    Raises BadPhotographs: a picture without its mask, a mask without its picture, or a mask of another form.
    """
    items = []
    for place in minneapple_folders(folder):
        pictures = {
            path.stem: path
            for path in (place / "images").iterdir()
            if path.suffix.lower() in PICTURES
        }
        masks = {
            path.stem: path
            for path in (place / "masks").iterdir()
            if path.suffix.lower() in PICTURES
        }
        for here, missing, kind in (
            (pictures, masks, "mask in masks/"),
            (masks, pictures, "picture in images/"),
        ):
            alone = sorted(here.keys() - missing.keys())
            if alone:
                raise BadPhotographs(here[alone[0]], f"has no {kind}, like {len(alone) - 1} others")
        items += [_masked(pictures[name], masks[name]) for name in sorted(pictures)]
    return items


def _masked(picture: Path, path: Path) -> Labelled:
    try:
        mask = read_plane(path)
    except UnusablePicture as error:
        raise BadPhotographs(path, str(error)) from error
    if mask.ndim != 2:
        raise BadPhotographs(
            path, f"has {mask.shape[2]} channels, expected one: 0 for background, a value per apple"
        )
    height, width = mask.shape
    item = Labelled(
        picture, str(path), group="_".join(picture.stem.split("_")[:-1]), size=(width, height)
    )
    for value in np.unique(mask[mask > 0]).tolist():
        rows, columns = (np.flatnonzero((mask == value).any(axis=axis)) for axis in (1, 0))
        left, top = float(columns[0]), float(rows[0])
        item.add(
            (left, top, float(columns[-1]) + 1.0 - left, float(rows[-1]) + 1.0 - top),
            f"value {value}",
        )
    return item


def kfuji_folder(folder: Path) -> Path | None:
    """Return the folder with KFuji's boxes: this one, or one of the two levels in it; None without."""
    found = [
        folder / ANNOTATIONS,
        *sorted(folder.glob(f"*/{ANNOTATIONS}")),
        *sorted(folder.glob(f"*/*/{ANNOTATIONS}")),
    ]
    return next((place.parent for place in found if place.is_dir()), None)


def kfuji(folder: Path) -> list[Labelled]:
    """Read KFuji's pictures by the names in `sets/`. Raises BadPhotographs: a file is missing or has another form."""
    items = []
    for split in ("train", "val", "test"):
        listed = folder / SETS / f"{split}.txt"
        try:
            names = read_plain_text(listed).split()
        except (OSError, ValueError) as error:
            raise BadPhotographs(
                listed, f"cannot be read, expected a name per line: {error}"
            ) from None
        items += [_annotated(folder, name, split) for name in names]
    return items


def _annotated(folder: Path, name: str, split: str) -> Labelled:
    path = folder / ANNOTATIONS / f"{name}.xml"
    item = Labelled(folder / "images" / f"{name}{COLOUR}", str(path), split)
    try:
        text = read_plain_text(path)
        if "<!DOCTYPE" in text:
            raise ValueError("it declares a document type")
        root = ElementTree.fromstring(text)
        for number, box in enumerate(root.iter("bbox"), start=1):
            left, top, right, bottom = (
                float(box.findtext(side) or "") for side in ("xmin", "ymin", "xmax", "ymax")
            )
            item.add((left, top, right - left, bottom - top), f"object {number}")
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise BadPhotographs(path, f"is no annotation of KFuji's: {error}") from None
    return item
