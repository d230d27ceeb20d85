"""The watch over a path: a new obstacle stops the arm if it could be hit, and nothing else does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings, strategies as st
from numpy.typing import NDArray

from pomona.drivers.interfaces import Box, Frame, PathWatchSettings, Trajectory, Workspace
from pomona.drivers.path_motion import PathFollower
from pomona.drivers.trajectory import check_trajectory
from pomona.executive.values.arrays import Float64
from pomona.skills.motion.collision import Convex, RobotShape
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.timing import time_polyline
from pomona.skills.motion.watch import Ahead, Braking, PathWatch
from pomona.skills.motion.watch.kernel import see
from pomona.skills.motion.watch.path_watch import FRAME_INTERVAL, PACES, STEP, UNNOTICED
from pomona.skills.shared.live_watch import TOO_OLD
from pomona.tools.mock.arm import SIA5F_LIMITS
from tests.skills.overhead import LENS, T_BASE_CAMERA, frame
from tests.skills.picking_scene import HOME, OBSERVE, ROBOT_MODEL, WORKSPACE

SHAPE = RobotShape.of(ROBOT_MODEL)
FAR = OBSERVE + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
PATH = time_polyline(np.array([OBSERVE, FAR]), SIA5F_LIMITS)


def robot_at(q: Float64) -> list[tuple[float, float, float, float]]:
    """The robot itself, as the camera sees it."""
    return [(x, y, z, r) for x, y, z, r in SHAPE.spheres(q, 0.1)]


def on_the_way(share: float) -> Float64:
    """Where the TCP will be, (3,) [m]."""
    return ROBOT_MODEL.tcp(OBSERVE + share * (FAR - OBSERVE))[:3, 3]


def watch(workspace: Workspace = WORKSPACE, **known: object) -> PathWatch:
    return PathWatch(SHAPE, PATH, SIA5F_LIMITS, 0.1, workspace, **known)  # type: ignore[arg-type]


def test_nothing_new_is_reported_though_the_robot_moves_through_the_image() -> None:
    looking = watch()
    for t in np.linspace(0.0, PATH.duration, 12):
        q = np.array([np.interp(t, PATH.t, joint) for joint in PATH.q.T])
        assert looking.look(frame(t, *robot_at(q)), T_BASE_CAMERA, q, 0.0, float(t)) is None


def test_an_object_that_moves_in_within_reach_stops_the_arm_and_is_reported_with_its_place() -> (
    None
):
    looking = watch()
    assert looking.look(frame(0.0, *robot_at(OBSERVE)), T_BASE_CAMERA, OBSERVE, 0.0, 0.0) is None
    x, y, z = on_the_way(0.5)
    ball = (x, y, z + 0.05, 0.05)
    told = looking.look(frame(0.03, *robot_at(OBSERVE), ball), T_BASE_CAMERA, OBSERVE, 0.0, 0.3)
    assert told is not None
    assert told.stop
    assert told.moved
    assert np.linalg.norm(np.array(told.point) - ball[:3]) < 0.1


def test_goods_of_a_line_in_their_volume_stop_nothing_and_what_is_higher_does() -> None:
    x, y, z = on_the_way(0.5)
    T = np.eye(4)
    T[:3, 3] = x, y, z - 0.12
    passing = replace(
        WORKSPACE, watch=PathWatchSettings(passing=(Box("line", T, (0.2, 0.2, 0.1)),))
    )
    for height, stops in ((-0.08, False), (0.10, True)):
        looking = watch(passing)
        looking.look(frame(0.0, *robot_at(OBSERVE)), T_BASE_CAMERA, OBSERVE, 0.0, 0.0)
        ball = (x, y, z + height, 0.05)
        told = looking.look(frame(0.03, *robot_at(OBSERVE), ball), T_BASE_CAMERA, OBSERVE, 0.0, 0.3)
        assert (told is not None and told.stop) == stops


def test_a_fruit_that_the_hand_has_let_go_is_known_where_it_lies() -> None:
    ball = (*ROBOT_MODEL.tcp(OBSERVE)[:3, 3], 0.03)
    round_tcp = 0.03 * np.vstack((np.eye(3), -np.eye(3)))
    for shape, known in ((SHAPE.holding(round_tcp), True), (SHAPE, False)):
        lowering = PathWatch(shape, PATH, SIA5F_LIMITS, 0.1, WORKSPACE)
        rising = watch()
        rising.inherit(lowering, states=True)
        told = rising.look(frame(0.0, *robot_at(FAR), ball), T_BASE_CAMERA, FAR, 0.0, 0.0)
        assert (told is None) is known
        again = watch()
        again.inherit(rising, states=True)  # and in each later motion
        assert bool(again._known.sum() == rising._known.sum())


def test_a_pose_that_may_not_be_written_is_not_compiled_for_once_more() -> None:
    looking, fixed = watch(), T_BASE_CAMERA.copy()
    looking.look(frame(0.0, *robot_at(OBSERVE)), T_BASE_CAMERA, OBSERVE, 0.0, 0.0)
    compiled = len(see.signatures)
    fixed.flags.writeable = False
    looking.look(frame(0.03, *robot_at(OBSERVE)), fixed, OBSERVE, 0.0, 0.03)
    assert len(see.signatures) == compiled


def test_an_object_that_moves_in_far_away_stops_nothing() -> None:
    looking = watch()
    looking.look(frame(0.0, *robot_at(OBSERVE)), T_BASE_CAMERA, OBSERVE, 0.0, 0.0)
    far = (-0.55, -0.75, 0.0, 0.05)
    told = looking.look(
        frame(0.03, *robot_at(OBSERVE), far), T_BASE_CAMERA, OBSERVE, 0.0, PATH.duration - 0.02
    )
    assert told is None


def test_an_unknown_object_stops_the_arm_only_where_the_arm_would_reach_it() -> None:
    ball = (*on_the_way(0.9), 0.04)
    looking = watch()
    early = looking.look(frame(0.0, *robot_at(OBSERVE), ball), T_BASE_CAMERA, OBSERVE, 0.0, 0.0)
    assert early is not None
    assert not early.stop  # it is told, and braking can wait
    assert early.after > 0.2
    later = 0.6 * PATH.duration
    q = np.array([np.interp(later, PATH.t, joint) for joint in PATH.q.T])
    told = looking.look(frame(later, *robot_at(q), ball), T_BASE_CAMERA, q, 0.0, later)
    assert told is not None
    assert told.stop
    assert not told.moved


def test_objects_of_the_map_or_the_task_are_not_new() -> None:
    x, y, z = on_the_way(0.5)
    ball = (x, y, z, 0.03)
    empty = OccupancyMap.empty(WORKSPACE.lower, WORKSPACE.upper, 0.01)
    cells = np.indices(empty.states.shape).reshape(3, -1).T
    inside = np.linalg.norm(empty.origin + (cells + 0.5) * 0.01 - [x, y, z], axis=1) < 0.03
    empty.states[tuple(cells[inside].T)] = 2
    shape = np.array([x, y, z]) + 0.03 * np.array(
        [[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    )
    convex = Convex.of_points("fruit", shape)
    measured = replace(OccupancyMap.empty(WORKSPACE.lower, WORKSPACE.upper, 0.01), shapes=(convex,))
    for known in ({"map": empty}, {"map": measured}, {"known": [convex]}):
        looking = watch(**known)
        assert (
            looking.look(frame(0.0, *robot_at(OBSERVE), ball), T_BASE_CAMERA, OBSERVE, 0.0, 0.2)
            is None
        )
    assert (
        watch().look(frame(0.0, *robot_at(OBSERVE), ball), T_BASE_CAMERA, OBSERVE, 0.0, 0.2)
        is not None
    )


def test_a_held_fruit_is_the_robots_own() -> None:
    held = 0.04 * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    tcp = ROBOT_MODEL.tcp(OBSERVE)
    seen = frame(0.0, *robot_at(OBSERVE), (*tcp[:3, 3], 0.05))
    carrying = PathWatch(SHAPE.holding(held), PATH, SIA5F_LIMITS, 0.1, WORKSPACE)
    assert carrying.look(seen, T_BASE_CAMERA, OBSERVE, 0.0, 0.0) is None


def test_noise_of_depth_and_missing_pixels_are_no_news() -> None:
    rng = np.random.default_rng(4)
    looking = watch()
    for k in range(15):
        look = frame(k / 30.0, *robot_at(OBSERVE))
        assert look.depth is not None
        sigma = look.depth_model.deviation(look.depth, LENS.fx)
        noisy = (look.depth + sigma * rng.standard_normal(look.depth.shape)).astype(np.float32)
        noisy[rng.random(noisy.shape) < 0.05] = 0.0
        look = Frame(look.stamp, k, look.colour, noisy, LENS, None, T_BASE_CAMERA)
        assert looking.look(look, T_BASE_CAMERA, OBSERVE, 0.0, 0.0) is None


@pytest.mark.parametrize("goal", [FAR, HOME, OBSERVE + 0.6])
def test_the_arm_has_braked_within_the_time_that_is_allowed_for_it(goal: Float64) -> None:
    path = time_polyline(np.array([OBSERVE, goal]), SIA5F_LIMITS)
    braking = Braking(path, SIA5F_LIMITS)
    for share in np.linspace(0.0, 0.98, 25):
        follower = PathFollower(path, SIA5F_LIMITS, 0.002)
        while follower.path_time < share * path.duration:
            follower.step()
        told = braking.time(follower.path_time)
        took = 0.0
        while not follower.at_rest:
            follower.step(goes_on=False)
            took += 0.002
        assert abs(took - told) < 0.025, f"at {share:.2f} of the way"


@pytest.mark.parametrize(("mounted", "moved"), [(False, True), (True, False)])
def test_where_nothing_is_measured_a_fixed_camera_sees_an_empty_room_and_one_on_the_hand_perhaps_a_near_thing(
    mounted: bool, moved: bool
) -> None:
    x, y, z = on_the_way(0.5)
    blind = replace(frame(0.0), depth=np.zeros_like(frame(0.0).depth))
    ball = frame(0.03, (x, y, z + 0.05, 0.05))
    looking = watch()
    told = None
    for seen in (blind, ball):
        seen = replace(seen, q=OBSERVE if mounted else None)
        told = looking.look(seen, T_BASE_CAMERA, OBSERVE, 0.0, 0.3)
    assert told is not None
    assert told.moved is moved


def posture(path: Trajectory, t: float) -> Float64:
    """The joints at a time of a path, (dof,) [rad]."""
    return np.array([np.interp(t, path.t, joint) for joint in path.q.T])


def moving_parts(q: Float64) -> Float64:
    """The spheres of the robot's parts that can move, shape (n, 4) [m]."""
    return np.concatenate([SHAPE.spheres_of(g, q, 0.1) for g in np.flatnonzero(SHAPE.arrays.links)])


def gap(q: Float64, point: Float64) -> float:
    """Distance of the robot's parts that can move from a point [m]."""
    spheres = moving_parts(q)
    return float(np.min(np.linalg.norm(spheres[:, :3] - point, axis=1) - spheres[:, 3]))


def test_an_unmapped_ball_before_the_motion_is_found_standing() -> None:
    x, y, z = on_the_way(0.5)
    found = watch().standing(
        frame(0.0, *robot_at(OBSERVE), (x, y - 0.2, z, 0.05)), T_BASE_CAMERA, OBSERVE
    )
    assert len(found) > 3
    assert np.linalg.norm(found - (x, y - 0.2, z), axis=1).max() < 0.1


def test_without_an_unmapped_object_the_path_stays_as_it_is() -> None:
    looking = watch()
    assert (
        looking.slowed(
            looking.standing(frame(0.0, *robot_at(OBSERVE)), T_BASE_CAMERA, OBSERVE), 0.03
        )
        is None
    )


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    st.floats(0.6, 1.5), st.floats(0.0, 2.0 * np.pi), st.floats(0.0, 1.0), st.floats(0.0, TOO_OLD)
)
@example(away=0.82, angle=4.6, share=0.0, age=TOO_OLD)
def test_the_slower_path_is_the_same_within_its_limits_and_rests_before_an_object_that_sets_off_can_meet_the_arm(
    away: float, angle: float, share: float, age: float
) -> None:
    point, how = (
        on_the_way(share) + away * np.array([np.cos(angle), np.sin(angle), 0.0]),
        PathWatchSettings(),
    )
    enough = 0.52  # nearer to the path the slowest pace is too fast [m]
    assume(min(gap(posture(PATH, t), point) for t in np.linspace(0.0, PATH.duration, 20)) > enough)
    assume(gap(OBSERVE, point) > 0.31 + how.speed * age)  # nearer, the slowest start is too fast
    path = watch().slowed(point[None], age) or PATH
    check_trajectory(path, SIA5F_LIMITS)
    np.testing.assert_array_equal(path.q, PATH.q)
    assert path.duration >= PATH.duration
    braking = Braking(path, SIA5F_LIMITS)
    for begun in np.append(np.linspace(-age, 0.0, 5), np.linspace(0.0, path.duration, 15)):
        seen = max(begun + UNNOTICED / how.speed, 0.0) + FRAME_INTERVAL + how.delay
        until = min(seen + braking.time(min(seen, path.duration)), path.duration)
        for t in np.linspace(max(begun, 0.0), until, 8):
            assert gap(posture(path, t), point) > how.speed * (t - begun), (begun, t)


class IdealWatch(PathWatch):
    """A watch whose camera shows one moving point in three cells, `shown`, shape (3, 3) [m]."""

    shown = np.zeros((3, 3))

    def _new_cells(self, *_: object) -> tuple[Float64, NDArray[np.bool_]]:
        return self.shown, np.ones(3, np.bool_)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, 1.0), st.integers(0, 10**6))
def test_while_the_arm_goes_on_a_stop_after_the_next_frame_is_early_enough(
    share: float, seed: int
) -> None:
    how, looking = PathWatchSettings(), IdealWatch(SHAPE, PATH, SIA5F_LIMITS, 0.1, WORKSPACE)
    begun, rng = share * PATH.duration, np.random.default_rng(seed)
    braked = min(begun + FRAME_INTERVAL + how.delay, PATH.duration)
    times = np.linspace(
        begun, min(braked + Braking(PATH, SIA5F_LIMITS).time(braked), PATH.duration), 8
    )
    x, y, z, _ = rng.choice(moving_parts(posture(PATH, begun)))
    way = rng.normal(size=3)
    for away in np.arange(0.1, 1.5, 0.01):
        looking.shown = np.tile((x, y, z) + away * way / np.linalg.norm(way), (3, 1))
        told = looking.look(frame(begun), T_BASE_CAMERA, OBSERVE, 0.0, begun)
        if told is None or not told.stop:
            for t in times:
                assert gap(posture(PATH, t), looking.shown[0]) > how.speed * (t - begun), (away, t)
            break


def outside(share: float, away: float) -> Float64:
    """A point beside the path on the far side from the arm's base, shape (1, 3) [m]."""
    x, y, z = on_the_way(share)
    return np.array([[x, y, z]]) + away * np.array([x, y, 0.0]) / np.hypot(x, y)


def test_a_nearer_object_makes_the_arm_slower() -> None:
    took = [(watch().slowed(outside(0.5, away), 0.0) or PATH).duration for away in (0.35, 0.6, 1.5)]
    assert took[0] > took[1] > took[2] == PATH.duration


def test_the_pace_changes_along_the_path() -> None:
    path = watch().slowed(outside(1.0, 0.6), 0.0)
    assert path is not None
    rate = np.diff(PATH.t) / np.diff(path.t)
    assert rate.max() > 1.3 * rate.min()


def test_the_age_of_the_frame_makes_only_the_start_slower() -> None:
    point = outside(0.0, 1.1)
    assert watch().slowed(point, UNNOTICED / PathWatchSettings().speed) is None
    path = watch().slowed(point, TOO_OLD)
    assert path is not None
    rate = np.diff(PATH.t) / np.diff(path.t)
    assert rate[0] < 0.8 < 0.9 < rate[-1]


# --------------------------------------------------------------- which stretch of the path is judged, and how


def judged(
    monkeypatch: pytest.MonkeyPatch,
    moved: int,
    standing: int,
    age: float,
    at: float,
    near: int = 99,
) -> tuple[list[tuple[float, float, float, int]], object]:
    """Look once, with so many cells that moved and that stand; the `near`-th question finds something near.

    Return first and last time of each stretch [s], the distance that is allowed there [m] and its number of points.
    """
    looking, asked = watch(), []

    def nearest(points: Float64, first: int, last: int, allowed: float, now: float) -> object:
        assert now == at
        times = looking._times
        begins, ends = (times[first : first + 1], times[:last][-1:])  # as slices: they may be empty
        asked.append((*begins, *[np.inf][len(begins) :], *ends, allowed, len(points)))
        return (0.02, 0.3, (1.0, 2.0, 3.0), "hand") if len(asked) - 1 == near else None

    def new_cells(*_given: object) -> tuple[Float64, NDArray[np.bool_]]:
        return np.zeros((moved + standing, 3)), np.array([True] * moved + [False] * standing, bool)

    monkeypatch.setattr(looking, "_nearest", nearest)
    monkeypatch.setattr(looking, "_new_cells", new_cells)
    return asked, looking.look(frame(0.0), T_BASE_CAMERA, OBSERVE, age, at)


@pytest.mark.parametrize(("age", "at"), [(0.0, 0.31), (0.12, 0.31), (0.05, PATH.duration - 0.03)])
def test_moving_objects_are_judged_where_the_arm_can_be_until_it_rests(
    monkeypatch: pytest.MonkeyPatch, age: float, at: float
) -> None:
    asked, told = judged(monkeypatch, 3, 5, age, at)
    assert told is None
    waiting = FRAME_INTERVAL + 0.05  # until the next frame is looked at, and the arm brakes
    braking = Braking(PATH, SIA5F_LIMITS).time(min(at + waiting, PATH.duration))
    stopping = age + waiting + braking
    (begins, ends, allowed, points), (_, also, near, others), (after, last, far, rest) = asked
    assert begins <= at < begins + 0.02 + 1e-9
    until = min(at + stopping, PATH.duration)
    assert until <= ends + 1e-9
    assert ends < until + 0.02 + 1e-9
    assert allowed == pytest.approx(0.03 + 1.6 * stopping)
    assert (also, near, far) == (ends, 0.03, 0.03)
    assert (points, others, rest) == (3, 5, 8)
    rest_of_path = [t for t in (*np.arange(0.0, PATH.duration, 0.02), PATH.duration) if t > ends]
    assert after == pytest.approx(min(rest_of_path, default=np.inf))
    assert last == PATH.duration


def test_two_cells_that_moved_are_noise_and_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, _ = judged(monkeypatch, 2, 5, 0.0, 0.3)
    assert [points for *_, points in asked] == [0, 7, 7]


@pytest.mark.parametrize(
    ("near", "stop", "moved"), [(0, True, True), (1, True, False), (2, False, False)]
)
def test_the_most_urgent_object_is_told(
    monkeypatch: pytest.MonkeyPatch, near: int, stop: bool, moved: bool
) -> None:
    asked, told = judged(monkeypatch, 3, 5, 0.0, 0.3, near)
    assert len(asked) == near + 1
    assert told == Ahead(stop, moved, 0.02, 0.3, (1.0, 2.0, 3.0), "hand")


@pytest.mark.parametrize("age", [0.0, 0.2])
@pytest.mark.parametrize("begun", [False, True])
def test_the_pace_lets_the_arm_rest_before_an_object_that_sets_off_can_be_there(
    monkeypatch: pytest.MonkeyPatch, age: float, begun: bool
) -> None:
    looking, asked = watch(), []
    waiting = FRAME_INTERVAL + 0.05
    at = waiting + STEP + (1e-6 if begun else -1e-3)

    def nearest(points: Float64, first: int, last: int, allowed: float, now: float) -> object:
        asked.append((looking._times[first], looking._times[last - 1], allowed))
        return "near" if len(asked) < 3 else None

    monkeypatch.setattr(looking, "_nearest", nearest)
    assert looking._pace(np.zeros((1, 3)), at, age) == PACES[2]
    way = UNNOTICED if begun else max(UNNOTICED, 1.6 * age)
    for pace, (begins, ends, allowed) in zip(PACES, asked, strict=False):
        stopping = waiting + Braking(PATH, SIA5F_LIMITS).time(at, pace)
        assert allowed == pytest.approx(0.03 + way + 1.6 * stopping)
        assert begins <= at < begins + 0.02 + 1e-9
        assert at + pace * stopping <= ends + 1e-9
        assert ends < at + pace * stopping + 0.02 + 1e-9
    asked.clear()
    monkeypatch.setattr(looking, "_nearest", lambda *_: asked.append(1) or "near")
    assert looking._pace(np.zeros((1, 3)), at, age) == PACES[-1]
    assert len(asked) == len(PACES)


def test_the_nearest_posture_of_a_stretch_is_told_with_its_time_place_and_part() -> None:
    looking = watch()
    point = on_the_way(0.5) + np.array([0.0, 0.0, 0.2])
    points = np.array([[3.0, 3.0, 3.0], point])
    first, last = 22, 26
    gaps = [gap(q, point) for q in looking._Q[first:last]]
    m = int(np.argmin(gaps))
    told = looking._nearest(points, first, last, 1.0, 0.25)
    assert told is not None
    distance, after, place, part = told
    assert distance == pytest.approx(gaps[m], abs=1e-6)
    assert after == pytest.approx(looking._times[first + m] - 0.25)
    assert place == pytest.approx(point, abs=5e-4)
    assert part in SHAPE.geom_bodies
    assert looking._nearest(points, first, last, gaps[m] - 1e-3, 0.25) is None
    assert looking._nearest(points, first, last, 1.0, 99.0)[1] == 0.0  # type: ignore[index]
    assert looking._nearest(points[:0], first, last, 1.0, 0.0) is None
    assert looking._nearest(points, 5, 5, 1.0, 0.0) is None
