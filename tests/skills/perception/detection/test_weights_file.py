"""Weights files as runs read them."""

import json
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.weights_file import (
    HOPELESS,
    FusedScore,
    PowerScore,
    ScoreMap,
    StoredDetector,
    read_fused_score,
    read_weights,
    write_weights,
)

STORED = StoredDetector(
    b"finder",
    b"close look",
    {"frames": "12"},
    PowerScore(ScoreMap(0.7, -0.2)),
    {"finder": [8, 8, 8, 8]},
)


def about(path: Path, **changes: object) -> None:
    """Write a weights file whose about.json has other entries."""
    members = STORED.members()
    text = json.dumps(json.loads(members["about.json"]) | changes)
    with ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, text if name == "about.json" else content)


def test_a_file_that_was_written_is_read_alike_and_equal_content_gives_equal_files(
    tmp_path: Path,
) -> None:
    one, other = tmp_path / "one.weights", tmp_path / "folder" / "other.weights"
    write_weights(one, STORED)
    write_weights(other, STORED)
    assert read_weights(one) == STORED
    assert one.read_bytes() == other.read_bytes()
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["one.weights"]


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.weights"
    with pytest.raises(BadWeights, match=r"other\.weights: no such file"):
        read_weights(path)
    path.write_bytes(b"\x00" * 100)
    with pytest.raises(BadWeights, match="cannot be read as weights: BadZipFile"):
        read_weights(path)
    with ZipFile(path, "w") as archive:
        archive.writestr("letter.txt", "no weights")
    with pytest.raises(BadWeights, match="is not a 'pomona compact detector 3' file"):
        read_weights(path)
    write_weights(path, STORED)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(BadWeights, match="cannot be read as weights"):
        read_weights(path)


def test_a_format_or_a_map_of_scores_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    path = tmp_path / "wrong.weights"
    about(path, format="pomona compact detector 4")
    with pytest.raises(BadWeights, match="has the format 'pomona compact detector 4', expected"):
        read_weights(path)
    for wrong in (
        {"slope": -1.0, "offset": 0.0},
        {"slope": "nan", "offset": 0.0},
        {"slope": 1.0},
        "steep",
        None,
    ):
        about(path, scores=wrong)
        with pytest.raises(BadWeights, match=r"scores|about\.json"):
            read_weights(path)


def calibration_error(scores: np.ndarray, right: np.ndarray) -> float:
    """Return the mean of |mean score - ratio right| over ten bins of equal width, weighted by their counts."""
    which = np.minimum((scores * 10).astype(int), 9)
    bins = [which == k for k in range(10) if (which == k).any()]
    return sum(abs(float((scores - right)[inside].sum())) for inside in bins) / len(scores)


def test_a_map_is_a_line_through_logits_and_keeps_the_order() -> None:
    rng = np.random.default_rng(0)
    scores = rng.uniform(0.01, 0.99, 20_000)
    logit = np.log(scores / (1.0 - scores))
    right = rng.random(20_000) < 1.0 / (
        1.0 + np.exp(-(0.6 * logit - 0.8))
    )  # surer than it should be
    line = ScoreMap(0.6, -0.8)
    assert calibration_error(scores, right) > 0.1
    assert calibration_error(line.of(scores), right) < 0.02
    assert np.array_equal(np.argsort(line.of(scores)), np.argsort(scores))
    assert line(0.3) == pytest.approx(float(line.of(np.array([0.3]))[0]))
    assert ScoreMap()(0.123) == 0.123


def test_a_score_of_powers_is_the_geometric_mean_over_both_looks() -> None:
    belief, first, second = 0.8, 0.6, 0.9
    features = np.log(np.array([[belief, 0.5, first, second]])) - np.log1p(
        -np.array([[belief, 0.5, first, second]])
    )
    expected = np.sqrt(np.sqrt(belief * first) * np.sqrt(belief * second))
    assert PowerScore().of(features) == pytest.approx([expected])
    assert PowerScore(ScoreMap(0.7, -0.2)).of(features) == pytest.approx(
        [ScoreMap(0.7, -0.2)(expected)]
    )
    assert PowerScore(ScoreMap(0.7, -0.2)).hopeless == ScoreMap(0.7, -0.2)(HOPELESS)
    assert PowerScore().of(np.full((1, 4), -800.0)) == pytest.approx([0.0])


def test_the_score_is_the_nets_own_arithmetic_and_survives_its_file() -> None:
    hidden, output = (
        np.array([[0.5, 0.0, 1.0, 0.0, -0.2], [0.0, 0.1, 0.0, 2.0, 0.3]]),
        np.array([1.5, -0.5, 0.25]),
    )
    score = FusedScore(hidden, output)
    units = np.tanh([0.5 * 2.0 + 1.0 * -1.0 - 0.2, 0.1 * 3.0 + 2.0 * 0.5 + 0.3])
    expected = 1.0 / (1.0 + np.exp(-(1.5 * units[0] - 0.5 * units[1] + 0.25)))
    features = np.array([[2.0, 3.0, -1.0, 0.5]])
    assert score.of(features) == pytest.approx([expected])
    assert read_fused_score(score.content()).of(features) == pytest.approx([expected])


def test_logits_without_bound_give_scores_between_zero_and_one() -> None:
    score = FusedScore(np.ones((1, 5)), np.array([3.0, 0.0]))
    values = score.of(np.array([[np.inf] * 4, [-np.inf] * 4, [np.nan] * 4]))
    assert ((values >= 0.0) & (values <= 1.0)).all()


@pytest.mark.parametrize(
    "content",
    [
        {"hidden": [[1.0, 2.0]], "output": [1.0, 2.0]},
        {"hidden": [[1.0] * 5], "output": [1.0]},
        {"hidden": [[float("nan")] * 5], "output": [1.0, 0.0]},
    ],
)
def test_a_net_of_another_form_is_refused(content: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="a net"):
        read_fused_score(content)
