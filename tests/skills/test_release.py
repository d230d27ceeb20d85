from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Carrier, Hand, MotionState, Workspace
from pomona.executive.skill import Failure, SkillFailure
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills import release as release_module
from pomona.skills.grip.hold import Hold, current_hold
from pomona.skills.motion.lines import STEP, straight_line
from pomona.skills.release import BESIDE, Release
from pomona.skills.slip_avoid_grasp import SlipAvoidGrasp
from pomona.tools.mock.hand import spring_fruit
from tests.skills.overhead import BeltBeside, comes_near, watched
from tests.skills.picking_scene import (
    HOME,
    OBSERVE,
    ROBOT_MODEL,
    WORKSPACE,
    PickingScene,
    a_grasp,
    scene_with_pose,
    seen_map,
)


def over_ground(ground: float | None, **changes: Any) -> PickingScene:
    """A held fruit of 1.5 N above a ground that carries it from a height of the TCP on."""
    scene = PickingScene(q=a_grasp().q_pre_grasp[0].copy(), width=0.08, **changes)

    def feel(_now: float) -> np.ndarray:
        wrenches = np.zeros((2, 6))
        if scene.gripper.width < 0.081:
            wrenches[:, 2] = -2.0
            wrenches[:, 0] = 0.75 if ground is None or scene.tcp[2, 3] > ground else 0.0
        return wrenches

    scene.fingers.feel = feel
    scene.clock.advance(0.01)
    return scene


def test_it_lowers_until_the_fruit_is_carried_then_opens_and_rises():
    before = PickingScene(q=a_grasp().q_pre_grasp[0].copy()).tcp[2, 3]
    scene = over_ground(before - 0.06)
    heights = []

    def watch(_tick: int) -> None:
        if scene.gripper.moves:
            heights.append(scene.tcp[2, 3])

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=watch)
    assert outcome.status is Status.SUCCESS
    assert before - 0.068 < heights[0] < before - 0.06
    assert scene.gripper.moves[0].speed <= 0.1
    assert scene.gripper.width == pytest.approx(0.10, abs=1e-3)
    assert scene.tcp[2, 3] == pytest.approx(before, abs=1e-3)


@pytest.mark.parametrize(("opened", "rises"), [(0.002, False), (0.006, True)])
def test_fingers_that_a_neighbour_blocks_rise_once_they_have_released_the_fruit(
    opened: float, rises: bool
):
    before = PickingScene(q=a_grasp().q_pre_grasp[0].copy()).tcp[2, 3]
    scene = over_ground(before - 0.06)

    def block(_tick: int) -> None:
        if scene.gripper.moves and scene.gripper.width > 0.08 + opened:
            scene.gripper.moves[-1].end(MotionState.FAILED, "the fingers are blocked")
            scene.gripper.moves[-1].settled = True

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=block)
    assert (outcome.reason is None) == rises
    assert (scene.tcp[2, 3] > before - 0.001) == rises
    if outcome.reason is not None:
        assert outcome.reason.code == "MOTION_FAILED"


def test_over_nothing_the_fruit_stays_held():
    scene = over_ground(None)
    outcome = drive(Release(), {"depth": 0.05}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NO_CONTACT"
    assert scene.gripper.moves == []


def test_fingers_that_are_pushed_beside_the_fruit_end_the_way_down():
    scene = over_ground(None)

    def push(tick: int) -> None:
        if 20 < tick < 25:  # by 20 mm/s
            scene.gripper.width -= 0.4e-3
        scene.gripper.check()

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=push)
    assert outcome.reason.code == "LOWERING_BLOCKED"
    assert "pushes the fingers" in outcome.reason.message


def test_a_push_counts_from_the_start_of_the_way_down_also_after_a_jolt():
    scene = over_ground(None)
    calm = scene.fingers.feel

    def push(tick: int) -> None:
        weight = np.zeros((2, 6))
        weight[0, 0] = 2.0 if tick in (20, 21) else 0.0
        scene.fingers.feel = lambda now: calm(now) + weight
        scene.gripper.width -= 0.5e-3 if tick in (15, 60) else 0.0

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=push)
    assert outcome.reason.code == "LOWERING_BLOCKED"
    assert len(scene.arm.followed) > 1  # it went on after the jolt


def test_empty_fingers_have_nothing_to_release():
    scene = PickingScene(q=a_grasp().q_pre_grasp[0].copy(), width=0.08)
    scene.clock.advance(0.01)
    assert drive(Release(), {}, scene.devices, clock=scene.clock).reason.code == "NOT_HELD"
    assert scene.arm.followed == []


class Doubt:
    def in_hand(self) -> str:
        return "something may be between the fingers: the fingers stand at 80.0 mm, where they may hold something"


def test_fingers_that_feel_nothing_but_may_hold_something_are_not_called_empty_and_nothing_moves():
    scene = PickingScene(q=a_grasp().q_pre_grasp[0].copy(), width=0.08)
    scene.clock.advance(0.01)
    outcome = drive(Release(), {}, {**scene.devices, Hand: Doubt()}, clock=scene.clock)
    assert outcome.reason.code == "HAND_UNCLEAR"
    assert "80.0 mm, where they may hold something; it cannot be put down" in outcome.reason.message
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


def test_it_first_goes_to_the_pose_it_is_given():
    scene = over_ground(None)
    outcome = drive(Release(), {"into": "home", "depth": 0.02}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NO_CONTACT"
    np.testing.assert_allclose(scene.arm.followed[0].q[-1], HOME, atol=1e-9)


def test_a_fruit_lost_on_the_way_down_is_reported():
    scene = over_ground(None)

    def drop(tick: int) -> None:
        if tick == 20:
            scene.fingers.feel = lambda _now: np.zeros((2, 6))

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=drop)
    assert outcome.reason.code == "LOST"
    assert scene.arm.settled()
    assert scene.gripper.moves == []


def test_it_opens_only_after_the_fruit_hangs_again():
    before = PickingScene(q=a_grasp().q_pre_grasp[0].copy()).tcp[2, 3]
    scene = over_ground(before - 0.06)
    heights = []

    def watch(_tick: int) -> None:
        if not scene.gripper.moves:
            heights.append(scene.tcp[2, 3] - before + 0.06)

    assert (
        drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=watch).status
        is Status.SUCCESS
    )
    lowest = heights.index(min(heights))
    assert -0.001 < heights[lowest] < 0.0
    assert max(heights[lowest:]) == pytest.approx(heights[lowest] + 0.002, abs=2e-4)
    assert heights[-1] == pytest.approx(heights[lowest], abs=2e-4)


def test_a_fruit_whose_floor_takes_the_pressing_force_from_one_finger_is_put_down():
    before = PickingScene(q=a_grasp().q_pre_grasp[0].copy()).tcp[2, 3]
    scene = over_ground(before - 0.06)
    calm = scene.fingers.feel

    def feel(now: float) -> np.ndarray:
        wrenches = calm(now)
        if scene.tcp[2, 3] <= before - 0.06 and scene.gripper.width < 0.081:
            wrenches[0, 2], wrenches[:, 0] = -0.05, -0.7
        return wrenches

    scene.fingers.feel = feel
    outcome = drive(Release(), {}, scene.devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS
    assert len(scene.gripper.moves) == 2


def test_a_jolt_on_the_way_down_opens_nothing():
    scene = over_ground(None)
    calm = scene.fingers.feel

    def jolt(tick: int) -> None:
        weight = np.zeros((2, 6))
        weight[0, 0] = 2.0 if tick in (20, 21) else 0.0  # an arm whose controller halts
        scene.fingers.feel = lambda now: calm(now) + weight

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=jolt)
    assert outcome.reason.code == "NO_CONTACT"
    assert "the fruit met nothing (150 mm down)" in outcome.reason.message
    assert scene.gripper.moves == []


def test_a_fruit_lost_while_it_is_raised_is_not_reported_as_held():
    before = PickingScene(q=a_grasp().q_pre_grasp[0].copy()).tcp[2, 3]
    scene = over_ground(before - 0.02)
    calm, lowest = scene.fingers.feel, [before]

    def feel(now: float) -> np.ndarray:
        lowest[0] = min(lowest[0], scene.tcp[2, 3])
        raised = lowest[0] < before - 0.02 and scene.tcp[2, 3] > lowest[0] + 0.0005
        return np.zeros((2, 6)) if raised or lowest[0] == -1.0 else calm(now)

    def lose(now: float) -> np.ndarray:
        felt = feel(now)
        if not felt.any():
            lowest[0] = -1.0
        return felt

    scene.fingers.feel = lose
    outcome = drive(Release(), {}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "LOST"
    assert scene.gripper.moves == []


class Held:
    """A fruit of 1.5 N that a grip controls, above a ground that carries it from a height of the TCP on."""

    def __init__(self, drop: float | None) -> None:
        self.scene = PickingScene(q=a_grasp().q_pre_grasp[0].copy(), width=0.092)
        press = spring_fruit(self.scene.gripper, 0.08)
        self.ground = -1.0 if drop is None else self.scene.tcp[2, 3] - drop
        self.pushed = 0.0
        self.load = 0.0

        def feel(now: float) -> np.ndarray:
            wrenches = press(now)
            carried = self.scene.tcp[2, 3] <= self.ground
            wrenches[:, 0] += 0.0 if carried else 0.5 * self.load
            wrenches[:, 0] += 0.5 * self.pushed
            return wrenches

        self.scene.fingers.feel = feel
        hold = drive(SlipAvoidGrasp(), {}, self.scene.devices, clock=self.scene.clock).outputs[
            "hold"
        ]
        assert isinstance(hold, Hold)
        self.hold = hold
        self.load = 1.5
        self.load = 1.5
        self.scene.clock.advance(1.0)

    @property
    def rests(self) -> bool:
        """Whether the fingers stand, since something else carries the fruit."""
        return self.hold._controller.rests

    def release(self, each_tick: Callable[[int], None] = lambda _tick: None) -> SkillEnd:
        return drive(
            Release(),
            {"hold": self.hold},
            self.scene.devices,
            clock=self.scene.clock,
            each_tick=each_tick,
        )


def test_a_false_floor_leaves_the_fruit_under_force_control():
    held = Held(None)

    def jolt(tick: int) -> None:
        held.pushed = 2.0 if tick in (20, 21) else 0.0

    outcome = held.release(jolt)
    assert outcome.reason.code == "NO_CONTACT"
    assert "the fruit met nothing (150 mm down)" in outcome.reason.message
    assert held.scene.gripper.moves == []
    assert held.hold.holds
    calm = held.hold.reading.f_n
    held.load = 4.0
    held.scene.clock.advance(0.5)
    assert held.hold.reading.f_n > calm + 1.0


def test_a_jolt_on_the_way_down_does_not_end_it():
    held = Held(0.04)

    def jolt(tick: int) -> None:
        held.pushed = -2.0 if tick in (20, 21) else 0.0

    outcome = held.release(jolt)
    assert outcome.status is Status.SUCCESS, outcome.reason
    assert held.scene.gripper.width > 0.09
    assert held.hold.ended


def test_a_load_that_is_jolted_again_and_again_is_not_put_down():
    held = Held(None)

    def jolt(tick: int) -> None:
        held.pushed = -2.0 if 5 <= tick % 20 < 7 else 0.0

    outcome = held.release(jolt)
    assert outcome.reason.code == "NO_CONTACT"
    assert "gone again 4 times, as after jolts" in outcome.reason.message
    assert held.scene.gripper.moves == []
    assert held.hold.holds


def test_the_fingers_rest_from_the_contact_on_until_the_load_grows():
    held = Held(None)
    force = held.hold.reading.f_n
    current_hold(held.scene.gripper).rest_on_contact(0.35)
    held.scene.clock.advance(0.1)
    for push in (
        -3.0,
        0.0,
    ):  # a floor that carries the fruit and presses as much on it again; then it hangs as before
        held.pushed = push
        held.scene.clock.advance(0.5)
        assert held.rests
        assert held.hold.reading.f_n == pytest.approx(force, abs=0.15)
    held.load = 4.0
    held.scene.clock.advance(0.5)
    assert not held.rests
    assert held.hold.reading.f_n > force + 1.0


def test_the_fingers_stand_from_the_contact_on_and_control_ends_when_they_open():
    held = Held(0.04)
    standing: list[bool] = []

    def watch(_tick: int) -> None:
        standing.append(held.rests)
        if standing[-1] and not held.scene.gripper.moves:
            assert held.scene.gripper.speeds[-1][1] == 0.0

    assert held.release(watch).status is Status.SUCCESS
    assert sum(standing) > 10
    assert held.hold.ended
    assert len(held.scene.gripper.moves) == 2  # off the fruit, and on


def test_interrupted_while_the_contact_is_doubted_the_grip_is_controlled_again():
    held = Held(0.04)
    grounded: list[int] = []

    def watch(tick: int) -> None:
        if held.scene.tcp[2, 3] <= held.ground:
            grounded.append(tick)

    held.release(watch)
    again = Held(0.04)
    outcome = drive(
        Release(),
        {"hold": again.hold},
        again.scene.devices,
        clock=again.scene.clock,
        interrupt_after=grounded[0] + 5,
    )
    assert outcome.status is Status.INVALID
    assert again.hold.holds
    before = again.hold.reading.f_n
    again.ground, again.load = -1.0, 4.0
    again.scene.clock.advance(0.5)
    assert again.hold.reading.f_n > before + 1.0


LIES = {
    "0.5 N/s down the pads": lambda t, felt: felt - 0.5 * t * np.eye(2, 6),
    "0.5 N/s up the pads": lambda t, felt: felt + 0.5 * t * np.eye(2, 6),
    "0.5 N/s across the pads": lambda t, felt: felt - 0.5 * t * np.eye(2, 6, 1),
    "0.05 N/s": lambda t, felt: felt + 0.05 * t * np.eye(2, 6),
    "5 N/s": lambda t, felt: felt + 5.0 * t * np.eye(2, 6),
    "all signals grow by 20 % a second": lambda t, felt: felt * (1.0 + 0.2 * t),
    "those along the pads fade": lambda t, felt: (
        felt * np.where(np.arange(6) < 2, np.exp(-0.3 * t), 1.0)
    ),
    "a bias that comes": lambda t, felt: felt + (1.0 if t > 1.5 else 0.0) * np.eye(2, 6),
}


@pytest.mark.parametrize("lie", LIES)
def test_faulty_finger_readings_are_not_taken_for_a_floor(lie):
    scene = over_ground(None)
    calm = scene.fingers.feel
    scene.fingers.feel = lambda now: LIES[lie](now, calm(now))
    outcome = drive(Release(), {"depth": 0.15}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NO_CONTACT"
    assert scene.gripper.moves == []


@pytest.mark.parametrize("lie", LIES)
def test_whatever_the_fingers_lie_they_open_at_the_floor_or_not_at_all(lie):
    before = PickingScene(q=a_grasp().q_pre_grasp[0].copy()).tcp[2, 3]
    scene = over_ground(before - 0.02)
    calm, heights = scene.fingers.feel, []
    scene.fingers.feel = lambda now: LIES[lie](now, calm(now))

    def watch(_tick: int) -> None:
        if scene.gripper.moves:
            heights.append(scene.tcp[2, 3] - before + 0.02)

    outcome = drive(Release(), {"depth": 0.15}, scene.devices, clock=scene.clock, each_tick=watch)
    assert bool(heights) is (outcome.status is Status.SUCCESS)
    assert all(height < 1e-3 for height in heights[:1])


def test_interrupted_while_lowering_the_fruit_stays_held():
    scene = over_ground(None)
    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, interrupt_after=30)
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    assert scene.gripper.moves == []


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason_and_the_fruit_stays_held(code):
    scene = over_ground(None)
    outcome = drive(
        Release(), {}, scene.devices, clock=scene.clock, each_tick=scene.arm_trouble(code)
    )
    assert outcome.reason.code == code
    assert scene.gripper.moves == []


@pytest.mark.parametrize(
    "code",
    [
        "START_IN_COLLISION",
        "GOAL_UNREACHABLE",
        "GOAL_IN_COLLISION",
        "NO_PATH",
        "TIMEOUT",
        "UNKNOWN_POSE",
        "MAP_STALE",
    ],
)
def test_a_pose_that_cannot_be_reached_is_a_reason_and_the_fruit_stays_held(code):
    scene, given = scene_with_pose(code, width=0.08)
    scene.hold_fruit()
    inputs = {"into": "there", **given["inputs"]}
    outcome = drive(Release(), inputs, scene.devices, clock=scene.clock, **given["settings"])
    assert outcome.reason.code == code
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


def test_variations_of_a_pose_are_places_for_one_fruit_after_the_other():
    scene = over_ground(None)
    inputs = {"into": "observe", "variation": 2, "depth": 0.02}
    drive(Release(), inputs, scene.devices, clock=scene.clock)
    np.testing.assert_allclose(scene.arm.followed[0].q[-1], WORKSPACE.poses["observe_2"], atol=1e-9)


def test_fruit_at_earlier_places_is_in_the_way_of_later_ones_and_the_place_counts_anew(monkeypatch):
    scene, skill = over_ground(STOOD - 0.003), Release()
    avoided = []

    def move_to_pose(_skill: Release, _pose: str, *_: Any, avoiding: Any, **__: Any) -> Any:
        avoided.append([round(float(fruit.T_base_fruit[2, 3]), 3) for fruit in avoiding])
        yield from ()

    monkeypatch.setattr(release_module, "move_to_pose", move_to_pose)
    inputs = {"into": "observe", "grasp": a_grasp()}
    assert drive(skill, inputs, scene.devices, clock=scene.clock).status is Status.SUCCESS
    for into, variation in (("observe", 2), ("observe", 1), ("home", 1)):
        scene.hold_fruit()
        place = {"into": into, "variation": variation}
        drive(skill, inputs | place, scene.devices, clock=scene.clock)
    stood = pytest.approx(float(a_grasp().fruit.T_base_fruit[2, 3]) - 0.003, abs=1.1e-3)
    assert avoided == [[], [stood], [], [stood]]  # another crate's first place


def test_a_place_that_the_cell_does_not_have_is_no_other_one_and_nothing_moves():
    scene = over_ground(None)
    scene.hold_fruit()
    last = next(k for k in range(2, 99) if f"observe_{k}" not in WORKSPACE.poses)
    outcome = drive(
        Release(), {"into": "observe", "variation": last}, scene.devices, clock=scene.clock
    )
    assert outcome.reason.code == "UNKNOWN_POSE"
    assert f"the cell file has no pose 'observe_{last}'" in outcome.reason.message
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


class CellWithPoses:
    """Facts about a cell with these poses."""

    name = "bench"

    def __init__(self, *names: str) -> None:
        self.workspace = replace(WORKSPACE, poses=dict.fromkeys(names, WORKSPACE.poses["observe"]))

    def known(self, what: type) -> Workspace | None:
        return self.workspace if what is Workspace else None


def test_a_tree_that_counts_on_more_places_than_the_cell_has_is_an_error():
    cell, known = CellWithPoses("crate", "crate_2", "crate_4"), {"into": "crate", "places": 2}
    assert list(Release.judge(known, cell)) == list(Release.judge({"into": "crate"}, cell)) == []
    assert list(Release.judge(known | {"places": 9}, None)) == []
    (found,) = Release.judge(known | {"places": 4}, cell)
    assert found.key == "places"
    assert found.message == "it counts on 4 places, and the cell 'bench' has no pose 'crate_3'"


def test_where_the_gripper_cannot_go_down_nothing_moves():
    scene = over_ground(None)
    below_finger = (scene.tcp @ [0.0, 0.045, 0.055, 1.0])[:3]
    outcome = drive(
        Release(), {"map": seen_map(blocked=(below_finger,))}, scene.devices, clock=scene.clock
    )
    assert outcome.reason.code == "LOWERING_BLOCKED"
    assert "map" in outcome.reason.message
    assert scene.arm.followed == []


def test_it_ends_before_the_gripper_would_touch_the_table():
    scene = over_ground(None)
    outcome = drive(Release(), {"depth": 0.5}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NO_CONTACT"
    assert -0.12 + 0.012 < scene.tcp[2, 3] < -0.12 + 0.025  # the pads' tips are 12 mm below the TCP
    assert scene.gripper.moves == []


def test_it_is_quick_until_the_fruit_is_near_a_known_object():
    slow, quick = over_ground(-0.085), over_ground(-0.085)
    outcomes = [
        drive(Release(), inputs, scene.devices, clock=scene.clock)
        for scene, inputs in ((slow, {}), (quick, {"grasp": a_grasp()}))
    ]
    assert [outcome.status for outcome in outcomes] == [Status.SUCCESS] * 2
    assert outcomes[1].duration < 0.6 * outcomes[0].duration


STOOD = float(
    a_grasp().T_base_grasp[2, 3]
)  # height of the tool at which the fruit stood on the table [m]


@pytest.mark.parametrize(("above", "raises"), [(0.001, False), (-0.002, False), (0.006, True)])
def test_a_contact_where_the_fruit_is_known_to_stand_opens_at_once_and_another_is_doubted(
    above: float, raises: bool
):
    scene, heights = over_ground(STOOD + above), []

    def watch(_tick: int) -> None:
        if not scene.gripper.moves:
            heights.append(scene.tcp[2, 3])

    outcome = drive(
        Release(),
        {"grasp": a_grasp()},
        scene.devices,
        clock=scene.clock,
        each_tick=watch,
    )
    assert outcome.status is Status.SUCCESS, outcome.reason
    lowest = heights.index(min(heights))
    assert STOOD + above - 0.001 < heights[lowest] <= STOOD + above
    assert (max(heights[lowest:]) > heights[lowest] + 0.0015) == raises


def test_it_lands_slowly_and_rises_while_the_fingers_open():
    scene, ticks = over_ground(STOOD), []

    def watch(_tick: int) -> None:
        ticks.append((scene.clock.now(), scene.tcp[2, 3], scene.gripper.width))

    drive(
        Release(),
        {"grasp": a_grasp()},
        scene.devices,
        clock=scene.clock,
        each_tick=watch,
    )
    t, z, width = np.array(ticks).T
    speed = np.diff(z) / np.diff(t)
    down = z[1:] < np.minimum.accumulate(z)[:-1]
    assert min(speed) < -0.2
    assert min(speed[down & (z[1:] < STOOD + 0.001)]) > -0.0085
    rises = np.flatnonzero(z > STOOD + 0.003)
    first = rises[rises > z.argmin()][0]
    assert width[0] + 0.004 < width[first] < width[-1] - 0.002


def test_the_inertia_of_a_heavy_fruit_that_is_lowered_quickly_is_no_contact():
    scene = over_ground(-0.085)
    calm, began, accelerations = scene.fingers.feel, [0.0], [np.zeros((2, 2))]

    def feel(now: float) -> np.ndarray:
        for followed in scene.arm.followed[len(began) - 1 :]:
            heights = np.array([ROBOT_MODEL.tcp(q)[2, 3] for q in followed.q])
            rising = np.gradient(np.gradient(heights, followed.t), followed.t)
            began.append(now)
            accelerations.append(np.array([followed.t, rising]))
        wrenches = calm(now)
        wrenches[:, 0] *= (
            4.0 + 4.0 * np.interp(now - began[-1], *accelerations[-1], right=0.0) / 9.81
        )
        return wrenches

    scene.fingers.feel = feel
    scene.clock.advance(0.01)
    outcome = drive(Release(), {"grasp": a_grasp()}, scene.devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS, outcome.reason
    assert scene.arm.followed[1].duration < 3.0  # a jolt would end the quick part early: 7.5 s


def test_an_unknown_support_is_met_no_faster_than_the_arm_can_stop():
    ground = PickingScene(q=a_grasp().q_pre_grasp[0].copy()).tcp[2, 3] - 0.05
    scene, heights = over_ground(ground), []

    def watch(_tick: int) -> None:
        heights.append(scene.tcp[2, 3])

    drive(Release(), {"grasp": a_grasp()}, scene.devices, clock=scene.clock, each_tick=watch)
    assert 0.0 < ground - min(heights) < 0.04
    assert scene.gripper.moves == []


def test_an_approaching_object_in_view_stops_the_arm_and_in_the_same_moment_a_belt():
    scene = over_ground(None)
    devices, camera = watched(scene)
    belt = devices[Carrier] = BeltBeside(scene.arm)
    come = comes_near(scene, camera)
    outcome = drive(Release(), {"into": "home"}, devices, clock=scene.clock, each_tick=come)
    assert outcome.reason.code == "PATH_BLOCKED"
    assert scene.arm.settled()
    assert belt.stopped == [False]


@pytest.mark.parametrize("code", ["POSE_MISMATCH", "DEPTH_MISMATCH"])
def test_a_camera_that_shows_the_table_elsewhere_starts_no_motion(code):
    scene = over_ground(None)
    devices, camera = watched(scene)
    camera.untrue = code
    outcome = drive(Release(), {"into": "home"}, devices, clock=scene.clock)
    assert outcome.reason.code == code
    assert outcome.reason.data["tilt_rad"] > 0.08
    assert "above: " in outcome.reason.message
    assert scene.arm.followed == []


# ------------------------------------------------------------------------------------ without a force sensor


def plainly_held(width: float = 0.085, motor_force: float | None = 5.0) -> PickingScene:
    scene = PickingScene(q=a_grasp().q_pre_grasp[0].copy(), width=width)
    scene.grip_plainly(motor_force)
    return scene


def put_down(scene: PickingScene, heights: list[float], **inputs: Any) -> SkillEnd:
    def watch(_tick: int) -> None:
        if len(scene.gripper.moves) > 1 and not heights:
            heights.append(scene.tcp[2, 3])
            scene.drop_plainly()

    return drive(Release(), inputs, scene.without_sensor, clock=scene.clock, each_tick=watch)


@pytest.mark.parametrize("motor_force", [5.0, None])
def test_without_a_force_sensor_it_opens_within_millimetres_of_the_known_table(
    motor_force: float | None,
):
    scene, heights = plainly_held(motor_force=motor_force), list[float]()
    before = scene.tcp[2, 3]
    outcome = put_down(scene, heights, depth=0.3, grasp=a_grasp())
    assert outcome.status is Status.SUCCESS, outcome.reason
    stood = a_grasp().T_base_grasp[2, 3]  # where it stood on the table
    assert stood - 1e-3 < heights[0] < stood + BESIDE + STEP
    assert scene.gripper.width == pytest.approx(0.103, abs=2.1e-3)
    assert scene.tcp[2, 3] == pytest.approx(before, abs=1e-3)


def test_without_a_force_sensor_and_a_grasp_the_fruit_stays_held():
    scene = plainly_held(0.07)
    outcome = drive(Release(), {"depth": 0.3}, scene.without_sensor, clock=scene.clock)
    assert outcome.reason.code == "NO_CONTACT"
    assert "no grasp gives the lower end of the fruit" in outcome.reason.message
    assert scene.arm.followed == []
    assert len(scene.gripper.moves) == 1


def test_without_a_force_sensor_and_a_known_object_below_the_fruit_stays_held():
    scene = plainly_held()
    outcome = drive(
        Release(),
        {"depth": 0.03, "grasp": a_grasp()},
        scene.without_sensor,
        clock=scene.clock,
    )
    assert outcome.reason.code == "NO_CONTACT"
    assert "no force sensor" in outcome.reason.message
    assert scene.arm.followed == []
    assert len(scene.gripper.moves) == 1


def test_without_a_force_sensor_empty_fingers_have_nothing_to_release():
    scene = PickingScene(q=a_grasp().q_pre_grasp[0].copy(), width=0.08)
    assert drive(Release(), {}, scene.without_sensor, clock=scene.clock).reason.code == "NOT_HELD"
    assert scene.arm.followed == []


def test_without_a_force_sensor_a_fruit_lost_on_the_way_down_is_reported():
    scene = plainly_held()
    devices = scene.without_sensor
    outcome = drive(
        Release(), {"depth": 0.3, "grasp": a_grasp()}, devices, clock=scene.clock,
        each_tick=lambda tick: scene.drop_plainly() if tick == 20 else None,
    )  # fmt: skip
    assert outcome.reason.code == "LOST"
    assert "presses no more" in outcome.reason.message
    assert len(scene.gripper.moves) == 1


def test_without_a_force_sensor_pushed_fingers_end_the_way_down_and_hold():
    scene = plainly_held(motor_force=None)

    def push(tick: int) -> None:
        if tick == 20:
            scene.gripper.blocked_at -= 1e-3
            scene.gripper.width -= 1e-3

    outcome = drive(
        Release(),
        {"depth": 0.3, "grasp": a_grasp()},
        scene.without_sensor,
        clock=scene.clock,
        each_tick=push,
    )
    assert outcome.reason.code == "LOWERING_BLOCKED"
    assert len(scene.gripper.moves) == 1


def test_without_a_force_sensor_a_motor_that_still_presses_after_opening_is_not_called_released():
    scene = plainly_held()
    outcome = drive(
        Release(), {"depth": 0.3, "grasp": a_grasp()}, scene.without_sensor, clock=scene.clock
    )
    assert outcome.reason.code == "HAND_UNCLEAR"
    assert scene.tcp[2, 3] < -0.06  # it stays there


def test_without_a_force_sensor_an_interrupted_release_stays_held():
    scene = plainly_held()
    outcome = drive(
        Release(),
        {"depth": 0.3, "grasp": a_grasp()},
        scene.without_sensor,
        clock=scene.clock,
        interrupt_after=30,
    )
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    assert len(scene.gripper.moves) == 1


# ------------------------------------------------------------------------------------ parts of it, by themselves


class Parts(Release):
    """A release at mock devices, in a space that the test makes: `free` judges a width, or a path."""

    def __init__(
        self, scene: PickingScene, free: Callable[[Any], Any], patch: pytest.MonkeyPatch
    ) -> None:
        super().__init__()
        self.scene, self.free = scene, free
        self.asked: list[tuple[Any, ...]] = []
        patch.setattr(release_module, "space_around", self._space)

    def device(self, kind: Any) -> Any:
        return self.scene.devices[kind]

    def _space(self, skill: Any, *given: Any, held: Any = None) -> Any:
        assert skill is self
        self.asked.append((*given, held))
        return SimpleNamespace(
            at_width=lambda width: SimpleNamespace(free=lambda _q: self.free(width)),
            world=SimpleNamespace(
                with_margins=lambda _: SimpleNamespace(free=lambda way, _width: self.free(way))
            ),
            width=0.05,
        )


@pytest.mark.parametrize(
    ("widest", "opening"), [(1.0, 0.06), (0.059, 0.05), (0.049, 0.045), (0.0, 0.045)]
)
def test_the_fingers_open_as_far_as_touches_nothing(widest, opening, monkeypatch):
    part = Parts(PickingScene(width=0.04), lambda width: width <= widest, monkeypatch)
    assert part._opening(part._space(part)) == pytest.approx(opening)


def test_the_fingers_open_no_farther_than_they_can(monkeypatch):
    scene = PickingScene(width=0.095)
    part = Parts(scene, lambda _width: True, monkeypatch)
    assert part._opening(part._space(part)) == scene.gripper.limits.width_max


def lowered(by: float) -> tuple[np.ndarray, np.ndarray]:
    """Postures straight down from `OBSERVE`, and the heights of the tool in them [m]."""
    below = PickingScene().tcp - np.pad([[by]], ((2, 1), (3, 0)))
    way = straight_line(ROBOT_MODEL, OBSERVE, below).q
    return way, np.array([ROBOT_MODEL.tcp(q)[2, 3] for q in way])


@pytest.mark.parametrize("first", [0, 3, None])
def test_the_first_posture_that_is_not_free_is_the_first_contact(first, monkeypatch):
    way = np.arange(5)
    part = Parts(PickingScene(), lambda way: way < (9 if first is None else first), monkeypatch)
    assert part._met(way, "held", "map", 0.02) == first
    assert part.asked == [("map", 0.02, "held")]


@pytest.mark.parametrize(
    ("box", "carries"),
    [
        (((0.0, 0.0), 0.0), True),
        (((0.2, 0.0), 0.0), False),
        (((0.0, 0.0), 0.1), False),
        (None, False),
    ],
)
def test_a_fruit_stands_on_the_highest_level_box_below_it_or_on_the_table(
    box, carries, monkeypatch
):
    scene = PickingScene(q=a_grasp().q_pre_grasp[0].copy())
    below = scene.tcp[2, 3] - 0.06
    boxes = ()
    if box is not None:
        (x, y), tilt = box
        T_base_box = np.eye(4)
        T_base_box[:3, :3] = [
            [1, 0, 0],
            [0, np.cos(tilt), -np.sin(tilt)],
            [0, np.sin(tilt), np.cos(tilt)],
        ]
        T_base_box[:3, 3] = scene.tcp[0, 3] + x, scene.tcp[1, 3] + y, below - 0.01
        boxes = (
            replace(WORKSPACE.obstacles[0], T_base_box=T_base_box, half_extents=(0.1, 0.1, 0.01)),
        )
    part = Parts(scene, lambda _way: True, monkeypatch)
    devices = {**scene.devices, Workspace: replace(WORKSPACE, obstacles=boxes)}
    monkeypatch.setattr(part, "device", devices.get)
    ground = below if carries else WORKSPACE.table_z
    stood = a_grasp().T_base_grasp[2, 3] - WORKSPACE.table_z
    assert part._stands(a_grasp()) == pytest.approx(ground + stood, abs=2e-3)


@pytest.mark.parametrize(("stands", "near"), [(0.03, 0.018), (np.nan, 0.012), (0.06, 0.012)])
def test_the_way_down_is_slow_from_just_above_the_first_contact_and_lands_at_8_mm_per_s(
    stands, near, monkeypatch
):
    way, heights = lowered(0.1)
    met = int(np.flatnonzero(heights <= heights[0] - 0.024)[0])
    part = Parts(PickingScene(), lambda _way: True, monkeypatch)
    descent = part._descent(way, met, heights[0] - stands, 0.02)
    at = np.linspace(0.0, heights[0] - heights[-1], len(descent.most))
    known = stands == 0.03  # a support 36 mm below what is met first is not what is met
    slow_below = 0.026 if known else near + 0.003
    assert descent.slow_below == pytest.approx(heights[0] - slow_below, abs=0.004)
    assert set(descent.most[at < near - 1e-3]) == {0.3}
    assert 0.3 not in descent.most[at > near + 0.004]
    landing = np.abs(at - stands) < 0.0039
    assert set(descent.most[landing]) == (
        {0.008} if known else set() if np.isnan(stands) else {0.02}
    )
    assert descent.most[-1] == 0.02  # a support that is lower than known is not waited for


@pytest.mark.parametrize(
    ("code", "opened", "passes"),
    [
        ("MOTION_FAILED", 0.0031, True), ("MOTION_FAILED", 0.0029, False), ("STOPPED", 0.01, False),
    ],
)  # fmt: skip
def test_fingers_that_are_blocked_after_they_have_released_the_fruit_are_no_failure(
    code, opened, passes, monkeypatch
):
    scene = PickingScene(width=0.04)
    part = Parts(scene, lambda _way: True, monkeypatch)
    asked = []

    def move_fingers(width, speed):
        asked.append((width, speed))
        scene.gripper.state = lambda: SimpleNamespace(width=0.04 + opened)
        yield "moving"
        raise SkillFailure(Failure(code, "blocked", {}))

    part.move_fingers = move_fingers
    work = part._open(0.06, 0.04)
    next(work)
    with pytest.raises(StopIteration if passes else SkillFailure):
        next(work)
    assert asked == [(0.06, min(0.1, scene.gripper.limits.speed_max))]
