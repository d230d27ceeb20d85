"""Weights files as runs read them."""

import json
from pathlib import Path
from zipfile import ZipFile

import pytest

from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.scores import PowerScore, ScoreMap
from pomona.skills.perception.detection.weights_file import StoredDetector, is_torch_file, read_weights, write_weights

STORED = StoredDetector(
    b"finder", b"close look", {"frames": "12"}, PowerScore(ScoreMap(0.7, -0.2)), {"finder": [8, 8, 8, 8]}
)


def about(path: Path, **changes: object) -> None:
    """Write a weights file whose about.json has other entries."""
    members = STORED.members()
    text = json.dumps(json.loads(members["about.json"]) | changes)
    with ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, text if name == "about.json" else content)


def test_a_file_that_was_written_is_read_alike_and_equal_content_gives_equal_files(tmp_path: Path) -> None:
    one, other = tmp_path / "one.weights", tmp_path / "folder" / "other.weights"
    write_weights(one, STORED)
    write_weights(other, STORED)
    assert read_weights(one) == STORED
    assert one.read_bytes() == other.read_bytes()
    assert not is_torch_file(one)
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
    for wrong in ({"slope": -1.0, "offset": 0.0}, {"slope": "nan", "offset": 0.0}, {"slope": 1.0}, "steep", None):
        about(path, scores=wrong)
        with pytest.raises(BadWeights, match=r"scores|about\.json"):
            read_weights(path)
