"""Learning of the kinds of fruit: pictures, finds, features, layers, score and the command."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

torch = pytest.importorskip("torch")

from pomona.skills.perception.detection.errors import BadPhotographs, BadTraining  # noqa: E402
from pomona.skills.perception.detection.onnx_runtime import judge_network, onnx_network  # noqa: E402
from pomona.tools.fruit_kinds.kind_head import NONE, KindScore  # noqa: E402
from pomona.tools.training import kind_learning  # noqa: E402
from pomona.tools.training.command_detector import add_train  # noqa: E402
from pomona.tools.training.kind_finds import (  # noqa: E402
    SIDE,
    UNKNOWN,
    KindFinds,
    KindPicture,
    _judged,
    collect,
    labelled_pictures,
    read_kind_table,
)
from pomona.tools.training.kind_learning import (  # noqa: E402
    exported_kinds,
    features,
    fit_kind_score,
    fitted,
    learn,
    probabilities,
    table,
    view,
)
from pomona.tools.training.kind_network import FEATURES, KindNetwork  # noqa: E402

KINDS = ("apple", "orange")
NAMES = (*KINDS, NONE)
COLOURS = {"apple": (220, 30, 30), "orange": (240, 150, 20), NONE: (30, 60, 200)}


def pictures_of(count: int) -> list[KindPicture]:
    """Pictures of each kind and split."""
    splits = [split for split in ("train", "val", "test") for _ in range(count)]
    return [
        KindPicture(Path(f"{kind}{k}.jpg"), kind, split, f"t:{kind}")
        for kind in NAMES
        for k, split in enumerate(splits)
    ]


def coloured(pictures: list[KindPicture]) -> KindFinds:
    """One find of each picture, in the colour of its kind."""
    rng = np.random.default_rng(0)
    shown = np.array([COLOURS[picture.kind] for picture in pictures], float)[:, None, None]
    noisy = np.clip(shown + rng.normal(0.0, 25.0, (len(pictures), SIDE, SIDE, 3)), 0, 255).astype(
        np.uint8
    )
    kinds = np.array([NAMES.index(picture.kind) for picture in pictures])
    count = len(pictures)
    return KindFinds(noisy, rng.uniform(0.4, 0.9, count), kinds, np.ones(count), np.arange(count))


@pytest.mark.slow
def test_colours_are_learnt_and_finds_of_other_pictures_are_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kind_learning, "EPOCHS", 60)
    monkeypatch.setattr(kind_learning, "BATCH", 16)
    pictures = pictures_of(4)
    finds = coloured(pictures)
    torch.manual_seed(1)
    network = KindNetwork(len(NAMES)).eval()
    learnt = features(network, finds, pictures, tmp_path, "cpu")
    learn(network, learnt, finds, pictures, NAMES)
    likely = probabilities(network, learnt.plain)
    tested = np.array([picture.split == "test" for picture in pictures])
    assert (likely[tested].argmax(axis=1) == finds.kinds[tested]).mean() >= 0.9
    score = fitted(network, learnt, finds, pictures, KINDS)
    val = np.array([picture.split == "val" for picture in pictures])
    sure = score.of(finds.scores, likely[:, 0]) >= 0.5 - 1e-9
    assert (finds.kinds[val & sure] == 0).mean() >= 0.9
    rows = table(network, learnt, finds, pictures, NAMES, score).splitlines()
    assert [row.split(" | ")[0] for row in rows[2:]] == ["| t:apple", "| t:none", "| t:orange"]
    content = exported_kinds(tmp_path / "a.kinds", network)
    judge_network(content, "a.kinds", "kinds.onnx")
    views = np.stack([view(picture) for picture in finds.pictures[:3]])
    planes = views.transpose(0, 3, 1, 2).astype(np.float32) / 255.0 - 0.5
    logits = onnx_network(content, "a.kinds", "kinds.onnx")(planes)[0]
    with torch.no_grad():
        assert np.allclose(logits, network(torch.from_numpy(planes)).numpy(), atol=0.05)


@pytest.mark.slow
def test_features_go_on_where_an_earlier_call_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures = pictures_of(1)
    finds = coloured(pictures)
    network = KindNetwork(len(NAMES)).eval()
    whole = features(network, finds, pictures, tmp_path, "cpu")
    with np.load(tmp_path / "features.npz") as stored:
        parts = {name: stored[name] for name in stored.files}
    del parts["4"]
    parts["3"] = parts["3"][:1]
    np.savez(tmp_path / "features.npz", **parts)
    again = features(network, finds, pictures, tmp_path, "cpu")
    assert np.allclose(again.changed, whole.changed, atol=1e-2)
    assert whole.plain.shape == (len(pictures), FEATURES)
    monkeypatch.setattr(kind_learning, "_read", lambda *_: pytest.fail("nothing is left to read"))
    features(network, finds, pictures, tmp_path, "cpu")


@pytest.mark.slow
def test_only_train_pictures_are_learnt_from(tmp_path: Path) -> None:
    pictures = pictures_of(2)
    finds = coloured(pictures)
    chosen = features(KindNetwork(len(NAMES)).eval(), finds, pictures, tmp_path, "cpu").chosen
    assert {pictures[owner].split for owner in finds.owners[chosen]} == {"train"}
    assert (finds.kinds[chosen] != UNKNOWN).all()


def test_a_kind_without_finds_is_refused(tmp_path: Path) -> None:
    pictures = [picture for picture in pictures_of(1) if picture.kind != "orange"]
    finds = coloured(pictures)
    network = KindNetwork(len(NAMES)).eval()
    with pytest.raises(BadTraining, match="no find of orange is there to learn from"):
        learn(network, features(network, finds, pictures, tmp_path, "cpu"), finds, pictures, NAMES)


def test_the_fitted_line_follows_the_kind_that_decides() -> None:
    rng = np.random.default_rng(0)
    scores, likely = rng.uniform(0.05, 0.95, 400), rng.uniform(0.05, 0.95, 400)
    line = fit_kind_score(scores, likely, likely > 0.6, np.ones(400))
    assert line.kind > 3.0 * line.found > 0.0
    assert isinstance(line, KindScore)
    assert ((line.of(scores, likely) >= 0.5) == (likely > 0.6)).mean() > 0.97


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_a_view_keeps_the_middle_of_a_find(seed: int | None) -> None:
    picture = np.zeros((SIDE, SIDE, 3), np.uint8)
    picture[52:76, 52:76] = 255
    shown = (
        view(picture, None if seed is None else np.random.default_rng(seed))
        .astype(float)
        .mean(axis=2)
    )
    weights = np.clip(shown - np.median(shown) - 30.0, 0.0, None)
    assert (weights.sum(axis=0) @ np.arange(96) / weights.sum()) == pytest.approx(47.5, abs=14.0)


def test_finds_at_labels_are_apples_and_sure_finds_beside_them_are_left_out() -> None:
    picture = KindPicture(
        Path("a.jpg"), "apple", "train", "s", boxes=np.array([[10.0, 10.0, 20.0, 20.0]])
    )
    boxes = np.array(
        [[11, 10, 20, 20], [60, 60, 20, 20], [60, 10, 20, 20], [18, 18, 20, 20]], float
    )
    kinds, weights = _judged(picture, np.array([0.1, 0.9, 0.1, 0.1]), boxes, KINDS)
    assert kinds.tolist() == [0, UNKNOWN, NAMES.index(NONE), UNKNOWN]
    assert weights.tolist() == [1.0, 1.0, 0.3, 1.0]


def write_table(folder: Path, text: str) -> Path:
    cv2.imwrite(str(folder / "a.png"), np.full((40, 40, 3), 90, np.uint8))
    (folder / "kinds.csv").write_text(f"picture,kind,split\n{text}\n")
    return folder / "kinds.csv"


def test_a_table_of_pictures_is_read(tmp_path: Path) -> None:
    (picture,) = read_kind_table(write_table(tmp_path, "a.png,orange,val"), KINDS)
    assert (picture.path, picture.kind, picture.split, picture.boxes) == (
        tmp_path / "a.png",
        "orange",
        "val",
        None,
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a.png,plum,val", "line 2: the kind 'plum' is not one of apple, orange, none"),
        ("a.png,apple,", "line 2: the split '' is not one of train, val, test"),
        ("b.png,apple,train", "line 2: there is no picture .*b.png"),
    ],
)
def test_a_wrong_row_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(BadPhotographs, match=message):
        read_kind_table(write_table(tmp_path, text), KINDS)


def test_a_picture_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    pictures = read_kind_table(write_table(tmp_path, "a.png,orange,val"), KINDS)
    pages = [Image.new("RGB", (40, 40), (10 * k, 90, 90)) for k in range(2)]
    pages[0].save(tmp_path / "a.png", save_all=True, append_images=pages[1:])
    with pytest.raises(
        BadPhotographs, match=r"a\.png: holds 2 pictures: store each that is wanted"
    ):
        collect(None, pictures, KINDS, tmp_path / "work")  # type: ignore[arg-type]


def test_groups_of_val_are_shared_between_fit_and_test(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    rows = [
        (f"{tree}{k}.png", tree, "train" if tree == "a" else "val")
        for tree in "abcde"
        for k in range(2)
    ]
    for name, _, _ in rows:
        cv2.imwrite(str(tmp_path / "images" / name), np.full((60, 60, 3), 90, np.uint8))
    (tmp_path / "images.csv").write_text(
        "image,tree,split\n" + "".join(f"{','.join(row)}\n" for row in rows)
    )
    (tmp_path / "fruit.csv").write_text(
        "image,x,y,w,h\n" + "".join(f"{name},5,5,20,20\n" for name, _, _ in rows)
    )
    found = {(picture.group, picture.split) for picture in labelled_pictures(tmp_path, 90)}
    assert found == {("a", "train"), ("b", "val"), ("c", "test"), ("d", "val"), ("e", "test")}
    assert len(labelled_pictures(tmp_path, 3)) == 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--out", "a.weights"), r"--out a\.weights: its name must end in \.kinds"),
        (
            ("--out", "a.kinds", "--kinds", "apple,none"),
            "--kinds apple,none: expected different names, without none",
        ),
        (("--out", "a.kinds"), "line 2: the kind 'pea' is not one of apple"),
    ],
)
def test_impossible_options_are_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    parser = argparse.ArgumentParser()
    add_train(parser.add_subparsers(required=True))
    given = [
        "train",
        "kinds",
        "--table",
        str(write_table(tmp_path, "a.png,pea,val")),
        "--trunk",
        "t.pth",
        *arguments,
    ]
    options = parser.parse_args(given)
    assert options.main(options) == 2
    text = capsys.readouterr().err
    assert text.startswith("pomona train: ")
    assert text.count("\n") == 1
    assert re.search(message, text)
