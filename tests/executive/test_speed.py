"""A speed as people write it."""

from __future__ import annotations

import math

import pytest

from pomona.executive.speed import SpeedRefusedError, checked_speed, speed_of, words_of


def test_a_share_is_read_and_written() -> None:
    assert speed_of("30 %") == pytest.approx(0.3)
    assert speed_of("0.5") == 0.5
    assert speed_of("100%") == 1.0
    assert words_of(speed_of("10 %")) == "10 %"


@pytest.mark.parametrize(
    "text",
    ["0", "5 %", "9.9 %", "150 %", "30", "-50 %", "nan", "NaN %", "inf", "1e400 %", "fast", ""],
)
def test_an_invalid_speed_is_refused_with_the_valid_range(text: str) -> None:
    with pytest.raises(SpeedRefusedError, match="%"):
        speed_of(text)


def test_a_share_that_was_computed_is_held_against_the_same_limits() -> None:
    for share in (math.nan, math.inf, 0.0, -1.0, 1.01):
        with pytest.raises(SpeedRefusedError, match="10 % to 100 %"):
            checked_speed(share)
