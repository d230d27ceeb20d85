"""A few thousand damaged frames of every codec; `python -m benchmarks.fuzz_codecs` does a million."""

from collections.abc import Callable

import pytest

from benchmarks.fuzz_codecs import FUZZERS, FramesLost


@pytest.mark.parametrize("fuzz", FUZZERS)
def test_every_intact_frame_is_found_among_damaged_ones(
    fuzz: Callable[[int, int], FramesLost],
) -> None:
    report = fuzz(4000, 1)
    assert report.intact > 1500
    assert report.missed == 0
    assert report.excused <= 0.02 * report.intact
