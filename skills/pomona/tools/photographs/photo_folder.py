"""Reads a folder of labelled photographs: tables, YOLO's text files, COCO's JSON, MinneApple or KFuji.

Everything is read and checked before anything is learnt: a mistake is named with its file and line.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pomona.executive.values.arrays import Float64
from pomona.executive.values.pictures import UnusablePicture, read_picture
from pomona.executive.values.plain_text import NoTableError, read_plain_text, read_table
from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.tools.box_detectors.box_settings import ClassUnknown, class_of
from pomona.tools.photographs.corners import (
    CORNERS,
    fit_as_corners,
    refuse_areas_of_corners,
    refuse_corners,
)
from pomona.tools.photographs.photographs import (
    PICTURES,
    Labelled,
    Photograph,
    PhotoSet,
    files,
    kfuji,
    kfuji_folder,
    minneapple,
    minneapple_folders,
    require_folder,
    scaled,
)

SLACK = 3.0  # a box may end this far outside of its picture, as rounding leaves it, and is cut there [px]

MOST_JSON = (
    1 << 30
)  # of a COCO file [bytes]; a hundred thousand pictures with their outlines have less

CLASSES = "classes.txt"  # names of classes, one per line, as labelImg and Label Studio write them

KPT_SHAPES = "`kpt_shape: [keypoints, numbers of each]`, [0, 0] for outlines"
KEYPOINT_SLACK = 0.01  # a box or a keypoint may end this far outside, in parts of the picture

TRAIN, VAL, NEITHER = ("train", "training"), ("val", "valid", "validation"), ("test", "testing")


def read_photographs(
    folder: Path, fruit: str = "apple", progress: Callable[[int, int], None] | None = None
) -> PhotoSet:
    """Read all labelled photographs of a folder; `progress` is called with (pictures checked, in all).

    Five layouts are known: `images.csv` (image, split, and tree or group) with `fruit.csv` (image, x, y, w, h in
    pixels, and crowd, 1 for a doubtful box) and the pictures in `images/`; YOLO's `images/` with `labels/` of the same
    names, or labels beside the pictures, and `data.yaml` or `classes.txt`; COCO's `.json`, also in folders of the
    splits; and the folders of MinneApple and KFuji RGB-DS as they are unpacked.

    Raises BadPhotographs: naming the file, and the line where there is one.
    """
    labelled = _labelled(folder, fruit)
    return _split(folder, labelled, _all_checked(labelled, progress))


def read_labels(
    place: Path, fruit: str = "apple", progress: Callable[[int, int], None] | None = None
) -> tuple[Photograph, ...]:
    """Read all labelled photographs of a folder, whatever their split, or of one of COCO's `.json` files.

    Raises BadPhotographs: as of `read_photographs`.
    """
    if place.suffix.lower() == ".json" and place.is_file():
        content = _json(place)
        if not isinstance(content, dict):
            raise BadPhotographs(
                place, "is no COCO file, expected images, annotations and categories"
            )
        return tuple(_all_checked(_coco(place, content, place.parent, fruit), progress))
    return tuple(_all_checked(_labelled(place, fruit), progress))


def _labelled(folder: Path, fruit: str) -> list[Labelled]:
    require_folder(folder)
    if (folder / "images.csv").is_file() or (folder / "fruit.csv").is_file():
        return _tables(folder)
    if coco := _coco_files(folder):
        return [
            item for path, content in coco.items() for item in _coco(path, content, folder, fruit)
        ]
    if yolo := _yolo_folders(folder):
        return _yolo(folder, yolo, fruit)
    if (place := kfuji_folder(folder)) is not None:
        return kfuji(place)
    if minneapple_folders(folder):
        return minneapple(folder)
    known = "images.csv with fruit.csv, YOLO's labels/, a .json of COCO's, masks/ of MinneApple, or KFuji's folder"
    raise BadPhotographs(folder, f"has no labels, expected {known}")


def _all_checked(
    labelled: list[Labelled], progress: Callable[[int, int], None] | None
) -> list[Photograph]:
    photographs, says = [], dict[Path, str]()
    for number, item in enumerate(labelled):
        if item.path in says:
            raise BadPhotographs(
                Path(item.says), f"labels {item.path.name}, as {says[item.path]} does: expected one"
            )
        says[item.path] = item.says
        photographs.append(_checked(item))
        if progress is not None:
            progress(number + 1, len(labelled))
    refuse_corners(labelled)
    return photographs


def read_empty(folder: Path) -> tuple[Photograph, ...]:
    """Return all pictures of a folder, in which no fruit is.

    Raises BadPhotographs: no such folder, none in it, or a file that is no picture.
    """
    paths = sorted(path for path in files(folder) if path.suffix.lower() in PICTURES)
    if not paths:
        raise BadPhotographs(folder, f"holds no pictures ({', '.join(PICTURES)})")
    return tuple(_checked(Labelled(path, str(folder))) for path in paths)


def _split(folder: Path, labelled: list[Labelled], photographs: list[Photograph]) -> PhotoSet:
    sets: dict[str, list[Photograph]] = {"train": [], "val": []}
    if any(item.split for item in labelled):
        for item, photograph in zip(labelled, photographs, strict=True):
            word = item.split.lower()
            if word in TRAIN or word in VAL:
                sets["train" if word in TRAIN else "val"].append(photograph)
            elif word not in NEITHER:
                raise BadPhotographs(
                    folder,
                    f"{item.path.name} is in the split '{item.split}', not in train, val or test",
                )
    else:
        by_name = sorted(photographs, key=lambda photograph: (photograph.group, photograph.name))
        # Without given splits, the last of this many parts by name is measured on: tiles of one place are neighbours
        first = len(by_name) - len(by_name) // 8
        while (
            0 < first < len(by_name)
            and by_name[first].group
            and by_name[first].group == by_name[first - 1].group
        ):
            first -= 1  # a group is measured on whole
        sets = (
            {"train": by_name[:first], "val": by_name[first:]}
            if first
            else {"train": by_name, "val": []}
        )
    shared = {p.group for p in sets["train"] if p.group} & {p.group for p in sets["val"] if p.group}
    if shared:
        raise BadPhotographs(
            folder, f"{sorted(shared)[0]} is in both train and val: expected groups in one of them"
        )
    if not any(len(photograph.boxes) for photograph in sets["train"]):
        raise BadPhotographs(folder, "no photograph of its train split has a box")
    return scaled(PhotoSet(tuple(sets["train"]), tuple(sets["val"])))


def _checked(item: Labelled) -> Photograph:
    """Return the photograph, once its file and every box have been looked at."""
    path = item.path
    if not path.is_file():
        raise BadPhotographs(path, f"is labelled in {item.says}, but there is no such picture")
    try:
        height, width = read_picture(path).shape[:2]
    except UnusablePicture as error:
        raise BadPhotographs(path, str(error)) from error
    if item.size is not None and item.size != (width, height):
        words = f"is {width} × {height}, {item.says} says {item.size[0]} × {item.size[1]}"
        turned = ": labels hold for pictures as they are seen, upright by their Exif orientation"
        raise BadPhotographs(path, words + (turned if item.size == (height, width) else ""))
    boxes = np.array(item.boxes, np.float64).reshape(-1, 4)
    with np.errstate(invalid="ignore", over="ignore"):  # boxes that are none are named below
        boxes *= (width, height, width, height) if item.parts else 1.0
        low, high = boxes[:, :2], boxes[:, :2] + boxes[:, 2:]
    limits = np.array([width, height], np.float64)
    for k in range(len(boxes)):
        if not np.isfinite(boxes[k]).all() or (boxes[k, 2:] <= 0.0).any():
            raise BadPhotographs(
                item.says, f"{item.lines[k]}: a box without width or height, or not finite"
            )
        if not item.parts and (high[k] <= 1.0).all():
            raise BadPhotographs(
                item.says, f"{item.lines[k]}: the box is in parts of the picture, expected pixels"
            )
        if item.parts and (boxes[k, 2:] > limits + SLACK).any():
            raise BadPhotographs(
                item.says, f"{item.lines[k]}: the box is in pixels, expected parts of the picture"
            )
        if (low[k] < -SLACK).any() or (high[k] > limits + SLACK).any():
            x, y, w, h = boxes[k]
            corners = (
                f"; as {CORNERS} it would: expected x, y, w, h"
                if fit_as_corners(item, limits)
                else ""
            )
            raise BadPhotographs(
                item.says,
                f"{item.lines[k]}: the box at {x:.0f}, {y:.0f} of {w:.0f} × {h:.0f} px does not lie in the picture "
                f"{path.name} of {width} × {height}{corners}",
            )
    once = np.sort(
        np.unique(boxes, axis=0, return_index=True)[1]
    )  # a line that stands twice is one fruit
    low, high = np.clip(low[once], 0.0, limits), np.clip(high[once], 0.0, limits)
    crowd = np.array(item.crowd, np.bool_)[once]
    return Photograph(path, width, height, np.hstack([low, high - low]), crowd, item.group)


def _tables(folder: Path) -> list[Labelled]:
    says, fruit = folder / "images.csv", folder / "fruit.csv"
    items: dict[str, Labelled] = {}
    for line, row in _rows(says, ("image", "split")):
        if row["image"] in items:
            raise BadPhotographs(says, f"line {line}: {row['image']} is listed twice")
        group = row.get("tree") or row.get("group") or ""
        items[row["image"]] = Labelled(
            folder / "images" / row["image"], str(fruit), row["split"], group, sizes=True
        )
    for line, row in _rows(fruit, ("image", "x", "y", "w", "h")):
        item = items.get(row["image"])
        if item is None:
            raise BadPhotographs(fruit, f"line {line}: {row['image']} is not in images.csv")
        try:
            box = float(row["x"]), float(row["y"]), float(row["w"]), float(row["h"])
        except ValueError:
            raise BadPhotographs(
                fruit, f"line {line}: x, y, w and h must be numbers [px]"
            ) from None
        item.add(box, f"line {line}", row.get("crowd") == "1")
    return list(items.values())


def _rows(path: Path, columns: tuple[str, ...]) -> Iterator[tuple[int, dict[str, str]]]:
    if not path.is_file():
        raise BadPhotographs(
            path, "no such file: images.csv lists the pictures and fruit.csv their boxes"
        )
    try:
        rows = read_table(path, columns, MOST_JSON)
    except NoTableError as error:
        raise BadPhotographs(path, str(error)) from error
    for line, row in rows:
        if any(row[name] is None for name in columns):
            raise BadPhotographs(path, f"line {line}: too few columns")
        yield line, row


def _yolo_folders(folder: Path) -> list[tuple[Path, Path]]:
    """Return the folders of texts, and of the pictures that belong to each; labelImg writes texts beside pictures."""
    found = [
        (labels, labels.parent / "images")
        for labels in sorted([*folder.glob("labels"), *folder.glob("*/labels")])
    ]
    return found or ([(folder, folder)] if (folder / CLASSES).is_file() else [])


def _yolo(folder: Path, places: Sequence[tuple[Path, Path]], fruit: str) -> list[Labelled]:
    """`images/` beside `labels/`, either with the splits as folders in them or inside folders of the splits."""
    names = _names(folder)
    wanted = None if names is None else _class_of(*names, fruit)
    keypoints = None if names is None else _keypoints(names[0])
    if keypoints is None:
        remedy = folder / "data.yaml" if names is None or names[0].suffix == ".txt" else names[0]
        _refuse_unstated_keypoints(remedy, [labels for labels, _ in places])
    items, seen = [], set()
    for labels, images in places:
        texts = {path.relative_to(labels).with_suffix("") for path in _texts(labels)}
        pictures = {
            p.relative_to(images).with_suffix(""): p
            for p in files(images)
            if p.suffix.lower() in PICTURES
        }
        _both(images, labels, set(pictures), texts)
        for name in sorted(texts):
            split = next(
                (w.lower() for w in (*name.parts[:-1], labels.parent.name) if _is_split(w)), ""
            )
            text = (labels / name).with_name(f"{name.name}.txt")
            item = Labelled(pictures[name], str(text), split, parts=True, sizes=True)
            for line, kind, box, outlined in _yolo_lines(text, keypoints or 0):
                if names is not None and kind not in names[1]:
                    raise BadPhotographs(
                        text, f"line {line}: the class {kind} has no name in {names[0]}"
                    )
                seen.add(kind)
                if wanted is None or kind == wanted:
                    item.add(box, f"line {line}")
                    item.sizes &= not outlined
            items.append(item)
    if wanted is None and len(seen) > 1:
        raise BadPhotographs(
            folder,
            f"its labels have {len(seen)} classes, and no data.yaml or {CLASSES} names the one that is {fruit}",
        )
    if wanted is None and seen - {0}:
        raise BadPhotographs(
            folder,
            f"its labels have class {min(seen)}, and no data.yaml or {CLASSES} gives its name: is it {fruit}?",
        )
    return items


def _both(images: Path, labels: Path, pictures: set[Path], texts: set[Path]) -> None:
    """Refuse pictures without labels, whose content is unknown, and labels without pictures."""
    for some, where, text in (
        (texts - pictures, labels, "has {n} without a picture in images/: {first}.txt"),
        (
            pictures - texts,
            images,
            "has {n} without a file in labels/: {first} (an empty file: no fruit)",
        ),
    ):
        if some:
            raise BadPhotographs(where, text.format(n=len(some), first=min(some)))


def _texts(labels: Path) -> list[Path]:
    return [path for path in files(labels) if path.suffix == ".txt" and path.name != CLASSES]


def _keypoints(path: Path) -> int | None:
    """Return how many numbers of keypoints follow each box, as `kpt_shape` of a data.yaml gives them; None without."""
    said = {} if path.suffix == ".txt" else yaml.safe_load(read_plain_text(path))
    if "kpt_shape" not in said:
        return None
    shape = said["kpt_shape"]
    if not (
        isinstance(shape, list | tuple)
        and len(shape) == 2
        and all(isinstance(n, int) for n in shape)
    ):
        raise BadPhotographs(path, "kpt_shape is not [keypoints, numbers of each]")
    return int(shape[0] * shape[1])


def _refuse_unstated_keypoints(remedy: Path, places: Sequence[Path]) -> None:
    """Raise BadPhotographs: all long lines can be boxes with keypoints, which outlines of their sizes rarely can."""
    long = []
    for text in (path for place in places for path in _texts(place)):
        with contextlib.suppress(OSError, ValueError):  # named when the file is read
            rows = (line.split() for line in read_plain_text(text).split("\n"))
            long += [(text, np.array(row[1:], float)) for row in rows if len(row) >= 7]
    if (
        long
        and len({len(values) for _, values in long}) == 1
        and all(_may_be_keypoints(values) for _, values in long)
    ):
        words = f"has {len(long[0][1])} numbers after each class: outlines, or boxes with keypoints"
        raise BadPhotographs(long[0][0], f"{words}? Write into {remedy} {KPT_SHAPES}")


def _may_be_keypoints(values: Float64) -> bool:
    """Return True if a line can be a box in the picture with keypoints in it, of two numbers or of three."""
    middle, half, rest = values[:2], 0.5 * values[2:4], values[4:]
    if (half <= 0.0).any() or (np.abs(middle - 0.5) + half > 0.5 + KEYPOINT_SLACK).any():
        return False
    for size in (n for n in (2, 3) if len(rest) % n == 0):
        points = rest.reshape(-1, size)
        inside = (np.abs(points[:, :2] - middle) <= half + KEYPOINT_SLACK).all(axis=1)
        seen = np.isin(points[:, 2:], (0.0, 1.0, 2.0)).all(axis=1)
        if (
            seen & (inside | ~points[:, :2].any(axis=1))
        ).all():  # (0, 0): a point that has no place
            return True
    return False


def _yolo_lines(
    path: Path, keypoints: int
) -> Iterator[tuple[int, int, tuple[float, float, float, float], bool]]:
    """Yield number, class and box (in parts of the picture) of each line, and True for the box of an outline."""
    try:
        lines = read_plain_text(path).split("\n")
    except (OSError, ValueError) as error:
        raise BadPhotographs(path, f"is no text: {error}") from None
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            kind, *values = (float(word) for word in line.split())
        except ValueError:
            raise BadPhotographs(
                path, f"line {number}: expected numbers: class, x, y, w, h"
            ) from None
        if not kind.is_integer():
            raise BadPhotographs(path, f"line {number}: the class {kind:g} is no whole number")
        if keypoints and len(values) > 4:
            if len(values) != 4 + keypoints:
                words = f"expected class, x, y, w, h and {keypoints} numbers of keypoints, as kpt_shape gives them"
                raise BadPhotographs(path, f"line {number}: {words}, not {len(values) + 1} numbers")
            values = values[:4]
        if len(values) == 4:
            x, y, w, h = values
            yield number, int(kind), (x - 0.5 * w, y - 0.5 * h, w, h), False
        elif len(values) >= 6 and len(values) % 2 == 0:
            across, down = values[::2], values[1::2]
            x, y = min(across), min(down)
            yield number, int(kind), (x, y, max(across) - x, max(down) - y), True
        else:
            raise BadPhotographs(
                path, f"line {number}: expected class, x, y, w, h, not {len(values) + 1} numbers"
            )


def _names(folder: Path) -> tuple[Path, dict[int, str]] | None:
    """Return the names of classes by their number, and the file that gives them; None where there is none.

    Raises BadPhotographs: a file cannot be read, or two contradict each other.
    """
    places = ("data.yaml", "data.yml", CLASSES, f"labels/{CLASSES}")
    found = {path: _names_in(path) for name in places if (path := folder / name).is_file()}
    if not found:
        return None
    first, names = next(iter(found.items()))
    for path, others in found.items():
        if others != names:
            raise BadPhotographs(path, f"names other classes than {first}: expected one of them")
    return first, names


def _names_in(path: Path) -> dict[int, str]:
    try:
        text = read_plain_text(path)
        content = {"names": text.split("\n")} if path.suffix == ".txt" else yaml.safe_load(text)
        names = content["names"]
        if not isinstance(names, dict | list):  # a single word would be a class for each letter
            raise TypeError(names)
        if content.get("nc", len(names)) != len(names):
            raise BadPhotographs(
                path, f"names {len(names)} classes, and nc is {content['nc']}: expected one number"
            )
        pairs = names.items() if isinstance(names, dict) else enumerate(names)
        return {int(number): str(name).strip() for number, name in pairs if str(name).strip()}
    except (yaml.MarkedYAMLError, UnicodeDecodeError, OSError) as error:
        mark = getattr(error, "problem_mark", None)
        reason = f"no YAML, at line {mark.line + 1}" if mark is not None else str(error)
        raise BadPhotographs(path, f"cannot be read: {reason}") from None
    except (yaml.YAMLError, RecursionError, KeyError, TypeError, ValueError):
        raise BadPhotographs(path, "does not name the classes: names: [apple]") from None


def _class_of(path: Path, names: dict[int, str], fruit: str) -> int:
    try:
        return class_of(names, fruit)
    except ClassUnknown as error:
        raise BadPhotographs(path, str(error)) from None


def _coco_files(folder: Path) -> dict[Path, Any]:
    """Return the content of all COCO files by path: in the folder, in `annotations/`, and in folders of the splits.

    Other tools write other JSON beside them. Raises BadPhotographs: a file is no JSON.
    """
    inside = sorted(place for place in folder.iterdir() if place.is_dir() and _is_split(place.name))
    found = {}
    for path in (
        path
        for place in (folder, folder / "annotations", *inside)
        for path in sorted(place.glob("*.json"))
    ):
        content = _json(path)
        if isinstance(content, dict) and content.keys() & {"images", "annotations"}:
            found[path] = content
    return found


def _json(path: Path) -> Any:
    try:
        return json.loads(read_plain_text(path, MOST_JSON))
    except (OSError, ValueError, RecursionError) as error:
        raise BadPhotographs(path, f"is no JSON: {error}") from error


def _coco(path: Path, content: dict[str, Any], folder: Path, fruit: str) -> list[Labelled]:
    names: dict[int, str] = {}
    for at, category in _entries(path, content, "categories"):
        number, name = _whole(path, at, category, "id"), _text(path, at, category, "name")
        if names.setdefault(number, name) != name:
            raise BadPhotographs(path, f"{at}: another category has the id {number}")
    wanted = _class_of(path, names, fruit)
    words = (
        *path.stem.replace("-", "_").split("_"),
        path.parent.name if path.parent != folder else "",
    )
    split = next((word for word in words if _is_split(word)), "")
    items = dict[str, Labelled]()
    for at, image in _entries(path, content, "images"):
        key, name = (
            _text(path, at, image, "id"),
            _text(path, at, image, "file_name").replace("\\", "/"),
        )
        if key in items:
            raise BadPhotographs(path, f"{at}: another picture has the id {key}")
        size = _whole(path, at, image, "width"), _whole(path, at, image, "height")
        items[key] = Labelled(_picture(folder, path, name), str(path), split, size=size, sizes=True)
    with_area: list[tuple[str, tuple[float, float, float, float], float]] = []
    for at, annotation in _entries(path, content, "annotations"):
        kind, key = (
            _whole(path, at, annotation, "category_id"),
            _text(path, at, annotation, "image_id"),
        )
        if kind not in names:
            raise BadPhotographs(path, f"{at}: its category {kind} is not in categories")
        if key not in items:
            raise BadPhotographs(path, f"{at}: its picture {key} is not in images")
        if kind == wanted:
            items[key].add(box := _box(path, at, annotation), at, bool(annotation.get("iscrowd")))
            if isinstance(area := annotation.get("area"), int | float) and 0 < area < np.inf:
                with_area.append((at, box, min(area, 1e300)))
    refuse_areas_of_corners(path, with_area)
    return list(items.values())


def _entries(path: Path, content: dict[str, Any], key: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the place and the content of each entry of a list of a COCO file."""
    entries = content.get(key)
    if not isinstance(entries, list):
        raise BadPhotographs(
            path, f"has no list of {key}, expected COCO's images, annotations and categories"
        )
    for number, entry in enumerate(entries):
        at = f"{key.replace('ies', 'ys')[:-1]} {number}"
        if not isinstance(entry, dict):
            raise BadPhotographs(path, f"{at}: expected names with values")
        yield at, entry


def _text(path: Path, at: str, entry: dict[str, Any], key: str) -> str:
    value = entry.get(key)
    if not isinstance(value, str | int):
        words = f"has no {key}" if value is None else f"its {key} is no text and no whole number"
        raise BadPhotographs(path, f"{at}: {words}")
    return str(value)


def _whole(path: Path, at: str, entry: dict[str, Any], key: str) -> int:
    if (
        isinstance(value := entry.get(key), float) and value.is_integer()
    ):  # as some tools write widths
        return int(value)
    try:
        return int(_text(path, at, entry, key))
    except ValueError:
        raise BadPhotographs(path, f"{at}: its {key} is no whole number") from None


def _box(path: Path, at: str, entry: dict[str, Any]) -> tuple[float, float, float, float]:
    try:
        x, y, w, h = (float(value) for value in entry["bbox"])
    except (KeyError, TypeError, ValueError, OverflowError):
        raise BadPhotographs(path, f"{at}: has no bbox of four numbers: x, y, w, h") from None
    return x, y, w, h


def _picture(folder: Path, described: Path, name: str) -> Path:
    places = [
        root / name
        for root in (described.parent, described.parent / "images", folder, folder / "images")
    ]
    return next((place for place in places if place.is_file()), places[0])


def _is_split(word: str) -> bool:
    return word.lower() in (*TRAIN, *VAL, *NEITHER)
