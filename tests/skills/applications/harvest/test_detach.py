"""The skill Detach on mock devices: success, every failure code, interruption, and the watchdog of its set-points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.harvest.detach import Detach, held_fruit
from pomona.applications.harvest.detaching import BRUISE_FORCE, DetachSettings
from pomona.applications.harvest.hanging import free_roll
from pomona.applications.harvest.roll_choice import neighbours_of, roll_clearance
from pomona.drivers.errors import DeviceFault
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, StreamedArm, Workspace
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills import TAKEN
from pomona.skills.geometry import transform
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.robot import RobotModel, inverse_kinematics, nearest_solution
from pomona.skills.perception.detection.detection import AllDetections, Detection
from pomona.tools.mock import MockArm, MockClock, MockForceSensor, MockGripper
from pomona.tools.mock.arm import ROBOT
from pomona.tools.mock.hand import PERIOD
from tests.skills.applications.harvest.hanging_stem import DIAMETER, MASS, STRONG, WEAK, G, Stem
from tests.skills.picking_scene import apple_at

WORKSPACE = Workspace(
    table_z=None, lower=np.array([-0.8, -1.1, -0.4]), upper=np.array([0.8, 0.3, 1.1])
)

ROBOT_MODEL = RobotModel.load(ROBOT)
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
HEIGHT = 0.068


@cache
def middle_posture() -> np.ndarray:
    """Joints from which the hand at an unbroken stem rolls furthest both ways."""
    T = Stem().T
    postures = inverse_kinematics(ROBOT_MODEL, T, arm_angles=16)
    return max(postures, key=lambda q: min(roll_of(q, T, way) for way in (1.0, -1.0)))


def roll_of(q: np.ndarray, T: np.ndarray, way: float) -> float:
    return free_roll(ROBOT_MODEL, q, T[:3, 3] + [0.0, 0.0, 0.055], way, 2.4)


class Rig:
    """An arm, a gripper and fingers around a fruit on its stem."""

    def __init__(self, strength: np.ndarray = WEAK, bending: float = 0.08) -> None:
        self.stem = Stem(strength, bending=bending)
        self.clock = MockClock()
        self.arm = MockArm(self.clock, middle_posture())
        self.gripper = MockGripper(self.clock, width=DIAMETER + 0.02)
        self.fingers = MockForceSensor(self.clock)
        self.fingers.feel = lambda _now: self.stem.wrenches()
        self.clock.each_step.append(self._step)
        base = apple_at(1, 1)
        fruit = replace(
            base,
            T_base_fruit=transform(DOWN, self.stem.T[:3, 3]),
            dimensions=np.array([DIAMETER, HEIGHT, DIAMETER]),
        )
        T = self.stem.T.copy()
        self.grasp = Grasp(0, 0.0, 0.0, T, T, DIAMETER + 0.02, self.arm.q[None], 0.01, 0.0, fruit)

    def _step(self) -> None:
        stem = self.stem
        stem.time += PERIOD
        stem.T = ROBOT_MODEL.tcp(self.arm.q)
        turned = stem.R0.T @ stem.T[:3, :3]
        stem.roll = float(np.arctan2(turned[1, 0], turned[0, 0]))
        stem.width = self.gripper.width
        stem.load()

    def drive(self, **how: Any) -> SkillEnd:
        inputs = {"grasp": self.grasp, **how.pop("inputs", {})}
        devices: dict[type, object] = {
            Arm: self.arm, StreamedArm: self.arm, Gripper: self.gripper, ForceSensor: self.fingers,
            Workspace: WORKSPACE,
        }  # fmt: skip
        return drive(Detach(), inputs, devices, clock=self.clock, **how)


def when(rig: Rig, phase: str, act: Callable[[], None], skill: Detach) -> Callable[[int], None]:
    """Act in the first tick in which the skill's feedback names a phase."""
    done: list[int] = []

    def tick(number: int) -> None:
        if phase in skill.feedback_message and not done:
            done.append(number)
            act()

    return tick


def drive_until(rig: Rig, phase: str, act: Callable[[], None], **how: Any) -> SkillEnd:
    """Drive a skill and act once when a phase begins."""
    skill = Detach()
    devices: dict[type, object] = {
        Arm: rig.arm, StreamedArm: rig.arm, Gripper: rig.gripper, ForceSensor: rig.fingers,
        Workspace: WORKSPACE,
    }  # fmt: skip
    return drive(
        skill,
        {"grasp": rig.grasp},
        devices,
        clock=rig.clock,
        each_tick=when(rig, phase, act, skill),
        **how,
    )


def code(end: SkillEnd) -> str:
    assert end.reason is not None
    return end.reason.code


def test_a_fruit_is_rolled_off_and_held_with_the_hand_at_rest() -> None:
    rig = Rig()
    began = rig.stem.T[:3, 3].copy()
    end = rig.drive()
    assert end.status is Status.SUCCESS, end.reason
    assert rig.stem.broken is not None
    assert rig.arm.settled()
    assert rig.gripper.width < DIAMETER
    assert rig.stem.wrenches()[:, 2].max() < -1.0
    assert (rig.stem.T[:3, 3] - began)[1] > 0.08
    assert end.outputs["stem_force"] < 8.0
    assert 0.8 < end.outputs["rolled"] < 2.4
    assert [view for topic, view in end.published if topic == "candidates"] == [
        TAKEN
    ]  # it is drawn no more where it hung


@pytest.mark.slow
def test_a_stem_that_holds_is_let_back_and_the_fruit_is_released() -> None:
    rig = Rig(STRONG, bending=0.01)
    end = rig.drive()
    assert code(end) == "NOTHING_BROKE"
    assert rig.gripper.width > DIAMETER + 0.005
    moved = rig.stem.T[:3, 3] - rig.grasp.T_base_grasp[:3, 3]
    assert moved == pytest.approx([0.0, 0.10, 0.0], abs=0.03)  # back from where the branch rests


def test_pads_that_meet_nothing_open_again() -> None:
    rig = Rig()
    rig.stem.gone = True
    end = rig.drive()
    assert code(end) == "NOT_GRIPPED"


def test_fingers_that_wood_holds_open_no_further_and_are_relaxed() -> None:
    rig = Rig()
    rig.stem.gone = True
    stored: list[float] = []

    def wood() -> None:
        beyond = rig.gripper.width - 0.062 + (stored[-1] if stored else 0.0)
        stored.append(max(beyond, 0.0))
        rig.gripper.motor_force = -1e4 * stored[-1]
        rig.gripper.width = min(rig.gripper.width, 0.062)

    end = drive_until(rig, "opening", lambda: rig.clock.each_step.append(wood))
    assert code(end) == "NOT_GRIPPED"
    assert 1e-3 < max(stored) < 2.0 * DetachSettings().stuck
    assert stored[-1] < 2e-3


@pytest.mark.parametrize(("phase", "expected"), [("rolling", "SLIPPED"), ("moving back", "LOST")])
def test_a_fruit_that_leaves_the_pads_has_slipped_or_is_lost(phase: str, expected: str) -> None:
    rig = Rig()
    end = drive_until(rig, phase, lambda: setattr(rig.stem, "gone", True))
    assert code(end) == expected
    assert rig.arm.settled()


def test_pads_that_read_wood_at_any_place_keep_the_grip() -> None:
    """A jam ends with open fingers only if the force changes with the place of the hand.

    Without a motor's force the grip has loosened by the false force, though not beyond where a fruit is held.
    """
    rig = Rig()

    def jam() -> None:
        rig.fingers.feel = lambda _now: np.array([[0, 0, -9.0, 0, 0, 0], [0.0, 0, -1.0, 0, 0, 0]])
        rig.fingers.saturated = (True, False)

    end = drive_until(rig, "rolling", jam)
    assert code(end) == "STEM_UNCLEAR"
    assert rig.gripper.width < DIAMETER + 5e-3


def wood_pushes(rig: Rig, side: float, motor_force: float) -> Callable[[], None]:
    """Return an action after which wood moves the fingers by 8 mm, at 20 mm/s, unless they go faster."""

    def push() -> None:
        rig.gripper.motor_force = motor_force
        start, began = rig.gripper.width, rig.clock.now()

        def wood() -> None:
            reached = start + side * min(0.02 * (rig.clock.now() - began), 0.008)
            rig.gripper.width = (
                max(rig.gripper.width, reached) if side > 0.0 else min(rig.gripper.width, reached)
            )

        rig.clock.each_step.append(wood)

    rig.clock.each_step.append(lambda: rig.gripper.check())
    return push


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_fingers_that_wood_pushes_give_way_until_the_hand_has_turned_back(side: float) -> None:
    rig = Rig(STRONG, bending=0.01)
    assert code(drive_until(rig, "rolling", wood_pushes(rig, side, side * 10.0))) in (
        "JAMMED",
        "SLIPPED",
    )


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_fingers_that_move_by_themselves_are_left_to_the_supervisor(side: float) -> None:
    rig = Rig(STRONG, bending=0.01)
    with pytest.raises(DeviceFault, match="without a command"):
        drive_until(rig, "rolling", wood_pushes(rig, side, -side * 10.0))


def held_for(rig: Rig, duration: float) -> Callable[[], None]:
    """Hold the arm where it is, from now on, and then let it go where its motion has gone."""

    def hold() -> None:
        q, until = rig.arm.q.copy(), rig.clock.now() + duration

        def step() -> None:
            if rig.clock.now() < until:
                rig.arm.q = q.copy()

        rig.clock.each_step.insert(1, step)

    return hold


@pytest.mark.parametrize(
    ("duration", "expected"), [(0.5, "NOTHING_BROKE"), (1.5, "JAMMED"), (6.0, "STEM_UNCLEAR")]
)
@pytest.mark.slow
def test_a_fruit_is_left_while_something_holds_the_arm(duration: float, expected: str) -> None:
    rig = Rig(STRONG, bending=0.01)
    assert code(drive_until(rig, "rolling", held_for(rig, duration))) == expected


def test_a_detached_fruit_is_not_given_up_to_a_push() -> None:
    rig = Rig()
    with pytest.raises(DeviceFault, match="closes without a command"):
        drive_until(rig, "moving back", wood_pushes(rig, -1.0, -10.0))


def test_fingers_that_fall_silent_end_it_with_the_grip_kept() -> None:
    rig = Rig()
    end = drive_until(rig, "rolling", lambda: rig.fingers.lose(5.0))
    assert code(end) == "SENSOR_STALE"
    assert rig.arm.settled()
    assert rig.gripper.width < DIAMETER
    assert not rig.gripper.moves


def test_a_stopped_arm_and_one_that_fails_end_it_with_the_grip_kept() -> None:
    rig = Rig()
    end = drive_until(rig, "rolling", lambda: rig.arm._motion.stop())
    assert code(end) == "STOPPED"
    assert rig.gripper.width < DIAMETER
    rig = Rig()
    end = drive_until(rig, "rolling", lambda: rig.arm._motion.fail("joint 3 does not follow"))
    assert code(end) == "MOTION_FAILED"
    assert "joint 3" in end.reason.message


def test_an_arm_that_refuses_to_stream_moves_nothing() -> None:
    rig = Rig()
    rig.arm.safe_stop("a test")
    end = rig.drive()
    assert code(end) == "REFUSED"
    assert rig.gripper.width == pytest.approx(DIAMETER + 0.02)


def test_a_posture_from_which_the_hand_cannot_roll_is_refused_before_anything_moves() -> None:
    rig = Rig()
    postures = inverse_kinematics(ROBOT_MODEL, rig.stem.T, arm_angles=36)
    reaches = [max(roll_of(q, rig.stem.T, way) for way in (1.0, -1.0)) for q in postures]
    tight = float(np.radians(61.0))
    if min(reaches) >= tight:
        pytest.skip("every posture of this arm rolls far enough")
    rig.arm.q = postures[int(np.argmin(reaches))]
    end = rig.drive()
    assert code(end) == "OUT_OF_REACH"
    assert not rig.gripper.speeds


@pytest.mark.slow
def test_at_the_edge_of_the_reach_the_hand_waits_and_the_other_roll_is_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig, rolls = Rig(STRONG, bending=0.01), []

    def solve(robot: RobotModel, T: np.ndarray, q: np.ndarray) -> np.ndarray | None:
        turned = rig.stem.R0.T @ T[:3, :3]
        rolls.append(float(np.arctan2(turned[1, 0], turned[0, 0])))
        return None if abs(rolls[-1]) > 0.9 else nearest_solution(robot, T, q)

    monkeypatch.setattr("pomona.applications.harvest.set_point.nearest_solution", solve)
    assert code(rig.drive()) == "NOTHING_BROKE"
    assert min(rolls) < -0.8
    assert max(rolls) > 0.8


def test_a_hand_that_reached_no_further_still_tests_the_stem(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The time without a step went on through letting back and the test: the end of the reach was an unclear stem."""
    rig = Rig(STRONG, bending=0.01)
    skill = Detach()

    def solve(robot: RobotModel, T: np.ndarray, q: np.ndarray) -> np.ndarray | None:
        stuck = "rolling" in skill.feedback_message or "letting" in skill.feedback_message
        return None if stuck else nearest_solution(robot, T, q)

    monkeypatch.setattr("pomona.applications.harvest.set_point.nearest_solution", solve)
    devices: dict[type, object] = {
        Arm: rig.arm, StreamedArm: rig.arm, Gripper: rig.gripper, ForceSensor: rig.fingers, Workspace: WORKSPACE,
    }  # fmt: skip
    assert code(drive(skill, {"grasp": rig.grasp}, devices, clock=rig.clock)) == "OUT_OF_REACH"
    assert rig.gripper.width > DIAMETER + 0.005


def test_a_map_that_is_too_old_is_not_used() -> None:
    rig = Rig()
    end = rig.drive(inputs={"map": OccupancyMap.empty(WORKSPACE.lower, WORKSPACE.upper, 0.02)})
    assert code(end) == "MAP_STALE"
    assert not rig.gripper.speeds


def others_at(rig: Rig, *places: np.ndarray) -> AllDetections:
    frame, fruit = rig.grasp.fruit.frame, rig.grasp.fruit.fruit
    seen = tuple(
        Detection(
            fruit,
            frame,
            np.eye(4),
            transform(DOWN, p),
            np.zeros((9, 2)),
            0.9,
            np.eye(6),
            k,
            len(places),
            1.0,
        )
        for k, p in enumerate(places)
    )
    return AllDetections(seen, frame, np.eye(4))


def test_a_neighbour_in_the_way_of_both_rolls_is_not_risked() -> None:
    rig = Rig()
    T = rig.stem.T
    both = others_at(rig, *(T[:3, 3] + 0.06 * side * T[:3, 1] for side in (1.0, -1.0)))
    end = rig.drive(inputs={"others": both})
    assert code(end) == "NEIGHBOUR_AT_RISK"
    assert not rig.gripper.speeds


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_hand_rolls_away_from_a_neighbour_first(side: float) -> None:
    """The left finger rises when the hand rolls one way, the right one when it rolls the other way."""
    rig = Rig()
    T, knuckle = rig.stem.T, held_fruit(rig.grasp.fruit).p_base_knuckle
    place = knuckle + 0.085 * side * T[:3, 1]
    near = np.array([[*place, 0.038]])
    clear = {
        way: roll_clearance(T, way * 2.0, DIAMETER + 0.02, knuckle, near) for way in (1.0, -1.0)
    }
    end = rig.drive(inputs={"others": others_at(rig, place)})
    assert end.status is Status.SUCCESS, end.reason
    moved = rig.stem.R0.T @ rig.stem.T[:3, :3]
    assert abs(clear[1.0] - clear[-1.0]) > 0.005
    assert np.sign(np.arctan2(moved[1, 0], moved[0, 0])) == max(clear, key=lambda way: clear[way])


def test_interrupted_the_arm_decelerates_and_the_grip_is_kept() -> None:
    rig = Rig(STRONG, bending=0.01)
    places: list[np.ndarray] = []
    rig.clock.each_step.append(lambda: places.append(rig.arm.q.copy()))
    end = rig.drive(interrupt_after=90)
    assert end.status is Status.INVALID
    assert rig.arm.settled()
    assert rig.gripper.width < DIAMETER
    assert rig.gripper.speeds[-1][1] == 0.0
    assert not rig.gripper.moves
    acceleration = np.abs(np.diff(np.array(places), 2, axis=0)).max(axis=0) / PERIOD**2
    assert (acceleration <= 1.01 * rig.arm.limits.acceleration + 1e-6).all()


def test_without_set_points_the_arm_comes_to_rest_by_its_watchdog() -> None:
    rig = Rig()
    end = drive_until(rig, "rolling", lambda: setattr(rig.arm._motion, "aim", lambda q: None))
    assert code(end) == "MOTION_FAILED"
    assert "no new set-point came for 150 ms" in end.reason.message
    assert rig.arm.settled()
    assert rig.gripper.width < DIAMETER


def test_the_knuckle_is_above_the_fruit_along_its_stem() -> None:
    fruit = Rig().grasp.fruit
    held = held_fruit(fruit)
    assert held.p_base_knuckle - fruit.T_base_fruit[:3, 3] == pytest.approx(
        [0.0, 0.0, 0.025 + 0.44 * HEIGHT]
    )
    assert held.diameter == pytest.approx(DIAMETER)
    assert held.mass == pytest.approx(0.18, rel=0.25)


def test_neighbours_are_all_fruit_but_the_target() -> None:
    rig = Rig()
    here = rig.stem.T[:3, 3]
    away = here + np.array([0.1, 0.0, 0.0])
    near = neighbours_of(rig.grasp.fruit, others_at(rig, here + 0.01, away))
    assert near[:, :3] == pytest.approx(away[None])
    assert neighbours_of(rig.grasp.fruit, None).shape == (0, 4)


UNDISTURBED = 72.0
"""Roll at which the weak stem breaks [deg]."""


class Turned:
    """Rolls of the hand, and forces of the pads, while a skill runs."""

    def __init__(self, rig: Rig) -> None:
        self.rolls: list[float] = []
        self.presses: list[float] = []
        rig.clock.each_step.append(lambda: self._note(rig))

    def _note(self, rig: Rig) -> None:
        self.rolls.append(np.degrees(rig.stem.roll))
        self.presses.append(float(-rig.stem.wrenches()[:, 2].min()))


def paused(
    rig: Rig, duration: float, meanwhile: Callable[[], None] = lambda: None
) -> Callable[[], None]:
    """Return an action that pauses the cell: a paused run does not tick its skills."""

    def pause() -> None:
        rig.arm.pause()
        rig.gripper.pause()
        meanwhile()
        rig.clock.advance(min(duration, 2.0))
        rig.clock._steps += max(
            round((duration - 4.0) / PERIOD), 0
        )  # hand and fingers stand: nothing steps
        rig.clock.advance(min(max(duration - 2.0, 0.0), 2.0))
        rig.gripper.resume()
        rig.arm.resume()

    return pause


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["closing", "drawing", "rolling", "moving back"])
@pytest.mark.parametrize("duration", [1.0, 3.0])
def test_a_pause_leaves_the_path_as_it_is(phase: str, duration: float) -> None:
    rig = Rig()
    turned = Turned(rig)
    end = drive_until(rig, phase, paused(rig, duration))
    assert end.status is Status.SUCCESS, end.reason
    assert max(turned.rolls) < 140.0
    assert min(turned.rolls) > -5.0
    assert np.degrees(end.outputs["rolled"]) == pytest.approx(UNDISTURBED, abs=8.0)
    assert max(turned.presses) < BRUISE_FORCE
    assert rig.gripper.width < DIAMETER


def test_a_minute_of_pause_in_the_roll_leaves_the_path_as_it_is() -> None:
    rig = Rig()
    turned = Turned(rig)
    end = drive_until(rig, "rolling", paused(rig, 60.0), limit=90.0)
    assert end.status is Status.SUCCESS, end.reason
    assert max(turned.rolls) < 140.0


def test_a_slow_arm_turns_by_the_same_path() -> None:
    rig = Rig()
    turned, began = Turned(rig), rig.stem.T[:3, 3].copy()
    rig.arm.go_at(0.1)
    end = rig.drive()
    assert end.status is Status.SUCCESS, end.reason
    assert np.degrees(end.outputs["rolled"]) == pytest.approx(UNDISTURBED, abs=8.0)
    assert max(turned.rolls) < 100.0
    assert max(turned.presses) < BRUISE_FORCE
    assert end.outputs["stem_force"] < 6.0
    assert (rig.stem.T[:3, 3] - began)[1] > 0.08


@pytest.mark.slow
def test_a_pause_keeps_the_force_of_the_grip() -> None:
    rig, presses = Rig(STRONG, bending=0.01), []

    def swell() -> None:
        rig.stem.diameter += 4e-3
        rig.clock.each_step.append(lambda: presses.append(-rig.stem.wrenches()[:, 2].mean()))

    def look() -> None:
        paused(rig, 3.0, swell)()
        assert max(presses) > 5.0
        assert (
            presses[-1] < 5.0
        )  # fingers open beyond the grip's opening while both pads read more than its limit

    drive_until(rig, "rolling", look)
    assert presses


def lying(rig: Rig, lie: Callable[[np.ndarray, float], np.ndarray]) -> None:
    """Let the fingers report other wrenches from now on."""
    began = rig.clock.now()
    rig.fingers.feel = lambda now: lie(rig.stem.wrenches(), now - began)


def changed(
    finger: int | slice, channel: int, by: float, drift: float = 0.0
) -> Callable[..., np.ndarray]:
    def lie(wrenches: np.ndarray, age: float) -> np.ndarray:
        wrenches[finger, channel] += by + drift * age
        return wrenches

    return lie


def clipped(wrenches: np.ndarray, _age: float) -> np.ndarray:
    wrenches[0, :3] = np.clip(wrenches[0, :3], -0.5, 0.5)
    return wrenches


LIES = {
    "left presses less": changed(0, 2, 1.0),
    "left presses more": changed(0, 2, -1.0),
    "right aside": changed(1, 1, 1.0),
    "left along": changed(0, 0, 1.0),
    "both along": changed(slice(None), 0, 1.0),
    "both press more": changed(slice(None), 2, -1.0),
    "drift along": changed(slice(None), 0, 0.0, 0.5),
    "drift pressing": changed(0, 2, 0.0, -0.5),
    "half": lambda wrenches, _age: 0.5 * wrenches,
    "twice": lambda wrenches, _age: 2.0 * wrenches,
    "left clipped": clipped,
}


QUICK = ("left presses more", "both along", "half", "left clipped")  # one of each kind


@pytest.mark.parametrize(
    "lie", [pytest.param(lie, marks=() if lie in QUICK else pytest.mark.slow) for lie in LIES]
)
def test_a_detached_fruit_is_not_let_go_for_a_faulty_force(lie: str) -> None:
    rig = Rig()
    told: list[float] = []

    def after_the_break() -> None:
        if rig.stem.broken is not None and not told:
            told.append(rig.clock.now())
            lying(rig, LIES[lie])

    rig.clock.each_step.append(after_the_break)
    widths: list[float] = []
    rig.clock.each_step.append(lambda: widths.append(rig.gripper.width if told else 0.0))
    end = rig.drive(limit=90.0)
    assert told
    assert max(widths) < DIAMETER - 2e-4
    assert end.status is Status.SUCCESS or code(end) == "STEM_UNCLEAR"


@pytest.mark.parametrize("phase", ["drawing", "rolling"])
def test_pads_that_report_twice_the_force_neither_hide_the_break_nor_let_the_fruit_slip(
    phase: str,
) -> None:
    """The motor and the opening show the force: a free apple seemed to hang with its own weight in half the grip."""
    rig, held = Rig(), []

    def motor() -> None:
        press = -rig.stem.wrenches()[:, 2]
        rig.gripper.motor_force = 0.5 * round(2.0 * float(press.sum()))
        if rig.stem.broken is not None and rig.stem.time > rig.stem.broken + 0.5:
            held.append(press.min())

    rig.clock.each_step.append(motor)
    end = drive_until(rig, phase, lambda: lying(rig, LIES["twice"]))
    assert end.status is Status.SUCCESS, end.reason
    assert min(held) > G * MASS / (2.0 * 0.6)


def test_fingers_whose_motor_reads_a_push_outwards_do_not_squeeze_the_fruit() -> None:
    rig = Rig()
    turned = Turned(rig)
    rig.gripper.motor_force = -30.0
    rig.drive()
    assert max(turned.presses) < BRUISE_FORCE


@pytest.mark.parametrize(("constant", "code"), [(0.3, None), (1.3, "CONTACT")])
def test_a_load_on_a_pad_is_no_offset(constant: float, code: str | None) -> None:
    rig = Rig()
    leant = np.zeros((2, 6))
    leant[
        0, 2
    ] = -constant  # a branch that leans on the left pad all the time, or the sensor's own offset
    rig.fingers.feel = lambda _now: rig.stem.wrenches() + leant
    end = rig.drive()
    assert (end.reason.code if end.reason else None) == code
    assert (end.status is Status.SUCCESS) == (code is None)
