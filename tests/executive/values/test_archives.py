"""Archives that unpack to more than their reader takes are refused before anything is unpacked."""

from __future__ import annotations

import io
import resource
import struct
from pathlib import Path
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, BadZipFile, ZipFile

import pytest
from hypothesis import given, settings, strategies as st

from pomona.executive.values import archives
from pomona.executive.values.archives import ArchiveTooLarge, open_archive


def test_an_archive_of_many_bytes_members_or_another_method_is_refused_with_both_values(
    tmp_path: Path,
) -> None:
    path = tmp_path / "x.zip"
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        archive.writestr("a", bytes(30_000_000))
    assert path.stat().st_size < 100_000
    with pytest.raises(ArchiveTooLarge, match="unpacks to 30 MB; 20 MB are read at most"):
        open_archive(path, 20_000_000)
    with open_archive(path, 30_000_000) as archive:
        assert len(archive.read("a")) == 30_000_000
    with ZipFile(path, "w") as archive:
        for k in range(50):
            archive.writestr(str(k), b"")
    with pytest.raises(ArchiveTooLarge, match="has 50 members; 10 are read at most"):
        open_archive(path, 1000, 10)
    with ZipFile(path, "w", ZIP_BZIP2) as archive:
        archive.writestr("a", b"a")
    with pytest.raises(ArchiveTooLarge, match="another method than deflation"):
        open_archive(path, 1000)


def test_a_large_directory_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "x.zip"
    with ZipFile(path, "w") as archive:
        for k in range(3000):
            archive.writestr("n" * 300 + str(k), b"")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(
        ArchiveTooLarge, match=r"has a directory of 1\.\d MB; at most 1000 members are read"
    ):
        open_archive(path, 1000, 1000)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000


def test_a_member_that_unpacks_to_more_than_the_directory_states_gives_no_more(
    tmp_path: Path,
) -> None:
    path = tmp_path / "x.zip"
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        archive.writestr("a", bytes(5_000_000))
        archive.infolist()[0].file_size = 1000
    with open_archive(path, 2000) as archive, pytest.raises(BadZipFile, match="CRC"):
        archive.read("a")


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_a_damaged_archive_is_opened_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("zip") / "x.zip"
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        archive.writestr("a", b"abc" * 50)
        archive.writestr("b", b"")
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(
        content[: data.draw(st.integers(0, len(content)))] if data.draw(st.booleans()) else content
    )
    try:
        with open_archive(path, 1000) as archive:
            assert sum(member.file_size for member in archive.infolist()) <= 1000
    except (BadZipFile, OSError, NotImplementedError, ValueError):
        pass


def ends(stated: int, comment: bytes = b"", large: int | None = None, marked: bool = True) -> bytes:
    """The last records of an archive whose directory has a size, in the long form if `large` is given."""
    long_form = b""
    if large is not None:
        record = b"PK\6\6" if marked else b"PK\0\0"
        long_form = record + struct.pack("<QHHLLQQQQ", 44, 45, 45, 0, 0, 1, 1, large, 0)
        long_form += b"PK\6\7" + struct.pack("<LQL", 0, 0, 1)
    return (
        long_form
        + b"PK\5\6"
        + struct.pack("<HHHHLLH", 0, 0, 1, 1, stated, 0, len(comment))
        + comment
    )


@pytest.mark.parametrize("before", [b"", b"x" * 300])
@pytest.mark.parametrize(
    ("records", "size"),
    [
        (ends(1234), 1234),
        (ends(1234, b"a comment"), 1234),
        (ends(0xFFFFFFFF, large=5_000_000_000), 5_000_000_000),
        (ends(70, large=60), 70),  # the larger one counts
        (ends(60, large=70), 70),
        (ends(60, large=70, marked=False), 60),
        (ends(0xFFFFFFFF), 0xFFFFFFFF),
        (ends(1234)[:21], 0),
        (b"no archive", 0),
        (b"", 0),
        (ends(1) + ends(2), 2),
    ],
)
def test_the_size_of_the_directory_is_that_of_the_last_records(
    before: bytes, records: bytes, size: int
) -> None:
    assert archives._directory_size(io.BytesIO(before + records)) == size
