"""Compare docs/records.md with the code."""

from __future__ import annotations

import re
from pathlib import Path

from pomona.executive.recording.mcap_file import FREE_GROWTH, MOST_GROWTH
from pomona.executive.recording.recorder import BATCH, CHUNK_BYTES
from pomona.tools.library.repair import repair

PAGE = re.sub(
    r"<!-- .*? -->",
    "",
    (Path(__file__).parents[3] / "docs" / "records.md").read_text(encoding="utf-8"),
)


def test_the_page_names_the_recorders_figures() -> None:
    assert f"messages of every {BATCH} s become one chunk (at most {CHUNK_BYTES // 1024} kB" in PAGE
    assert (
        f"at most {MOST_GROWTH} bytes for each byte read, and {FREE_GROWTH // 1_000_000} MB" in PAGE
    )


def test_the_page_names_every_file_that_a_repair_leaves() -> None:
    for name in ("run.mcap.tail", "run.mcap.damaged"):
        assert name in PAGE
        assert name in (repair.__doc__ or "")
