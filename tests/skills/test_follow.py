from dataclasses import replace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.executive.skill_testing import drive
from pomona.skills.follow import Follow
from pomona.skills.motion.planning.timing import time_polyline
from tests.skills.overhead import comes_near, frame, watched
from tests.skills.picking_scene import HOME, OBSERVE, PickingScene


def path(scene: PickingScene):
    return time_polyline(np.array([OBSERVE, HOME]), scene.arm.limits)


def test_the_arm_follows_the_path_to_its_end():
    scene = PickingScene()
    outcome = drive(Follow(), {"path": path(scene)}, scene.devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS
    np.testing.assert_allclose(scene.arm.q, HOME, atol=1e-6)


def test_a_path_beyond_a_limit_is_refused_before_anything_moves():
    scene = PickingScene()
    good = path(scene)
    bad = replace(good, t=good.t / 3.0, qd=good.qd * 3.0, qdd=good.qdd * 9.0)
    outcome = drive(Follow(), {"path": bad}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "BAD_PATH"
    assert scene.arm.followed == []


def test_a_path_that_starts_elsewhere_is_refused_with_the_distance():
    scene = PickingScene(q=OBSERVE + 0.1 * np.eye(7)[1])
    outcome = drive(Follow(), {"path": path(scene)}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NOT_AT_START"
    assert outcome.reason.data["joint"] == 2
    assert scene.arm.followed == []


def test_a_refusal_and_a_failure_of_the_arm_are_reasons():
    scene = PickingScene()
    scene.arm.refuse_next("servo off")
    outcome = drive(Follow(), {"path": path(scene)}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "REFUSED"
    assert "servo off" in outcome.reason.message
    scene.arm.fail_at(0.5, "following error at joint 3")
    outcome = drive(Follow(), {"path": path(scene)}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "MOTION_FAILED"
    assert "following error" in outcome.reason.message


def test_a_stop_by_another_client_is_reported():
    scene = PickingScene()

    def stop_at(tick: int) -> None:
        if tick == 10:
            scene.arm.safe_stop("somebody pressed stop")

    outcome = drive(
        Follow(), {"path": path(scene)}, scene.devices, clock=scene.clock, each_tick=stop_at
    )
    assert outcome.reason.code == "STOPPED"


def test_interrupted_it_stops_on_the_path_and_stays_there():
    scene = PickingScene()
    planned = path(scene)
    outcome = drive(
        Follow(), {"path": planned}, scene.devices, clock=scene.clock, interrupt_after=9
    )
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    stopped = scene.arm.q.copy()
    assert 0.05 < np.abs(stopped - OBSERVE).max() < np.abs(HOME - OBSERVE).max() - 0.05
    assert min(np.abs(stopped - q).max() for q in planned.q) < 0.01
    scene.clock.advance(0.5)
    np.testing.assert_array_equal(scene.arm.q, stopped)


def test_an_approaching_object_in_view_stops_the_arm_on_its_path_and_is_reported():
    scene = PickingScene()
    devices, camera = watched(scene)
    planned = path(scene)
    outcome = drive(
        Follow(), {"path": planned}, devices, clock=scene.clock, each_tick=comes_near(scene, camera)
    )
    assert outcome.reason.code == "PATH_BLOCKED"
    assert outcome.reason.data["moved"]
    assert np.linalg.norm(np.array(outcome.reason.data["point_m"]) - camera.balls[0][:3]) < 0.1
    assert outcome.published[-1][0] == "blocked"
    assert scene.arm.settled()
    assert np.abs(scene.arm.q - HOME).max() > 0.1
    assert min(np.abs(scene.arm.q - q).max() for q in planned.q) < 0.01


@pytest.mark.parametrize("code", ["POSE_MISMATCH", "DEPTH_MISMATCH"])
def test_a_camera_that_shows_the_table_elsewhere_starts_no_motion(code):
    scene = PickingScene()
    devices, camera = watched(scene)
    camera.untrue = code
    outcome = drive(Follow(), {"path": path(scene)}, devices, clock=scene.clock)
    assert outcome.reason.code == code
    assert outcome.reason.data["tilt_rad"] > 0.08
    assert "above: " in outcome.reason.message
    assert scene.arm.followed == []


def test_where_nothing_is_new_a_watched_path_takes_no_longer():
    ends = []
    for looked_at in (False, True):
        scene = PickingScene()
        devices = watched(scene)[0] if looked_at else scene.devices
        outcome = drive(Follow(), {"path": path(scene)}, devices, clock=scene.clock)
        assert outcome.status is Status.SUCCESS
        ends.append(outcome.duration)
    assert ends[0] == ends[1]


def test_frames_that_are_old_or_repeated_are_not_looked_at():
    scene = PickingScene()
    devices, camera = watched(scene)
    old = frame(-1.0, (*scene.tcp[:3, 3], 0.2))
    camera.latest_depth = lambda: old
    assert (
        drive(Follow(), {"path": path(scene)}, devices, clock=scene.clock).status is Status.SUCCESS
    )


@pytest.mark.slow
def test_beside_an_unmapped_object_the_arm_starts_slower_the_older_the_frame_is():
    durations = []
    for age in (0.0, 0.25):
        scene = PickingScene()
        devices, camera = watched(scene)
        x, y, z = scene.tcp[:3, 3]
        camera.latest_depth = lambda scene=scene, age=age, ball=(x + 0.6, y, z, 0.04): frame(
            scene.clock.now() - age, ball
        )
        drive(Follow(), {"path": path(scene)}, devices, clock=scene.clock)
        durations.append(scene.arm.followed[0].duration)
    assert durations[1] > 1.1 * durations[0] > 1.1 * path(PickingScene()).duration
