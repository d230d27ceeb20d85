"""CRC-32 of a part, from the checksums before and behind it."""

from __future__ import annotations

import random
import zlib
from pathlib import Path
from types import SimpleNamespace

import pytest

from pomona.executive.recording import container
from pomona.executive.recording.checksum import crc_of_end, shifted
from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.scan import examine
from pomona.executive.running.events import NodeChanged, RunEnded


def test_the_checksum_of_an_end_is_zlibs() -> None:
    generator = random.Random(3)
    for length in (0, 1, 2, 3, 255, 256, 4_095, 65_536, 1_000_003):
        before, end = generator.randbytes(generator.randrange(70)), generator.randbytes(length)
        after = zlib.crc32(end, zlib.crc32(before))
        assert crc_of_end(zlib.crc32(before), after, length) == zlib.crc32(end), length


def test_zeros_shift_a_checksum_as_one_after_the_other() -> None:
    crc = zlib.crc32(b"pomona")
    for length in range(40):
        assert shifted(crc, length + 1) == shifted(shifted(crc, length), 1)


def test_each_byte_of_a_record_is_read_once_for_all_its_checksums(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "r").mkdir()
    recorder = Recorder(tmp_path / "r")
    for tick in range(3_000):
        recorder.on_event(NodeChanged(tick * 0.02, tick, "a", "RUNNING", f"at {tick}", 1))
    recorder.on_event(RunEnded(60.0, 3_000, "success", None, 3_000, 60.0, 60.0, None))
    recorder.close()
    path, counted = tmp_path / "r" / "run.mcap", 0

    def crc32(content: bytes, start: int = 0) -> int:
        nonlocal counted
        counted += len(content)
        return zlib.crc32(content, start)

    monkeypatch.setattr(container, "zlib", SimpleNamespace(crc32=crc32))
    assert examine(path).state == "whole"
    size = path.stat().st_size
    assert size > 4 * 65_536
    assert counted < 1.05 * size
