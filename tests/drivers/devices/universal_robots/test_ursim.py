"""The driver against Universal Robots' own simulator at POMONA_URSIM: see docs/hardware.md#first-day."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.universal_robots import outside
from pomona.drivers import Motion, MotionState
from pomona.executive import SystemClock
from tests.drivers.devices.motoman.test_driver import swing
from tests.drivers.devices.universal_robots.test_connect import ROBOT, open_arm

HOST = os.environ.get("POMONA_URSIM", "")
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not HOST, reason="POMONA_URSIM has no address of a URSim"),
]
CHANGE = np.array([0.3, -0.2, 0.2, 0.1, -0.1, 0.3])


def wait(motion: Motion, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not motion.settled and time.monotonic() < end:
        SystemClock().advance(0.005)


def test_a_path_is_followed_stopped_and_begun_anew_and_the_script_is_ended_from_outside(
    tmp_path: Path,
) -> None:
    arm = open_arm(
        tmp_path, f"address: {HOST}\nmodel: ur5e\nrobot: {ROBOT}\nsilence: 200 ms\nlead: 300 ms"
    )
    try:
        start = arm.state().q
        there = arm.follow(swing(start, CHANGE))
        wait(there, 10.0)
        assert (there.state, there.problem) == (MotionState.DONE, "")
        np.testing.assert_allclose(arm.state().q, start + CHANGE, atol=2e-3)
        back = arm.follow(swing(arm.state().q, -CHANGE))
        SystemClock().advance(0.6)
        back.stop()
        wait(back, 3.0)
        assert back.state is MotionState.STOPPED
        assert arm.outside_stop is not None
        outside.stop(*arm.outside_stop[1])
        SystemClock().advance(0.5)
        assert "program" in arm.link()
        q = arm.state().q
        SystemClock().advance(1.0)
        np.testing.assert_allclose(arm.state().q, q, atol=1e-4)  # nothing resumes by itself
        arm.acknowledge()
        SystemClock().advance(3.0)
        arm.check()
        home = arm.follow(swing(arm.state().q, start - arm.state().q))
        wait(home, 10.0)
        assert home.state is MotionState.DONE
    finally:
        arm.close()
