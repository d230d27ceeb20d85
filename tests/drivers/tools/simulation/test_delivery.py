"""Frames arrive some time after their exposure, in order, and the first one after a silence at once."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.interfaces import Frame, Intrinsics
from pomona.executive.clock import ManualClock
from pomona.tools.simulation.camera import Delivery


def exposed(clock: ManualClock) -> Frame:
    """The frame of this moment of a camera with 30 frames a second."""
    colour = np.zeros((2, 2, 3), np.uint8)
    return Frame(
        clock.now(), int(clock.now() * 30 + 1e-6), colour, None, Intrinsics(1.0, 1.0, 0.5, 0.5, 2, 2), None, np.eye(4)
    )


def ages(latency: tuple[float, float], count: int = 100) -> tuple[list[float], list[int]]:
    clock = ManualClock()
    delivery, newest, found, numbers = Delivery(clock, latency, 3), None, [], []
    for _ in range(count):
        now = exposed(clock)
        newest = now if newest is None or now.sequence != newest.sequence else newest
        frame = delivery.newest(newest)
        assert frame is not None
        found.append(clock.now() - frame.stamp)
        numbers.append(frame.sequence)
        clock.advance(0.01)
    return found, numbers


def test_without_a_latency_the_frame_of_this_moment_is_delivered() -> None:
    found, _ = ages((0.0, 0.0))
    assert max(found) < 1.0 / 30.0 + 0.011


def test_with_a_latency_frames_are_as_old_as_it_and_a_period_more_at_most() -> None:
    found, _ = ages((0.05, 0.05))
    assert found[0] == 0.0
    assert min(found[12:]) >= 0.05 - 1e-9
    assert max(found[12:]) < 0.05 + 1.0 / 30.0 + 0.021


def test_with_a_latency_that_varies_no_frame_overtakes_another() -> None:
    _, numbers = ages((0.03, 0.09), 300)
    assert (np.diff(numbers) >= 0).all()
    assert len(set(numbers)) > 60


def test_after_a_silence_the_first_frame_is_new() -> None:
    clock = ManualClock()
    delivery = Delivery(clock, (0.05, 0.05), 3)
    for _ in range(20):
        delivery.newest(exposed(clock))
        clock.advance(0.02)
    clock.advance(2.0)
    frame = delivery.newest(exposed(clock))
    assert frame is not None
    assert frame.stamp == pytest.approx(clock.now())
    assert delivery.newest(None) is None
