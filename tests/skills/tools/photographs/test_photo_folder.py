"""Folders of labelled photographs: every layout gives the same, and every mistake is named in one line."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.tools.photographs import photographs
from pomona.tools.photographs.photo_folder import read_labels, read_photographs
from tests.skills.tools.photographs.photo_folders import (
    SIDE,
    TRUTH,
    boxes_of,
    coco,
    draw,
    tables,
    yolo,
)


@pytest.mark.parametrize("layout", [tables, yolo, coco])
def test_every_layout_gives_the_same_photographs_and_boxes(
    layout: Callable[[Path], Path], tmp_path: Path
) -> None:
    photographs = read_photographs(layout(tmp_path))
    assert [photo.name for photo in photographs.train] == ["a_0.jpg", "a_1.jpg"]
    assert [photo.name for photo in photographs.val] == ["b_0.jpg", "b_1.jpg"]
    for photo in (*photographs.train, *photographs.val):
        assert np.allclose(
            photo.boxes, np.array(boxes_of(TRUTH[photo.name])).reshape(-1, 4), atol=1e-6
        )
        assert (photo.width, photo.height, photo.picture().shape) == (SIDE, SIDE, (SIDE, SIDE, 3))


def test_photographs_of_different_sizes_are_read_side_by_side(tmp_path: Path) -> None:
    folder = tables(tmp_path)
    draw(folder / "images" / "b_0.jpg", TRUTH["b_0.jpg"], side=2 * SIDE)
    assert [photo.width for photo in read_photographs(folder).val] == [2 * SIDE, SIDE]


def test_outlines_in_yolo_files_become_their_boxes(tmp_path: Path) -> None:
    folder = yolo(tmp_path)
    (folder / "train" / "labels" / "a_0.txt").write_text("1 0.1 0.2 0.4 0.2 0.4 0.6 0.1 0.5\n")
    assert np.allclose(
        read_photographs(folder).train[0].boxes, SIDE * np.array([[0.1, 0.2, 0.3, 0.4]])
    )


def one_square(folder: Path, texts: Path, count: int = 8) -> None:
    """Pictures with one fruit each, and its YOLO label in a folder."""
    texts.mkdir(parents=True, exist_ok=True)
    for k in range(count):
        draw(folder / f"p{k}.jpg", [(120.0, 120.0, 30.0)])
        (texts / f"p{k}.txt").write_text("1 0.5 0.5 0.25 0.25\n")


def test_label_studios_export_is_read_in_spite_of_its_notes(tmp_path: Path) -> None:
    one_square(tmp_path / "images", tmp_path / "labels")
    (tmp_path / "classes.txt").write_text("leaf\napple\n")
    (tmp_path / "notes.json").write_text(
        '{"categories": [{"id": 1, "name": "apple"}], "info": {"version": "1.0"}}'
    )
    photographs = read_photographs(tmp_path)
    assert (len(photographs.train), len(photographs.val)) == (7, 1)
    assert np.allclose(photographs.train[0].boxes, [[90.0, 90.0, 60.0, 60.0]])


@pytest.mark.parametrize("texts", ["labels", "images"])
def test_labelimg_writes_its_classes_among_the_labels(texts: str, tmp_path: Path) -> None:
    folder = tmp_path if texts == "labels" else tmp_path / "images"
    one_square(tmp_path / "images", tmp_path / texts)
    (tmp_path / texts / "classes.txt").write_text("leaf\napple\n")
    assert len(read_photographs(folder).train) == 7


def test_roboflows_splits_are_folders_with_a_coco_file_each(tmp_path: Path) -> None:
    for split, count in (("train", 4), ("valid", 2), ("test", 1)):
        for k in range(count):
            draw(tmp_path / split / f"p{k}.jpg", [(120.0, 120.0, 30.0)])
        images = [
            {"id": k, "file_name": f"p{k}.jpg", "width": SIDE, "height": SIDE} for k in range(count)
        ]
        boxes = [
            {"image_id": k, "category_id": "1", "bbox": [90, 90, 60, 60]} for k in range(count)
        ]
        names = [{"id": 0, "name": "apples", "supercategory": "none"}, {"id": 1, "name": "apple"}]
        content = {"images": images, "annotations": boxes, "categories": names}
        (tmp_path / split / "_annotations.coco.json").write_text(json.dumps(content))
    photographs = read_photographs(tmp_path)
    assert [
        (len(s), {p.path.parent.name for p in s}) for s in (photographs.train, photographs.val)
    ] == [
        (4, {"train"}),
        (2, {"valid"}),
    ]
    assert all(len(photo.boxes) == 1 for photo in photographs.train)


def test_crowds_in_coco_files_are_kept_apart(tmp_path: Path) -> None:
    folder = coco(tmp_path)
    path = folder / "annotations" / "instances_train.json"
    content = json.loads(path.read_text())
    content["annotations"][0]["iscrowd"] = 1
    path.write_text(json.dumps(content))
    photo = read_photographs(folder).train[0]
    assert photo.crowd.tolist() == [True, False]


def test_without_a_split_the_last_by_name_are_measured_on(tmp_path: Path) -> None:
    for k in range(16):
        draw(tmp_path / "images" / f"{k:02d}.png", [(100.0, 100.0, 30.0)])
        (tmp_path / "labels").mkdir(exist_ok=True)
        (tmp_path / "labels" / f"{k:02d}.txt").write_text("0 0.4 0.4 0.25 0.25\n")
    photographs = read_photographs(tmp_path)
    assert len(photographs.train) == 14
    assert [photo.name for photo in photographs.val] == ["14.png", "15.png"]


def turned(
    folder: Path, orientation: int, box: tuple[int, int, int, int], size: tuple[int, int]
) -> Path:
    """Photographs as a phone stores them: a disc at (80, 60) of the stored pixels, and labels of a tool."""
    stored = np.full((240, 320, 3), 40, np.uint8)
    cv2.circle(stored, (80, 60), 20, (220, 40, 40), -1)
    exif = Image.Exif()
    exif[0x0112] = orientation
    (folder / "images").mkdir(parents=True)
    Image.fromarray(stored).save(folder / "images" / "p.jpg", exif=exif.tobytes(), quality=98)
    content = {
        "images": [{"id": 0, "file_name": "p.jpg", "width": size[0], "height": size[1]}],
        "annotations": [{"image_id": 0, "category_id": 1, "bbox": box}],
        "categories": [{"id": 1, "name": "apple"}],
    }
    (folder / "labels.json").write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize(
    ("orientation", "box", "size"),
    [(1, (60, 40, 40, 40), (320, 240)), (3, (219, 159, 40, 40), (320, 240)), (6, (159, 60, 40, 40), (240, 320)),
     (8, (40, 219, 40, 40), (240, 320))],
)  # fmt: skip
def test_labels_and_pixels_of_a_turned_photograph_are_both_upright(
    orientation: int, box: tuple[int, int, int, int], size: tuple[int, int], tmp_path: Path
) -> None:
    photo = read_photographs(turned(tmp_path, orientation, box, size)).train[0]
    picture = photo.picture()
    assert picture.shape == (photo.height, photo.width, 3) == (size[1], size[0], 3)
    x, y, w, h = (int(v) for v in photo.boxes[0])
    assert (picture[y : y + h, x : x + w, 0] > 150).mean() == pytest.approx(np.pi / 4, abs=0.05)


def test_labels_of_stored_pixels_are_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(
        BadPhotographs,
        match=r"is 240 × 320, .* says 320 × 240: labels hold for pictures as they are",
    ):
        read_photographs(turned(tmp_path, 6, (60, 40, 40, 40), (320, 240)))


def _write(name: str, text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(text)


def _append(name: str, text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text((folder / name).read_text() + text)


def _cut(name: str, keep: int) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:keep])


def _renumber(folder: Path, kind: int) -> None:
    """Let all labels be of one class, without any names."""
    (folder / "data.yaml").unlink()
    for path in folder.rglob("labels/*.txt"):
        lines = [line.split() for line in path.read_text().splitlines() if line.strip()]
        path.write_text("".join(f"{' '.join([str(kind), *words[1:]])}\n" for words in lines))


def _remove(name: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).unlink()


def _encode(name: str, encoding: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text((folder / name).read_text(), encoding=encoding)


def _change(key: str, number: int = 0, **values: object) -> Callable[[Path], object]:
    """Change an entry of the COCO file of the photographs to learn from."""

    def change(folder: Path) -> None:
        path = folder / "annotations" / "instances_train.json"
        content = json.loads(path.read_text())
        content[key][number] |= values
        path.write_text(json.dumps(content))

    return change


def _animate(folder: Path) -> None:
    pages = [Image.new("RGB", (240, 240), (10 * k, 90, 90)) for k in range(2)]
    pages[0].save(folder / "images" / "a_0.jpg", "PNG", save_all=True, append_images=pages[1:])


def _twice(folder: Path) -> None:
    path = folder / "annotations" / "instances_train.json"
    path.with_name("instances_train_copy.json").write_text(path.read_text())


def _keypoints(folder: Path, shape: str, values: str = " 0.5 0.5 0.6 0.6") -> None:
    with (folder / "data.yaml").open("a") as stream:
        stream.write(f"kpt_shape: {shape}\n")
    for path in folder.glob("*/labels/*.txt"):
        path.write_text("".join(f"{line}{values}\n" for line in path.read_text().splitlines()))


def test_keypoints_behind_a_box_are_no_outline(tmp_path: Path) -> None:
    plain, posed = read_photographs(yolo(tmp_path / "plain")), yolo(tmp_path / "posed")
    _keypoints(posed, "[2, 2]")
    for some, others in zip(plain.train, read_photographs(posed).train, strict=True):
        np.testing.assert_array_equal(some.boxes, others.boxes)


def _lines(folder: Path, *lines: str) -> Path:
    for k, line in enumerate(lines):
        draw(folder / "images" / f"p{k}.jpg", [(120.0, 120.0, 30.0)])
        (folder / "labels" / f"p{k}.txt").write_text(line)
    return folder


@pytest.mark.parametrize("points", ["0.5 0.45 0.55 0.5", "0.5 0.45 1 0.55 0.5 2", "0.5 0.45 0 0"])
def test_keypoints_that_nothing_states_are_refused(tmp_path: Path, points: str) -> None:
    (tmp_path / "labels").mkdir()
    folder = _lines(tmp_path, *[f"0 0.5 0.5 0.25 0.25 {points}\n0 0.3 0.3 0.2 0.2\n"] * 3)
    with pytest.raises(
        BadPhotographs, match="numbers after each class: outlines, or boxes with keypoints"
    ):
        read_photographs(folder)


def test_outlines_that_could_be_keypoints_are_read_once_that_is_stated(tmp_path: Path) -> None:
    (tmp_path / "labels").mkdir()
    folder = _lines(tmp_path, "0 0.4 0.4 0.6 0.4 0.6 0.6 0.4 0.6\n")
    with pytest.raises(BadPhotographs, match=r"data\.yaml `kpt_shape: .*, \[0, 0\] for outlines"):
        read_photographs(folder)
    (folder / "data.yaml").write_text("names: [apple]\nkpt_shape: [0, 0]\n")
    assert np.allclose(
        read_photographs(folder).train[0].boxes, SIDE * np.array([[0.4, 0.4, 0.2, 0.2]])
    )


def test_one_outline_that_is_no_box_with_keypoints_makes_all_of_them_outlines(
    tmp_path: Path,
) -> None:
    (tmp_path / "labels").mkdir()
    lines = "0 0.4 0.4 0.6 0.4 0.6 0.6 0.4 0.6\n", "0 0.1 0.1 0.2 0.4 0.3 0.4 0.3 0.1\n"
    assert np.allclose(
        read_photographs(_lines(tmp_path, *lines)).train[0].boxes,
        SIDE * np.array([[0.4, 0.4, 0.2, 0.2]]),
    )


def test_a_line_that_stands_twice_is_one_fruit(tmp_path: Path) -> None:
    folder = yolo(tmp_path)
    before = read_photographs(folder).train[0].boxes
    path = folder / "train/labels/a_0.txt"
    path.write_text(2 * path.read_text())
    assert np.array_equal(read_photographs(folder).train[0].boxes, before)


def test_files_that_a_mac_hides_beside_pictures_and_labels_are_left_out(tmp_path: Path) -> None:
    folder = yolo(tmp_path)
    for path in [*folder.glob("*/*/*")]:
        (path.parent / f"._{path.name}").write_bytes(b"\0\5\x16\7")
    assert [photo.name for photo in read_photographs(folder).train] == ["a_0.jpg", "a_1.jpg"]


MISTAKES = [
    (
        yolo,
        lambda folder: _keypoints(folder, "[3, 2]"),
        r"line 1: expected class, x, y, w, h and 6 numbers of",
    ),
    (
        yolo,
        lambda folder: _keypoints(folder, "17"),
        r"data\.yaml: kpt_shape is not \[keypoints, numbers of each\]",
    ),
    (
        yolo,
        _append("train/labels/a_0.txt", "1 0.5 0.5 inf inf\n"),
        r"a_0\.txt: line 4: a box without width or height",
    ),
    (tables, _remove("fruit.csv"), r"fruit\.csv: no such file"),
    (tables, _remove("images.csv"), r"images\.csv: no such file"),
    (
        tables,
        _remove("images/a_1.jpg"),
        r"a_1\.jpg: is labelled in .*fruit\.csv, but there is no such picture",
    ),
    (
        tables,
        _append("fruit.csv", "c.jpg,1,1,9,9\n"),
        r"fruit\.csv: line 7: c\.jpg is not in images\.csv",
    ),
    (
        tables,
        _append("fruit.csv", "a_0.jpg,200,200,99,20\n"),
        r"line 7: the box at 200, 200 of 99 × 20 px does not lie in",
    ),
    (
        tables,
        _append("fruit.csv", "a_0.jpg,20,20,0,20\n"),
        r"line 7: a box without width or height",
    ),
    (
        tables,
        _append("fruit.csv", "a_0.jpg,nan,20,10,20\n"),
        r"line 7: a box without width or height",
    ),
    (
        tables,
        _append("fruit.csv", "a_0.jpg,20,20,ten,20\n"),
        r"line 7: x, y, w and h must be numbers",
    ),
    (tables, _append("fruit.csv", "a_0.jpg,20\n"), r"line 7: too few columns"),
    (tables, _append("images.csv", "a_0.jpg,a,train\n"), r"line 6: a_0\.jpg is listed twice"),
    (tables, _write("images.csv", "image,tree\n"), r"images\.csv: has no column split"),
    (
        tables,
        _write("images.csv", "image,split\na_0.jpg,half\n"),
        r"fruit\.csv: line 4: a_1\.jpg is not in images",
    ),
    (tables, _append("images.csv", "b_2.jpg,a,val\n"), r"b_2\.jpg: is labelled in"),
    (tables, _write("images/a_0.jpg", ""), r"a_0\.jpg: cannot be read as a picture"),
    (tables, _write("images/a_0.jpg", "no picture"), r"a_0\.jpg: cannot be read as a picture"),
    (
        tables,
        _cut("images/a_0.jpg", -2),
        r"a_0\.jpg: cannot be read as a picture: its end is missing",
    ),
    (
        tables,
        _animate,
        r"a_0\.jpg: holds 2 pictures: store each that is wanted in a file of its own",
    ),
    (tables, _write("fruit.csv", "image,x,y,w,h\n"), r"no photograph of its train split has a box"),
    (
        yolo,
        _write("data.yaml", "names: [leaf, tomato]\n"),
        r"data\.yaml: has the classes leaf, tomato: none of them is apple",
    ),
    (yolo, _write("data.yaml", "names: [red apple, green apple]\n"), r"2 of them could be apple"),
    (yolo, _write("data.yaml", "nc: 2\n"), r"data\.yaml: does not name the classes"),
    (
        yolo,
        _write("data.yaml", "names: [leaf, apple]\nnc: 1\n"),
        r"data\.yaml: names 2 classes, and nc is 1",
    ),
    (
        yolo,
        lambda folder: _renumber(folder, 7),
        r"its labels have class 7, and no data\.yaml or classes\.txt gives",
    ),
    (
        yolo,
        _remove("data.yaml"),
        r"its labels have 2 classes, and no data\.yaml or classes\.txt names the one",
    ),
    (
        yolo,
        _remove("train/labels/a_0.txt"),
        r"images: has 1 without a file in labels/: a_0 \(an empty file: no fruit\)",
    ),
    (
        yolo,
        _remove("train/images/a_0.jpg"),
        r"labels: has 1 without a picture in images/: a_0\.txt",
    ),
    (
        yolo,
        _append("train/labels/a_0.txt", "1 0.9 0.5 0.5 0.1\n"),
        r"a_0\.txt: line 4: the box at 156, 108 of 120 × 24 px",
    ),
    (
        yolo,
        _append("train/labels/a_0.txt", "1 0.9 0.5\n"),
        r"a_0\.txt: line 4: expected class, x, y, w, h, not 3 numbers",
    ),
    (
        yolo,
        _append("train/labels/a_0.txt", "apple 1 1 1 1\n"),
        r"a_0\.txt: line 4: expected numbers",
    ),
    (yolo, _append("train/labels/a_0.txt", "\n\n1 0.9 0.5\n"), r"a_0\.txt: line 6: expected class"),
    (
        yolo,
        _append("train/labels/a_0.txt", "nan 0.5 0.5 0.1 0.1\n"),
        r"line 4: the class nan is no whole number",
    ),
    (
        yolo,
        _append("train/labels/a_0.txt", "0.7 0.5 0.5 0.1 0.1\n"),
        r"line 4: the class 0\.7 is no whole number",
    ),
    (
        yolo,
        _append("train/labels/a_0.txt", "9 0.5 0.5 0.1 0.1\n"),
        r"a_0\.txt: line 4: the class 9 has no name in .*data\.yaml",
    ),
    (
        yolo,
        _write("classes.txt", "apple\nleaf\n"),
        r"classes\.txt: names other classes than .*data\.yaml",
    ),
    (
        yolo,
        _write("data.yaml", "names: [apple\n"),
        r"data\.yaml: cannot be read: no YAML, at line 2",
    ),
    (
        yolo,
        _encode("data.yaml", "utf-16"),
        r"data\.yaml: cannot be read: it is UTF-16; save it as UTF-8",
    ),
    (
        yolo,
        _encode("train/labels/a_0.txt", "utf-16"),
        r"a_0\.txt: is no text: it is UTF-16; save it as UTF-8",
    ),
    (
        tables,
        _append("fruit.csv", "a_0.jpg,0.2,0.2,0.1,0.1\n"),
        r"line 7: the box is in parts of the picture",
    ),
    (
        coco,
        _write("annotations/instances_val.json", "{"),
        r"instances_val\.json: is no JSON: Expecting",
    ),
    (
        coco,
        _write("annotations/instances_val.json", '{"images": []}'),
        r"has no list of categories, expected COCO's",
    ),
    (coco, _twice, r"copy\.json: labels a_0\.jpg, as .*instances_train\.json does"),
    (
        coco,
        _change("annotations", bbox=[0.1, 0.1, 0.2, 0.2]),
        r"annotation 0: the box is in parts of the picture",
    ),
    (
        coco,
        _change("annotations", bbox=[1, 2, 3]),
        r"annotation 0: has no bbox of four numbers: x, y, w, h",
    ),
    (coco, _change("annotations", bbox=None), r"annotation 0: has no bbox of four numbers"),
    (
        coco,
        _change("annotations", category_id=99),
        r"annotation 0: its category 99 is not in categories",
    ),
    (coco, _change("annotations", image_id=99), r"annotation 0: its picture 99 is not in images"),
    (coco, _change("annotations", image_id=None), r"annotation 0: has no image_id"),
    (coco, _change("images", 1, id=0), r"image 1: another picture has the id 0"),
    (coco, _change("images", width="wide"), r"image 0: its width is no whole number"),
    (coco, _change("categories", name=None), r"category 0: has no name"),
    (coco, _change("categories", 1, id=3), r"category 1: another category has the id 3"),
    (
        coco,
        _change("annotations", image_id=0.0),
        r"annotation 0: its image_id is no text and no whole number",
    ),
    (
        yolo,
        _write("data.yaml", "names: apple\n"),
        r"data\.yaml: does not name the classes: names: \[apple\]",
    ),
    (
        yolo,
        _append("train/labels/a_0.txt", "1 1e308 0.5 0.1 0.1\n"),
        r"a_0\.txt: line 4: a box without width or height",
    ),
    (
        coco,
        _remove("images/b_0.jpg"),
        r"b_0\.jpg: is labelled in .*instances_val\.json, but there is no such picture",
    ),
    (
        coco,
        lambda folder: draw(folder / "images" / "b_0.jpg", [], 300),
        r"b_0\.jpg: is 300 × 300, .*says 240 × 240",
    ),
]


@pytest.mark.parametrize(
    ("layout", "mistake", "says"), MISTAKES, ids=[says for _, _, says in MISTAKES]
)
def test_a_mistake_is_named_in_one_line(
    layout: Callable[[Path], Path], mistake: Callable[[Path], object], says: str, tmp_path: Path
) -> None:
    folder = layout(tmp_path)
    mistake(folder)
    with pytest.raises(BadPhotographs, match=says) as raised:
        read_photographs(folder)
    assert "\n" not in str(raised.value)


def test_one_place_is_never_both_learnt_from_and_measured_on(tmp_path: Path) -> None:
    folder = tables(tmp_path)
    (folder / "images.csv").write_text(
        (folder / "images.csv").read_text().replace("b_0.jpg,b,val", "b_0.jpg,a,val")
    )
    with pytest.raises(BadPhotographs, match="a is in both train and val"):
        read_photographs(folder)


def test_folders_that_are_none_or_hold_too_much_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(BadPhotographs, match="no such folder"):
        read_photographs(tmp_path / "elsewhere")
    draw(tmp_path / "empty" / "a.jpg", [])
    with pytest.raises(BadPhotographs, match=r"has no labels, expected images\.csv"):
        read_photographs(tmp_path / "empty")
    monkeypatch.setattr(photographs, "MOST_FILES", 1)
    with pytest.raises(BadPhotographs, match="holds more than 1 files"):
        read_photographs(yolo(tmp_path / "yolo"))


@pytest.mark.parametrize("layout", [tables, yolo, coco])
def test_labels_are_read_whatever_their_split(
    layout: Callable[[Path], Path], tmp_path: Path
) -> None:
    read = {photo.name: len(photo.boxes) for photo in read_labels(layout(tmp_path / "set"))}
    assert read == {name: len(discs) for name, discs in TRUTH.items()}


def test_one_coco_file_is_read_alone(tmp_path: Path) -> None:
    file = coco(tmp_path / "set") / "annotations" / "instances_val.json"
    for name in ("b_0.jpg", "b_1.jpg"):
        (file.parent / name).write_bytes((tmp_path / "set" / "images" / name).read_bytes())
    assert {photo.name for photo in read_labels(file)} == {"b_0.jpg", "b_1.jpg"}
    with pytest.raises(BadPhotographs, match="none of them is pear"):
        read_labels(file, "pear")


CORNERS = [(20.0, 30.0, 60.0, 80.0), (70.0, 40.0, 110.0, 90.0)]
"""Two fruit of one picture of 240 px; read as sizes they are larger boxes, which lie in it, too."""
PAIRS = {
    "tables": CORNERS,
    "coco": CORNERS,
    "yolo": [(100.0, 110.0, 140.0, 150.0), (60.0, 70.0, 100.0, 110.0)],
}


def labels_of(
    layout: str, folder: Path, boxes: list[tuple[float, float, float, float]], **more: float
) -> Path:
    """A picture with these four numbers as its boxes, as each layout writes them."""
    draw(folder / "images" / "p.jpg", [(40.0, 55.0, 20.0), (90.0, 65.0, 20.0)])
    if layout == "yolo":
        text = "\n".join(" ".join(["0", *(f"{value / SIDE}" for value in box)]) for box in boxes)
        (folder / "labels").mkdir()
        (folder / "labels" / "p.txt").write_text(text)
    elif layout == "tables":
        (folder / "images.csv").write_text("image,split\np.jpg,train\n")
        rows = ["p.jpg," + ",".join(str(value) for value in box) for box in boxes]
        (folder / "fruit.csv").write_text("\n".join(["image,x,y,w,h", *rows]))
    else:
        image = {"id": 1, "file_name": "p.jpg", "width": SIDE, "height": SIDE}
        found = [{"image_id": 1, "category_id": 1, "bbox": box, **more} for box in boxes]
        content = {
            "images": [image],
            "annotations": found,
            "categories": [{"id": 1, "name": "apple"}],
        }
        (folder / "labels.json").write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize("layout", ["tables", "coco", "yolo"])
def test_corners_in_place_of_sizes_are_refused(layout: str, tmp_path: Path) -> None:
    with pytest.raises(
        BadPhotographs, match=r"corners x1, y1, x2, y2, expected .*x, y, w, h: all 2 .* up to 2"
    ):
        read_labels(labels_of(layout, tmp_path, PAIRS[layout]))


@pytest.mark.parametrize("layout", ["tables", "coco", "yolo"])
def test_one_fruit_whose_box_is_no_corner_ends_the_doubt(layout: str, tmp_path: Path) -> None:
    boxes = [*PAIRS[layout], (150.0, 150.0, 40.0, 40.0)]
    assert len(read_labels(labels_of(layout, tmp_path, boxes))[0].boxes) == 3


def test_a_close_up_is_no_pair_of_corners(tmp_path: Path) -> None:
    photo = read_labels(labels_of("tables", tmp_path, [(20.0, 30.0, 200.0, 180.0)]))[0]
    assert photo.boxes.tolist() == [[20.0, 30.0, 200.0, 180.0]]


def test_the_area_of_a_single_box_says_that_it_is_of_corners(tmp_path: Path) -> None:
    box = CORNERS[:1]
    with pytest.raises(
        BadPhotographs, match=r"annotation 0: .* 20, 30, 60, 80 .* have 4800 px², its area is 2000"
    ):
        read_labels(labels_of("coco", tmp_path, box, area=2000.0))


@pytest.mark.parametrize("area", [4800.0, 3770.0, 10**400])
def test_an_area_of_the_box_or_of_the_fruit_in_it_is_no_doubt(area: float, tmp_path: Path) -> None:
    assert len(read_labels(labels_of("coco", tmp_path, CORNERS[:1], area=area))[0].boxes) == 1


def test_a_box_that_lies_in_the_picture_as_corners_only_is_named_so(tmp_path: Path) -> None:
    with pytest.raises(
        BadPhotographs, match=r"does not lie in .*; as corners x1, y1, x2, y2 it would"
    ):
        read_labels(labels_of("tables", tmp_path, [(120.0, 130.0, 160.0, 180.0)]))


def test_pixels_where_yolo_has_parts_of_the_picture_are_named_so(tmp_path: Path) -> None:
    one_square(tmp_path / "images", tmp_path / "labels", 1)
    (tmp_path / "labels" / "p0.txt").write_text("0 120 120 60 60\n")
    with pytest.raises(
        BadPhotographs, match="line 1: the box is in pixels, expected parts of the picture"
    ):
        read_labels(tmp_path)


@pytest.mark.parametrize(("width", "right"), [(240.0, True), (240.5, False), (float("inf"), False)])
def test_a_whole_number_may_be_written_with_a_point(
    width: float, right: bool, tmp_path: Path
) -> None:
    path = labels_of("coco", tmp_path, [(20.0, 30.0, 60.0, 60.0)]) / "labels.json"
    content = json.loads(path.read_text())
    content["images"][0]["width"] = width
    path.write_text(json.dumps(content))
    if right:
        assert read_labels(tmp_path)[0].width == SIDE
    else:
        with pytest.raises(
            BadPhotographs, match="image 0: its width is no text and no whole number"
        ):
            read_labels(tmp_path)
