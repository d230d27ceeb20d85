"""Effect of the fingers' own motion on the grip force."""

from __future__ import annotations

import pytest

from pomona.skills.grip.force_loop import ForceLoopSettings, PadStiffness
from pomona.skills.grip.settings import TrackingSettings
from pomona.skills.grip.tracking import ForceTracker

PERIOD = 0.002


def test_fingers_that_close_are_expected_to_press_more_once_they_have_got_going() -> None:
    tracker = ForceTracker(ForceLoopSettings(stiffness=PadStiffness(linear=1500.0)))
    expected = [tracker.expected(-0.01, 3.0, PERIOD) for _ in range(100)]
    assert expected[0] < 0.2 * expected[-1]
    assert expected == sorted(expected)
    assert expected[-1] == pytest.approx(0.01 * 1500.0 * PERIOD, rel=1e-3)


def test_fast_motion_is_not_relied_upon() -> None:
    tracker = ForceTracker(ForceLoopSettings())
    for _ in range(100):
        expected = tracker.expected(-0.2, 3.0, PERIOD)
    assert expected == pytest.approx(TrackingSettings().foreseen * 2000.0 * PERIOD)


def test_pads_that_stiffen_press_more_for_the_same_way() -> None:
    tracker = ForceTracker(ForceLoopSettings(stiffness=PadStiffness(quadratic=1e6)))
    for _ in range(100):
        soft, hard = tracker.expected(0.005, 1.0, PERIOD), tracker.expected(0.005, 4.0, PERIOD)
    assert hard == pytest.approx(2.0 * soft)
    assert soft < 0.0
