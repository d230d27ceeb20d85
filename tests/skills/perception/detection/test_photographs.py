"""Folders of pictures without fruit."""

from pathlib import Path

import pytest

from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.skills.perception.detection.photo_folder import read_empty
from tests.skills.perception.detection.photo_folders import tables


def test_a_folder_without_fruit_is_read_and_one_without_pictures_refused(tmp_path: Path) -> None:
    folder = tables(tmp_path / "set") / "images"
    read = read_empty(folder)
    assert len(read) == 4
    assert not any(len(photo.boxes) for photo in read)
    (folder / "broken.jpg").write_bytes(b"no picture")
    with pytest.raises(BadPhotographs, match=r"broken\.jpg: cannot be read as a picture"):
        read_empty(folder)
    (tmp_path / "bare").mkdir()
    with pytest.raises(BadPhotographs, match="bare: holds no pictures"):
        read_empty(tmp_path / "bare")
    with pytest.raises(BadPhotographs, match="nowhere: no such folder"):
        read_empty(tmp_path / "nowhere")
