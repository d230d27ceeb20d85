"""Named poses, gentle paths, planning with a deadline, poses of a camera that are one, and straight lines."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pomona.drivers.interfaces import Arm, Trajectory, Workspace
from pomona.skills.geometry import rot_z, transform
from pomona.skills.motion.planning.space import PlanningFailed
from pomona.skills.shared import planning, straight_travel
from pomona.skills.shared.frame_trust import KEPT, earlier_poses, note_pose
from pomona.skills.shared.moving import PoseSkill, gently, named_pose
from pomona.skills.shared.planning import COLD_START, SIMULATED_PATIENCE, patience, planned
from pomona.skills.shared.straight_travel import Manner, follow_way, free_line, vertical_way
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL, PickingScene


class Told(Exception):
    """Stands for a skill's failure."""


def failure(code: str, message: str, **data: object) -> Told:
    return Told(code, message, data)


POSES = {"a": np.array([1.0]), "a_2": np.array([2.0]), "a_3": np.array([3.0]), "a_5": np.zeros(1)}


@pytest.mark.parametrize(
    ("number", "found"), [(1, 1.0), (2, 2.0), (3, 3.0), (4, 1.0), (5, 2.0), (0, 3.0)]
)
def test_variations_of_a_pose_come_one_after_the_other_and_over_again(
    number: int, found: float
) -> None:
    assert named_pose(POSES, "a", number) == found
    assert named_pose(POSES, "a_5", number) == 0.0
    with pytest.raises(KeyError):
        named_pose(POSES, "b", number)
    assert named_pose(POSES, "a") == 1.0


def test_a_pose_of_the_cell_is_offered_and_another_one_is_a_problem_with_a_choice() -> None:
    workspace = SimpleNamespace(poses={"up": OBSERVE, "down": OBSERVE})
    cell: Any = SimpleNamespace(
        name="bench", known=lambda kind: workspace if kind is Workspace else None
    )
    assert PoseSkill.offers("pose", cell) == ("down", "up")
    assert PoseSkill.offers("speed", cell) == PoseSkill.offers("pose", None) == ()
    assert list(PoseSkill.judge({"pose": "up"}, cell)) == []
    assert list(PoseSkill.judge({}, cell)) == list(PoseSkill.judge({"pose": "out"}, None)) == []
    (problem,) = PoseSkill.judge({"pose": "dwn"}, cell)
    assert (problem.key, problem.message) == ("pose", "the cell 'bench' has no pose 'dwn'")
    assert "down" in problem.hint


def test_a_gentle_path_is_slowed_as_much_as_its_largest_acceleration_needs() -> None:
    t = np.linspace(0.0, 1.0, 201)
    s = (t**3 * (10 - 15 * t + 6 * t**2))[:, None]
    change = np.array([0.3, 0.2, 0.0, -0.3, 0.0, 0.0, 0.0])
    path = Trajectory(t, OBSERVE + s * change, np.zeros((201, 7)), np.zeros((201, 7)))

    def largest(path: Trajectory) -> float:
        p = np.array([ROBOT_MODEL.tcp(q)[:3, 3] for q in path.q])
        dt = path.t[1] - path.t[0]
        return float(np.linalg.norm(np.diff(p, 2, axis=0) / dt**2, axis=1).max())

    before = largest(path)
    for most in (0.5 * before, 0.1 * before):
        slow = gently(ROBOT_MODEL, path, most)
        assert largest(slow) == pytest.approx(most, rel=0.02)
        assert slow.duration == pytest.approx(np.sqrt(before / most), rel=0.01)
    assert gently(ROBOT_MODEL, path, 1.1 * before).duration == path.duration


def planner(simulated: bool, answers: list[Any]) -> tuple[Any, list[str]]:
    """A skill whose planning yields once for each second that passes, then gives the last answer."""
    did: list[str] = []
    now = [100.0]

    def work() -> Any:
        try:
            for _ in range(len(answers) - 1):
                now[0] += 1.0
                yield "planning"
            if isinstance(answers[-1], Exception):
                raise answers[-1]
            return answers[-1]
        except GeneratorExit:
            did.append("killed")
            raise

    def compute(function: Any, request: Any, isolated: bool) -> Any:
        did.append(f"{function.__name__} {isolated}")
        return work()

    return SimpleNamespace(
        clock=SimpleNamespace(simulated=simulated), context=SimpleNamespace(elapsed=lambda: now[0]),
        compute=compute, failure=failure,
    ), did  # fmt: skip


REQUEST: Any = SimpleNamespace(patience=2.0, planner="RRT", q_goals=np.zeros((3, 7)), budget=0.5)


def carried_out(work: Any) -> Any:
    ticks = 0
    while True:
        try:
            next(work)
            ticks += 1
        except StopIteration as done:
            return done.value, ticks


@pytest.mark.parametrize("simulated", [False, True])
def test_a_plan_within_its_patience_and_a_cold_start_is_returned(simulated: bool) -> None:
    skill, did = planner(simulated, [None] * 7 + ["the path"])
    assert carried_out(planned(skill, REQUEST)) == ("the path", 7)
    assert did == ["plan True"]


def test_a_plan_that_takes_longer_is_given_up_on_a_real_clock_alone() -> None:
    seconds = int(REQUEST.patience + COLD_START) + 1
    skill, did = planner(False, [None] * (seconds + 1))
    with pytest.raises(Told) as told:
        carried_out(planned(skill, REQUEST))
    code, words, data = told.value.args
    assert (code, words) == ("TIMEOUT", "planning took longer than 7.0 s")
    assert data == {"planner": "RRT", "goals": 3, "budget_s": 0.5}
    assert did == ["plan True", "killed"]
    skill, did = planner(True, [*[None] * 300, "late"])
    assert carried_out(planned(skill, REQUEST)) == ("late", 300)


def test_a_planner_that_fails_is_the_skills_failure() -> None:
    skill, _ = planner(
        False, [None, PlanningFailed("NO_PATH", "all ways are closed", {"goals": 2})]
    )
    with pytest.raises(Told) as told:
        carried_out(planned(skill, REQUEST))
    assert told.value.args == ("NO_PATH", "all ways are closed", {"goals": 2})


def test_planning_is_patient_for_the_budget_and_on_a_simulated_clock_for_a_minute() -> None:
    assert patience(planner(False, [None])[0], 0.7) == 0.7
    assert patience(planner(True, [None])[0], 0.7) == SIMULATED_PATIENCE == 60.0


def test_a_map_is_usable_until_it_is_too_old() -> None:
    asked: list[tuple[float, float]] = []

    def field(now: float, age: float) -> str:
        asked.append((now, age))
        if now > 50.0:
            raise planning.OccupancyError("it is old")
        return "field"

    now = [20.0]
    skill: Any = SimpleNamespace(clock=SimpleNamespace(now=lambda: now[0]), failure=failure)
    known: Any = SimpleNamespace(usable_field=field, stamp=12.3456)
    assert planning.usable_field(skill, None) is None
    assert planning.usable_field(skill, known) == "field"
    assert asked == [(20.0, 120.0)]
    now[0] = 60.0
    for stamp, age in ((12.3456, 47.654), (None, None)):
        known.stamp = stamp
        with pytest.raises(Told) as told:
            planning.usable_field(skill, known)
        data = {"age_s": age, "allowed_s": 120.0}
        assert told.value.args == ("MAP_STALE", "it is old: look again", data)


def test_poses_of_a_camera_are_remembered_when_they_differ_and_only_the_latest() -> None:
    skill: Any = SimpleNamespace(context=type("Context", (), {})())
    pose = np.eye(4)

    def note(stamp: float, T: Any, label: str = "wrist") -> list[float]:
        frame: Any = SimpleNamespace(stamp=stamp, label=label)
        note_pose(skill, frame, T)
        return [stamp for stamp, _T in earlier_poses(skill, frame)]

    assert note(1.0, pose) == [1.0]
    assert note(2.0, transform(None, [4.9e-3, 0.0, 0.0])) == [1.0]
    assert note(3.0, transform(rot_z(np.radians(0.49)))) == [1.0]
    assert note(4.0, transform(None, [0.0, 5.1e-3, 0.0])) == [1.0, 4.0]
    assert note(5.0, transform(rot_z(np.radians(0.51)), [0.0, 5.1e-3, 0.0])) == [1.0, 4.0, 5.0]
    assert note(5.5, pose) == [1.0, 4.0, 5.0, 5.5]  # where it was before the last
    assert note(6.0, pose, "above") == [6.0]
    for k in range(20):
        kept = note(10.0 + k, transform(None, [0.1 * k, 0.0, 0.0]))
    assert kept == [10.0 + k for k in range(20 - KEPT, 20)]
    other: Any = SimpleNamespace(context=type("Context", (), {})())
    assert len(earlier_poses(other, SimpleNamespace(label="wrist"))) == 0  # type: ignore[arg-type]


# --------------------------------------------------------------------------------------------- straight lines


def standing(paths: list[Any] | None = None) -> Any:
    scene = PickingScene()

    def travel(path: Any, watch: Any, carrying: Any, started: Any) -> Any:
        assert paths is not None
        paths.append((path, watch, carrying, started))
        yield "moving"

    return SimpleNamespace(
        device={Arm: scene.arm}.__getitem__, failure=failure, travel=travel, scene=scene
    )


class Space:
    """Is free as far as a number of postures."""

    def __init__(self, blocked: int | None = None) -> None:
        self.blocked = blocked

    def first_blocked(self, _path: Any) -> int | None:
        return self.blocked

    def explain(self, q: Any) -> tuple[str, dict[str, object]]:
        self.explained = q
        return "the forearm touches the shelf", {"part": "forearm"}


@pytest.mark.parametrize("rise", [0.03, -0.03])
def test_a_vertical_way_leads_straight_up_or_down(rise: float) -> None:
    skill = standing()
    way = vertical_way(skill, rise, "NO_WAY")
    first, last = ROBOT_MODEL.tcp(way[0]), ROBOT_MODEL.tcp(way[-1])
    np.testing.assert_allclose(first, skill.scene.tcp, atol=1e-9)
    np.testing.assert_allclose(last[:3, 3] - first[:3, 3], [0.0, 0.0, rise], atol=1e-6)
    np.testing.assert_allclose(last[:3, :3], first[:3, :3], atol=1e-6)
    assert len(vertical_way(skill, rise, "NO_WAY", Space())) == len(way)  # type: ignore[arg-type]


def test_a_vertical_way_ends_before_an_obstacle_and_needs_four_postures() -> None:
    skill = standing()
    whole = vertical_way(skill, 0.03, "NO_WAY")
    short = vertical_way(skill, 0.03, "NO_WAY", Space(3))  # type: ignore[arg-type]
    np.testing.assert_array_equal(short, whole[:4])
    space: Any = Space(2)
    with pytest.raises(Told) as told:
        vertical_way(skill, 0.03, "NO_WAY", space)
    words = "the gripper cannot move vertically: the forearm touches the shelf"
    assert told.value.args == ("NO_WAY", words, {})
    np.testing.assert_array_equal(space.explained, whole[3])


def test_a_line_that_is_blocked_or_out_of_reach_is_named_with_its_length() -> None:
    skill = standing()
    goal = skill.scene.tcp.copy()
    goal[2, 3] += 0.05
    line = free_line(skill, goal, Space(), ("REACH", "BLOCKED"), "on the way up")  # type: ignore[arg-type]
    np.testing.assert_allclose(ROBOT_MODEL.tcp(line.q[-1]), goal, atol=1e-6)
    space: Any = Space(4)
    with pytest.raises(Told) as told:
        free_line(skill, goal, space, ("REACH", "BLOCKED"), "on the way up", fruit=3)
    words, data = "on the way up the forearm touches the shelf", {"fruit": 3, "part": "forearm"}
    assert told.value.args == ("BLOCKED", words, data)
    np.testing.assert_array_equal(space.explained, line.q[5])
    goal[2, 3] += 3.0
    with pytest.raises(Told) as told:
        free_line(skill, goal, space, ("REACH", "BLOCKED"), "on the way up", fruit=3)
    code, words, data = told.value.args
    assert code == "REACH"
    assert words.endswith(f" after {1e3 * data['reached_m']:.0f} of 3050 mm")
    assert 0.05 < data["reached_m"] < 1.0
    assert data["fruit"] == 3


def test_a_way_is_followed_within_the_tools_limits() -> None:
    paths: list[Any] = []
    skill = standing(paths)
    way = vertical_way(skill, 0.05, "NO_WAY")
    list(follow_way(skill, way, Manner(0.1, 1.0, 10.0), "watch", "held", "started"))  # type: ignore[arg-type]
    ((path, *others),) = paths
    assert others == ["watch", "held", "started"]
    np.testing.assert_allclose(path.q[[0, -1]], way[[0, -1]])
    assert path.t[-1] == pytest.approx(0.05 / 0.1 + 0.1 / 1.0 + 1.0 / 10.0, rel=0.01)
    assert list(follow_way(skill, way[:1].repeat(4, axis=0), Manner(0.1, 1.0, 10.0))) == []
    assert len(paths) == 1


def test_the_tools_pose_is_that_of_the_arm_now() -> None:
    skill = standing()
    skill.scene.arm.q[0] += 0.3
    expected = ROBOT_MODEL.tcp(OBSERVE + 0.3 * np.eye(7)[0])
    np.testing.assert_allclose(straight_travel.tool_pose(skill), expected)
