"""The edited file: read whole, replaced whole, and never over another program's change."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pomona.executive.errors import UsageError
from pomona.tools.tree_editor.tree_file import ChangedOnDiskError, EditedFile, SaveRefusedError

WRITTEN = "pomona: 1\ntree: a\nroot:\n  wait: 1 s\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = tmp_path / "a.yaml"
    made.write_bytes(WRITTEN.encode())
    return made


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_file_keeps_its_line_ending_and_its_mark(path: Path, ending: str, mark: str) -> None:
    path.write_bytes((mark + WRITTEN.replace("\n", ending)).encode())
    file = EditedFile(path)
    disk = file.read()
    assert disk.text == WRITTEN
    assert disk.problem == ""
    file.save(disk.text.replace("1 s", "2 s"), disk.stamp)
    assert (
        path.read_bytes() == (mark + WRITTEN.replace("\n", ending).replace("1 s", "2 s")).encode()
    )


def test_a_file_with_two_line_endings_is_shown_and_not_saved(path: Path) -> None:
    path.write_bytes(b"pomona: 1\r\ntree: a\nroot: {wait: 1 s}\n")
    file = EditedFile(path)
    disk = file.read()
    assert "line ending" in disk.problem
    with pytest.raises(SaveRefusedError, match="line ending"):
        file.save(disk.text, disk.stamp)


def test_a_save_keeps_the_mode_and_leaves_nothing_beside(path: Path) -> None:
    path.chmod(0o640)
    file = EditedFile(path)
    saved = file.save("pomona: 1\n", file.read().stamp)
    assert path.stat().st_mode & 0o777 == 0o640
    assert (saved.text, [one.name for one in path.parent.iterdir()]) == ("pomona: 1\n", ["a.yaml"])


@pytest.mark.parametrize("other", ["a pipe", "a folder", "an endless device"])
def test_what_takes_the_place_of_the_file_is_reported_and_never_waited_for(
    path: Path, other: str
) -> None:
    file = EditedFile(path)
    stamp = file.read().stamp
    path.unlink()
    {
        "a pipe": os.mkfifo,
        "a folder": os.mkdir,
        "an endless device": lambda at: os.symlink("/dev/zero", at),
    }[other](path)
    disk = file.read()
    assert (disk.readable, "not a file" in disk.problem) == (False, True)
    with pytest.raises(SaveRefusedError):
        file.save(WRITTEN, stamp)
    assert not path.is_file()


def test_a_link_that_takes_the_place_of_the_file_is_not_replaced(path: Path) -> None:
    file = EditedFile(path)
    stamp = file.read().stamp
    path.rename(path.with_name("b.yaml"))
    path.symlink_to("b.yaml")
    with pytest.raises(SaveRefusedError, match="has become a link"):
        file.save("pomona: 1\n", stamp)
    assert path.is_symlink()
    assert path.read_text() == WRITTEN


def test_a_folder_that_is_gone_is_named(path: Path) -> None:
    file = EditedFile(path)
    path.rename(path.parent.with_name("elsewhere.yaml"))
    path.parent.rmdir()
    assert "is gone" in file.read().problem


def test_another_programs_change_is_not_overwritten(path: Path) -> None:
    file = EditedFile(path)
    before = file.read()
    path.write_text("pomona: 1\ntree: other\n")
    with pytest.raises(ChangedOnDiskError) as caught:
        file.save("mine\n", before.stamp)
    assert caught.value.disk.text == "pomona: 1\ntree: other\n" == path.read_text()


def test_the_later_of_two_editors_sees_a_conflict(path: Path) -> None:
    one, two = EditedFile(path), EditedFile(path)
    stamp = one.read().stamp
    one.save("one\n", stamp)
    with pytest.raises(ChangedOnDiskError):
        two.save("two\n", stamp)
    assert path.read_text() == "one\n"


def test_a_change_of_the_same_size_is_seen(path: Path) -> None:
    file = EditedFile(path)
    before = file.read()
    path.write_text(WRITTEN.replace("1 s", "2 s"))
    os.utime(path, ns=(path.stat().st_atime_ns, path.stat().st_mtime_ns + 1))
    assert file.read().stamp != before.stamp


def test_a_read_only_file_is_not_replaced(path: Path) -> None:
    path.chmod(0o444)
    file = EditedFile(path)
    disk = file.read()
    assert disk.problem == "the file is read-only"
    with pytest.raises(SaveRefusedError, match="read-only"):
        file.save("mine\n", disk.stamp)
    assert path.read_text() == WRITTEN


def test_a_link_stays_a_link(path: Path) -> None:
    link = path.parent / "link.yaml"
    link.symlink_to(path.name)
    file = EditedFile(link)
    assert file.link == str(path)
    file.save("mine\n", file.read().stamp)
    assert link.is_symlink()
    assert path.read_text() == "mine\n"


def test_a_new_file_is_written_only_by_a_save(tmp_path: Path) -> None:
    path = tmp_path / "new.yaml"
    file = EditedFile(path)
    disk = file.read()
    assert (disk.text, disk.stamp, disk.problem) == ("", "", "")
    assert not path.exists()
    file.save(WRITTEN, "")
    assert path.read_text() == WRITTEN


def test_a_file_that_is_gone_is_seen_and_can_be_written_again(path: Path) -> None:
    file = EditedFile(path)
    stamp = file.read().stamp
    path.unlink()
    assert file.read().stamp == ""
    with pytest.raises(ChangedOnDiskError):
        file.save("mine\n", stamp)
    file.save("mine\n", "")
    assert path.read_text() == "mine\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"x" * 10_000_000, r"has 10\.0 MB; a tree file has 512 KiB at most"), (b"\xff\xfe\x00", "not a text file"),
     (b"#" * 600_000, "longer than 512 KiB")],
)  # fmt: skip
def test_a_file_that_no_tree_can_be_is_refused_in_one_line(
    path: Path, content: bytes, words: str
) -> None:
    path.write_bytes(content)
    with pytest.raises(UsageError, match=words) as caught:
        EditedFile(path)
    assert "\n" not in str(caught.value)


def test_a_folder_a_missing_folder_and_a_loop_of_links_are_refused(tmp_path: Path) -> None:
    loop = tmp_path / "loop.yaml"
    loop.symlink_to(loop)
    for path in (tmp_path, tmp_path / "nowhere" / "a.yaml", loop):
        with pytest.raises(UsageError):
            EditedFile(path)
