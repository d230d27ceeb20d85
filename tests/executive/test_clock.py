"""The clock of a run on real devices."""

from __future__ import annotations

import time

import pytest

from pomona.executive.clock import SystemClock


def test_the_systems_clock_goes_on_while_the_computer_sleeps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clocks = {time.CLOCK_MONOTONIC: 10.0, time.CLOCK_BOOTTIME: 50.0}  # 40 s of them asleep
    monkeypatch.setattr(time, "clock_gettime", clocks.__getitem__)
    assert SystemClock().now() == 50.0
