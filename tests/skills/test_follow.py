from dataclasses import replace

import numpy as np
from py_trees.common import Status

from executive.skill_testing import drive
from skills.follow import Follow
from skills.motion.planning.timing import time_polyline
from tests.skills.picking_scene import HOME, OBSERVE, Bench


def path(bench: Bench):
    return time_polyline(np.array([OBSERVE, HOME]), bench.arm.limits)


def test_the_arm_follows_the_path_to_its_end():
    bench = Bench()
    outcome = drive(Follow(), {"path": path(bench)}, bench.devices, clock=bench.clock)
    assert outcome.status is Status.SUCCESS
    np.testing.assert_allclose(bench.arm.q, HOME, atol=1e-6)


def test_a_path_beyond_a_limit_is_refused_before_anything_moves():
    bench = Bench()
    good = path(bench)
    bad = replace(good, t=good.t / 3.0, qd=good.qd * 3.0, qdd=good.qdd * 9.0)
    outcome = drive(Follow(), {"path": bad}, bench.devices, clock=bench.clock)
    assert outcome.reason.code == "BAD_PATH"
    assert bench.arm.followed == []


def test_a_path_that_starts_elsewhere_is_refused_with_the_distance():
    bench = Bench(q=OBSERVE + 0.1 * np.eye(7)[1])
    outcome = drive(Follow(), {"path": path(bench)}, bench.devices, clock=bench.clock)
    assert outcome.reason.code == "NOT_AT_START"
    assert outcome.reason.data["joint"] == 2
    assert bench.arm.followed == []


def test_a_refusal_and_a_failure_of_the_arm_are_reasons():
    bench = Bench()
    bench.arm.refuse_next("servo off")
    outcome = drive(Follow(), {"path": path(bench)}, bench.devices, clock=bench.clock)
    assert outcome.reason.code == "REFUSED"
    assert "servo off" in outcome.reason.message
    bench.arm.fail_at(0.5, "following error at joint 3")
    outcome = drive(Follow(), {"path": path(bench)}, bench.devices, clock=bench.clock)
    assert outcome.reason.code == "MOTION_FAILED"
    assert "following error" in outcome.reason.message


def test_a_stop_by_somebody_else_is_told():
    bench = Bench()

    def stop_at(tick: int) -> None:
        if tick == 10:
            bench.arm.safe_stop("somebody pressed stop")

    outcome = drive(Follow(), {"path": path(bench)}, bench.devices, clock=bench.clock, each_tick=stop_at)
    assert outcome.reason.code == "STOPPED"


def test_interrupted_it_stops_on_the_path_and_stays_there():
    bench = Bench()
    planned = path(bench)
    outcome = drive(Follow(), {"path": planned}, bench.devices, clock=bench.clock, interrupt_after=9)
    assert outcome.status is Status.INVALID
    assert bench.arm.settled()
    stopped = bench.arm.q.copy()
    assert 0.05 < np.abs(stopped - OBSERVE).max() < np.abs(HOME - OBSERVE).max() - 0.05
    assert min(np.abs(stopped - q).max() for q in planned.q) < 0.01
    bench.clock.advance(0.5)
    np.testing.assert_array_equal(bench.arm.q, stopped)
