"""Published data sets of apples in the folders that their archives unpack to.

- MinneApple (Häni and others, 2020), detection: `train/images/` beside `train/masks/`, one mask of the same name per
  picture, 0 for background and another value per apple. `test/` has no masks.
- KFuji RGB-DS (Gené-Mola and others, 2019): `preprocessed data/` with `images/NAMEhr.jpg`,
  `square_annotations1/NAME.xml` and `sets/train.txt`, `val.txt` and `test.txt` of names.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pomona.executive.values.pictures import UnusablePicture, read_plane
from pomona.executive.values.plain_text import read_plain_text
from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.skills.perception.detection.labelled import PICTURES, Labelled

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
        pictures = {path.stem: path for path in (place / "images").iterdir() if path.suffix.lower() in PICTURES}
        masks = {path.stem: path for path in (place / "masks").iterdir() if path.suffix.lower() in PICTURES}
        for here, missing, kind in ((pictures, masks, "mask in masks/"), (masks, pictures, "picture in images/")):
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
        raise BadPhotographs(path, f"has {mask.shape[2]} channels, expected one: 0 for background, a value per apple")
    height, width = mask.shape
    item = Labelled(picture, str(path), group="_".join(picture.stem.split("_")[:-1]), size=(width, height))
    for value in np.unique(mask[mask > 0]).tolist():
        rows, columns = (np.flatnonzero((mask == value).any(axis=axis)) for axis in (1, 0))
        left, top = float(columns[0]), float(rows[0])
        item.add((left, top, float(columns[-1]) + 1.0 - left, float(rows[-1]) + 1.0 - top), f"value {value}")
    return item


def kfuji_folder(folder: Path) -> Path | None:
    """Return the folder with KFuji's boxes: this one, or one of the two levels in it; None without."""
    found = [folder / ANNOTATIONS, *sorted(folder.glob(f"*/{ANNOTATIONS}")), *sorted(folder.glob(f"*/*/{ANNOTATIONS}"))]
    return next((place.parent for place in found if place.is_dir()), None)


def kfuji(folder: Path) -> list[Labelled]:
    """Read KFuji's pictures by the names in `sets/`. Raises BadPhotographs: a file is missing or has another form."""
    items = []
    for split in ("train", "val", "test"):
        listed = folder / SETS / f"{split}.txt"
        try:
            names = read_plain_text(listed).split()
        except (OSError, ValueError) as error:
            raise BadPhotographs(listed, f"cannot be read, expected a name per line: {error}") from None
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
            left, top, right, bottom = (float(box.findtext(side) or "") for side in ("xmin", "ymin", "xmax", "ymax"))
            item.add((left, top, right - left, bottom - top), f"object {number}")
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise BadPhotographs(path, f"is no annotation of KFuji's: {error}") from None
    return item
