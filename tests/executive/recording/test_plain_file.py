from __future__ import annotations

from pathlib import Path

import pytest

from pomona.executive.errors import UsageError
from pomona.executive.recording.plain_file import made_whole


def test_a_new_file_appears_whole_with_its_name(tmp_path: Path) -> None:
    place = tmp_path / "made"
    with made_whole(place) as beside:
        beside.mkdir()
        (beside / "part").write_text("one")
        assert (beside.name, place.exists()) == ("made", False)
    assert [path.relative_to(tmp_path).as_posix() for path in sorted(tmp_path.rglob("*"))] == [
        "made",
        "made/part",
    ]


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), KeyboardInterrupt(), ValueError("odd")]
)
def test_half_of_it_is_left_nowhere(tmp_path: Path, error: BaseException) -> None:
    def make() -> None:
        with made_whole(tmp_path / "made") as beside:
            beside.write_text("half")
            raise error

    with pytest.raises(UsageError if isinstance(error, OSError) else type(error)) as caught:
        make()
    assert (
        not isinstance(error, OSError)
        or str(caught.value) == f"{tmp_path}/made: No space left on device"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("what", ["file", "folder", "link that leads nowhere"])
def test_existing_files_stay_before_and_meanwhile(tmp_path: Path, what: str) -> None:
    place = tmp_path / "made"

    def put() -> None:
        if what == "file":
            place.write_text("mine")
        elif what == "folder":
            place.mkdir()
        else:
            place.symlink_to("nowhere")

    def make() -> None:
        with made_whole(place) as beside:
            assert not list(tmp_path.glob("made")), "refused before anything is written"
            beside.mkdir()
            put()

    for _when in ("meanwhile", "before"):
        with pytest.raises(UsageError, match="exists, and nothing is overwritten"):
            make()
    assert list(tmp_path.iterdir()) == [place]
    assert place.is_symlink() or place.is_dir() or place.read_text() == "mine"
