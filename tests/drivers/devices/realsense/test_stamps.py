"""When a frame was taken, on the cell's clock."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.devices.realsense.source import Pair
from pomona.devices.realsense.stamps import LATENCY, STARTING, Stamps
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.clock import ManualClock

IMAGES = (
    np.zeros((2, 2, 3), np.uint8),
    np.ones((2, 2), np.float32),
    Intrinsics(1.0, 1.0, 0.5, 0.5, 2, 2),
)


def pair(taken: float | None, on_host_clock: bool = False) -> Pair:
    return Pair(*IMAGES, taken, on_host_clock, 1)


def test_the_hosts_clock_gives_the_age_of_a_frame() -> None:
    stamps = Stamps(ManualClock(50.0), lambda: 1000.0)
    assert stamps.stamp(pair(999.75, True)) == 49.75
    assert stamps.stamp(pair(970.0, True)) == 20.0
    assert stamps.stamp(pair(1003.0, True)) == 53.0


def test_a_recording_is_as_new_as_the_look_at_it() -> None:
    assert Stamps(ManualClock(50.0)).stamp(pair(None)) == 50.0 - LATENCY


def test_a_counter_that_drifts_is_followed_for_hours() -> None:
    clock, drift, rng = ManualClock(50.0), 1.00005, np.random.default_rng(1)
    stamps = Stamps(clock)
    for _ in range(20_000):
        clock.advance(0.5)
        exposed = (
            clock.now() - LATENCY - rng.exponential(0.005)
        )  # the transport adds to the latency
        stamp = stamps.stamp(pair(7.0 + drift * exposed))
        assert stamp == pytest.approx(exposed, abs=0.05) or clock.now() < 60.0
        assert stamp <= clock.now()


def test_frames_that_begin_to_come_late_are_as_old_as_they_are() -> None:
    clock = ManualClock(50.0)
    stamps = Stamps(clock)
    for late in (STARTING - 0.1, 0.1, 0.0, 0.0):
        clock.advance(0.1)
        stamps.stamp(pair(clock.now() - late))
    clock.advance(0.1)
    assert stamps.stamp(pair(clock.now() - 30.0)) == pytest.approx(
        clock.now() - LATENCY - 30.0, abs=1e-3
    )


def test_a_counter_that_jumps_ahead_is_not_followed_until_the_camera_is_opened_anew() -> None:
    clock = ManualClock(50.0)
    stamps = Stamps(clock)
    stamps.stamp(pair(clock.now()))
    for _ in range(100):
        clock.advance(0.1)
        assert stamps.stamp(pair(clock.now() + 10.0)) > clock.now() + 9.0
    stamps.restart()
    assert stamps.stamp(pair(clock.now() + 10.0)) == pytest.approx(clock.now() - LATENCY)
