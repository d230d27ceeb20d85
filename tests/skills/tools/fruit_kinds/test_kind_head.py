"""The kind of each find: the file, the picture of a find, and scores for one kind."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.skills.perception import load_fruit
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.detection import DetectorOptions
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.instances import FoundFruit
from pomona.tools.fruit_kinds.kind_head import (
    ABOUT,
    CONTEXT,
    NETWORK,
    NONE,
    SIDE,
    KindHead,
    KindScore,
    StoredKinds,
    find_picture,
    read_kinds,
)
from tests.skills.tools.fruit_kinds.kinds_files import colour_kinds, colour_network


def found(box: tuple[float, float, float, float], score: float = 0.5) -> FoundFruit:
    place = np.array([0.0, 0.0, 1.0])
    return FoundFruit(place, place, np.zeros(2), 10.0, np.ones(3), score, 1.0, np.array(box, float))


def halves() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """A picture that is red at the left and green at the right."""
    picture = np.zeros((120, 240, 3), np.uint8)
    picture[:, :120, 0] = picture[:, 120:, 1] = 255
    return picture


def test_a_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    stored = read_kinds(colour_kinds(tmp_path / "a.kinds"))
    kinds, about = ("apple", "lime", NONE), {"made": "for tests"}
    assert stored == StoredKinds(colour_network(), kinds, KindScore(1.0, 1.0, 0.0), about)


def test_a_find_has_a_high_score_only_for_its_own_kind(tmp_path: Path) -> None:
    head = KindHead.load(colour_kinds(tmp_path / "a.kinds"))
    finds = [found((20, 20, 40, 40)), found((170, 20, 40, 40))]
    for kind, right in (("apple", 0), ("lime", 1)):
        scores = [fruit.score for fruit in head.judged(halves(), finds, kind)]
        assert scores[right] > 0.99
        assert scores[1 - right] < 0.01


@pytest.mark.parametrize("kind", ["", "plum", NONE])
def test_scores_for_an_unknown_kind_stay_as_they_are(tmp_path: Path, kind: str) -> None:
    finds = [found((20, 20, 40, 40), 0.7)]
    assert KindHead.load(colour_kinds(tmp_path / "a.kinds")).judged(halves(), finds, kind) == finds


def test_a_file_beside_the_weights_judges_what_they_find(tmp_path: Path) -> None:
    weights = load_fruit("apple").weights
    assert weights is not None
    plain = CompactDetector.load(weights, DetectorOptions(finder_threshold=0.02, kind="apple"))
    shutil.copyfile(weights, tmp_path / "mine.weights")
    colour_kinds(tmp_path / "mine.kinds")
    judged = CompactDetector.load(tmp_path / "mine.weights", plain.options)
    picture = np.zeros((240, 320, 3), np.uint8)
    yy, xx = np.mgrid[:240, :320]
    picture[(yy - 120) ** 2 + (xx - 160) ** 2 < 40**2] = (20, 30, 220)  # a blue ball: no apple
    K = np.array([[320.0, 0.0, 160.0], [0.0, 320.0, 120.0], [0.0, 0.0, 1.0]])
    before = plain.find(picture, K)
    after = judged.find(picture, K)
    assert before
    assert max(fruit.score for fruit in after) < 0.2 * max(fruit.score for fruit in before)
    unknown = judged.looking(DetectorOptions(finder_threshold=0.02, kind="plum"))
    assert [fruit.score for fruit in unknown.find(picture, K)] == [fruit.score for fruit in before]


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-5.0, 5.0))
def test_a_surer_find_or_a_likelier_kind_never_lowers_a_score(
    low: float, high: float, kind: float, offset: float
) -> None:
    low, high = sorted((low, high))
    score = KindScore(0.7, 1.3, offset)
    one = np.array([kind])
    assert score.of(np.array([low]), one) <= score.of(np.array([high]), one)
    assert score.of(one, np.array([low])) <= score.of(one, np.array([high]))
    assert 0.0 <= score.of(np.array([high]), one)[0] <= 1.0


@given(st.floats(-30, 230), st.floats(-30, 110), st.floats(1, 300), st.floats(1, 300))
def test_a_box_anywhere_has_a_picture(x: float, y: float, width: float, height: float) -> None:
    shown = find_picture(halves(), np.array([x, y, width, height]))
    assert shown.shape == (SIDE, SIDE, 3)


@pytest.mark.parametrize("side", [20.0, 60.0])
def test_a_find_is_in_the_middle_of_its_picture_at_any_size(side: float) -> None:
    picture = np.zeros((400, 400, 3), np.uint8)
    low, high = round(200 - side / 2), round(200 + side / 2)
    picture[low:high, low:high] = 255
    shown = find_picture(picture, np.array([low, low, side, side]))[:, :, 0] > 127
    rows, columns = np.nonzero(shown)
    assert rows.mean() == pytest.approx(0.5 * (SIDE - 1), abs=0.6)
    assert columns.mean() == pytest.approx(0.5 * (SIDE - 1), abs=0.6)
    assert np.ptp(rows) + 1 == pytest.approx(SIDE / CONTEXT, abs=3)


def test_files_of_another_form_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.kinds"
    with pytest.raises(BadWeights, match="cannot be read as kinds of fruit: FileNotFoundError"):
        KindHead.load(path)
    path.write_text("no archive")
    with pytest.raises(BadWeights, match="cannot be read as kinds of fruit: BadZipFile"):
        KindHead.load(path)
    for kinds in (("apple", "pear"), (NONE,), ("apple", "apple", NONE)):
        with pytest.raises(
            BadWeights, match=r"has the kinds .*: expected names, the last of them none"
        ):
            KindHead.load(colour_kinds(path, kinds))
    with pytest.raises(BadWeights, match=r"kinds\.onnx in it does not give 3 finite logits"):
        KindHead.load(colour_kinds(path, rows=2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"format": "pomona kinds of fruit 9"},
            "has the format 'pomona kinds of fruit 9', expected",
        ),
        ({"score": {"found": -1.0, "kind": 1.0, "offset": 0.0}}, "has a score that does not rise"),
        (
            {"score": {"found": 1.0, "kind": 1.0, "offset": float("nan")}},
            "has a score that does not rise",
        ),
        ({"score": {}}, "cannot be read as kinds of fruit: KeyError"),
    ],
)
def test_a_damaged_description_is_refused(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    with ZipFile(colour_kinds(tmp_path / "a.kinds")) as archive:
        about = json.loads(archive.read(ABOUT)) | change
    with ZipFile(tmp_path / "a.kinds", "w") as archive:
        archive.writestr(NETWORK, colour_network())
        archive.writestr(ABOUT, json.dumps(about))
    with pytest.raises(BadWeights, match=message):
        KindHead.load(tmp_path / "a.kinds")
