"""Files of arrays that are damaged, huge or hostile are refused in words."""

from __future__ import annotations

import io
import os
import random
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from pomona.executive.values.archives import MOST_BYTES, UnreadableArraysError, read_plain_arrays


def packed(header: str) -> bytes:
    """Return a file with one array and this header."""
    written = io.BytesIO()
    text = header.ljust(117) + "\n"
    with ZipFile(written, "w") as archive:
        archive.writestr(
            "a.npy",
            b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + bytes(24),
        )
    return written.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        b"", b"PK", b"not a zip",
        packed("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000, 25), }"),
        packed("{'descr': 'O', 'fortran_order': False, 'shape': (3,), }"),
        packed("{'descr': " + "[" * 60 + ", 'fortran_order': False, 'shape': (3,), }"),
        packed("{'descr': '<f8', 'fortran_order': False, 'shape': (-3,), }"),
    ],
)  # fmt: skip
def test_a_file_without_arrays_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.npz").write_bytes(content)
    with pytest.raises(UnreadableArraysError):
        read_plain_arrays(tmp_path / "x.npz")


def test_a_damaged_file_is_read_or_refused(tmp_path: Path) -> None:
    chance, path = random.Random(3), tmp_path / "x.npz"
    np.savez_compressed(path, a=np.random.default_rng(3).random((40, 6)))
    whole, refused = path.read_bytes(), 0
    assert read_plain_arrays(path)["a"].shape == (40, 6)
    for _ in range(200):
        damaged = bytearray(whole)
        for _ in range(3):
            damaged[chance.randrange(len(damaged))] = chance.randrange(256)
        path.write_bytes(damaged)
        try:
            read_plain_arrays(path)
        except UnreadableArraysError:
            refused += 1
    assert refused > 100


def test_a_file_that_unpacks_to_more_than_memory_and_a_pipe_are_not_opened(tmp_path: Path) -> None:
    with ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("a.npy", b"")
        archive.infolist()[0].file_size = MOST_BYTES + 1
    with pytest.raises(UnreadableArraysError, match="unpacks to 1074 MB; 1074 MB are read at most"):
        read_plain_arrays(tmp_path / "x.npz")
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(UnreadableArraysError, match="it is not a file"):
        read_plain_arrays(tmp_path / "pipe.npz")
