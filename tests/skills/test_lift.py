from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Box
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.geometry import transform
from pomona.skills.grip.grip import GripMode, GripProblem
from pomona.skills.grip.hold import Hold
from pomona.skills.grip.pads import MIRROR
from pomona.skills.lift import Lift
from pomona.skills.motion.lines import straight_line
from pomona.skills.shared.touch import something_between
from pomona.skills.slip_avoid_grasp import SlipAvoidGrasp
from pomona.tools.mock.hand import spring_fruit
from tests.skills.finger_pads import finger_pads
from tests.skills.picking_scene import (
    APPLES,
    ROBOT_MODEL,
    WORKSPACE,
    PickingScene,
    a_grasp,
    q_at_grasp,
    seen_map,
)


def holding() -> PickingScene:
    scene = PickingScene(q=q_at_grasp().copy(), width=0.085)
    scene.hold_fruit()
    return scene


def test_it_lifts_straight_up_and_still_holds():
    scene = holding()
    before = scene.tcp
    outcome = drive(Lift(), {"height": 0.15, "grasp": a_grasp()}, scene.devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS
    np.testing.assert_allclose(scene.tcp[:3, 3], before[:3, 3] + [0.0, 0.0, 0.15], atol=1e-6)
    np.testing.assert_allclose(scene.tcp[:3, :3], before[:3, :3], atol=1e-6)
    assert outcome.duration < 1.3
    shown = [view for topic, view in outcome.published if topic == "candidates"]
    assert [view.meshes for view in shown] == [
        ()
    ]  # the fruit is drawn no more where it was measured


def test_the_tool_is_accelerated_gently():
    scene = holding()
    drive(Lift(), {"height": 0.15}, scene.devices, clock=scene.clock)
    path = scene.arm.followed[0]
    height = np.array([ROBOT_MODEL.tcp(q)[2, 3] for q in path.q])
    speed = np.gradient(height, path.t)
    assert np.abs(speed).max() <= 0.25 + 1e-3
    assert np.abs(np.gradient(speed, path.t)).max() <= 1.0 + 0.05


def test_nothing_between_the_fingers_is_not_lifted():
    scene = PickingScene(q=q_at_grasp().copy(), width=0.085)
    scene.clock.advance(0.01)
    outcome = drive(Lift(), {"height": 0.15}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NOT_HELD"
    assert scene.arm.followed == []


def test_closed_fingers_that_press_each_other_hold_nothing():
    scene = PickingScene(q=q_at_grasp().copy(), width=0.035)
    scene.hold_fruit()
    assert drive(Lift(), {}, scene.devices, clock=scene.clock).reason.code == "NOT_HELD"


def test_the_grips_own_numbers_stand_before_those_of_now():
    problem = GripProblem("LOST", "the fruit is gone", 1.0, {"width_m": 0.051})
    hold = SimpleNamespace(ended=False, holds=False, problem=problem)
    reason = drive(Lift(), {"hold": hold}, holding().devices).reason
    assert (reason.code, reason.data["grip"], reason.data["width_m"]) == ("NOT_HELD", "LOST", 0.051)
    assert reason.data["left_force_n"] > 0.0


def test_a_fruit_that_falls_while_it_is_held_up_is_lost_too():
    scene = holding()
    assert drive(
        Lift(), {"hold_time": 1.0}, scene.devices, clock=scene.clock
    ).duration == pytest.approx(1.96, abs=0.1)
    scene = holding()

    def drop(tick: int) -> None:
        if tick == 70:  # up since tick 48
            scene.fingers.feel = lambda _now: np.zeros((2, 6))

    outcome = drive(Lift(), {"hold_time": 1.0}, scene.devices, clock=scene.clock, each_tick=drop)
    assert outcome.reason.code == "LOST"
    assert "lost 150 mm up" in outcome.reason.message


def test_a_fruit_that_slips_out_on_the_way_is_lost_and_the_arm_stops():
    scene = holding()

    def drop(tick: int) -> None:
        if tick == 25:
            scene.fingers.feel = lambda _now: np.zeros((2, 6))

    outcome = drive(Lift(), {"height": 0.15}, scene.devices, clock=scene.clock, each_tick=drop)
    assert outcome.reason.code == "LOST"
    assert "mm up" in outcome.reason.message
    assert scene.arm.settled()
    assert scene.tcp[2, 3] < a_grasp().T_base_grasp[2, 3] + 0.14


def test_beyond_reach_nothing_moves():
    scene = holding()
    outcome = drive(Lift(), {"height": 0.9}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "LIFT_BLOCKED"
    assert outcome.reason.data["reached_m"] == pytest.approx(0.4, abs=0.3)
    assert scene.arm.followed == []


def test_interrupted_it_stops_and_the_fingers_are_not_moved():
    scene = holding()
    outcome = drive(Lift(), {"height": 0.15}, scene.devices, clock=scene.clock, interrupt_after=25)
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    assert scene.gripper.moves == []
    assert scene.gripper.speeds == []


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason(code):
    scene = holding()
    outcome = drive(Lift(), {}, scene.devices, clock=scene.clock, each_tick=scene.arm_trouble(code))
    assert outcome.reason.code == code
    assert scene.arm.settled()
    assert scene.gripper.moves == []


def test_something_above_is_known_before_anything_moves():
    scene = holding()
    above = scene.tcp[:3, 3] + [0.0, 0.0, 0.25]
    outcome = drive(
        Lift(), {"grasp": a_grasp(), "map": seen_map(blocked=(above,))}, scene.devices, clock=scene.clock
    )  # fmt: skip
    assert outcome.reason.code == "LIFT_BLOCKED"
    assert outcome.reason.data["obstacle"] == "map"
    assert scene.arm.followed == []


def beside(rise: float, over: float) -> Box:
    """A box beside the held fruit and `over` it, its lower edge so far above the fruit's middle [m]."""
    T = holding().tcp
    return Box(
        "box",
        transform(T[:3, :3], (T @ [0.0485 - over, 0.0, -rise - 0.02, 1.0])[:3]),
        (0.004, 0.02, 0.02),
    )


@pytest.mark.parametrize(
    ("rise", "over", "code"), [(-0.04, 0.001, None), (0.025, 0.02, "LIFT_BLOCKED")]
)
def test_a_fruit_leaves_the_wall_that_it_touches_and_not_the_lip_above_it(rise, over, code):
    workspace = replace(WORKSPACE, obstacles=(*WORKSPACE.obstacles, beside(rise, over)))
    scene = PickingScene(q=q_at_grasp().copy(), width=0.085, workspace=workspace)
    scene.hold_fruit()
    outcome = drive(Lift(), {"grasp": a_grasp()}, scene.devices, clock=scene.clock)
    assert (outcome.reason and outcome.reason.code) == code
    assert (scene.arm.followed == []) == (code is not None)


def test_a_fruit_leaves_the_floor_of_the_crate_that_it_stands_on():
    p = holding().tcp[:3, 3]
    floor = Box(
        "crate",
        transform(None, [p[0], p[1], p[2] - APPLES[1][1] / 2e3 - 0.004]),
        (0.15, 0.15, 0.004),
    )
    scene = PickingScene(
        q=q_at_grasp().copy(), width=0.085, workspace=replace(WORKSPACE, obstacles=(floor,))
    )
    scene.hold_fruit()
    assert (
        drive(Lift(), {"grasp": a_grasp()}, scene.devices, clock=scene.clock).status
        is Status.SUCCESS
    )


def test_the_held_fruit_is_part_of_the_robot():
    scene = holding()
    beside = (scene.tcp @ [0.078, 0.0, -0.06, 1.0])[:3]
    without = drive(Lift(), {"map": seen_map(blocked=(beside,))}, scene.devices, clock=scene.clock)
    scene = holding()
    given = {"grasp": a_grasp(), "map": seen_map(blocked=(beside,))}
    outcome = drive(Lift(), given, scene.devices, clock=scene.clock)
    assert without.status is Status.SUCCESS
    assert outcome.reason.code == "LIFT_BLOCKED"
    assert outcome.reason.data["link"] == "held fruit"


def test_a_stale_map_is_not_free():
    scene = holding()
    outcome = drive(Lift(), {"map": seen_map(-1000.0)}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "MAP_STALE"
    assert scene.arm.followed == []


class Standing:
    """A fruit that stands on the table between the fingers, under a grip that presses with 8 N at most."""

    def __init__(self, weight: float, lever: float = 0.0, mu: float = 0.8) -> None:
        self.scene = PickingScene(q=q_at_grasp().copy(), width=0.085)
        press = spring_fruit(self.scene.gripper, 0.08)

        def feel(now: float) -> np.ndarray:
            wrenches = press(now)
            risen = self.scene.tcp[2, 3] - a_grasp().T_base_grasp[2, 3]
            hangs = min(
                max(risen / 2e-3, 0.0), 1.0
            )  # the load passes from the table within two millimetres
            borne = min(hangs * weight, 2.0 * mu * -wrenches[0, 2])
            wrenches[:, 0] += 0.5 * borne
            wrenches[:, 5] += 0.5 * borne * lever * np.array([1.0, -1.0])
            return wrenches

        self.scene.fingers.feel = feel
        self.scene.pads = finger_pads(mu, 0.0)
        inputs = {"max_force": 8.0}
        held = drive(SlipAvoidGrasp(), inputs, self.scene.devices, clock=self.scene.clock)
        hold = held.outputs["hold"]
        assert isinstance(hold, Hold)
        self.hold = hold

    def lift(self, settle_within: float = 0.0, **settings: Any) -> SkillEnd:
        inputs = {"hold": self.hold, "acceleration": 0.5, "settle_within": settle_within}
        return drive(Lift(), inputs, self.scene.devices, clock=self.scene.clock, **settings)

    @property
    def risen(self) -> float:
        return float(self.scene.tcp[2, 3] - a_grasp().T_base_grasp[2, 3])


def test_a_load_that_the_grip_can_hold_is_lifted_without_a_stop():
    fruit = Standing(weight=2.0)
    outcome = fruit.lift()
    assert outcome.status is Status.SUCCESS
    assert len(fruit.scene.arm.followed) == 1


def test_pads_that_keep_some_load_do_not_make_a_standing_fruit_hang():
    fruit = Standing(weight=2.0)
    feel = fruit.scene.fingers.feel

    def kept(now: float) -> np.ndarray:
        wrenches = feel(now)
        wrenches[:, 0] += 0.2  # of the pads that have slid
        return wrenches

    fruit.scene.fingers.feel = kept
    modes = []
    inputs = {"hold": fruit.hold, "height": 0.003, "speed": 0.001}
    outcome = drive(
        Lift(), inputs, fruit.scene.devices, clock=fruit.scene.clock,
        each_tick=lambda *_: modes.append((fruit.risen > 4e-4, fruit.hold.mode)),
    )  # fmt: skip
    assert outcome.status is Status.SUCCESS
    assert (False, GripMode.CARRIED) not in modes
    assert modes[-1] == (True, GripMode.CARRIED)


def test_at_the_top_it_waits_until_the_grip_has_come_to_rest_and_no_longer():
    up = Standing(weight=2.0).lift().duration
    fruit = Standing(weight=2.0)
    outcome = fruit.lift(settle_within=3.0)
    assert outcome.status is Status.SUCCESS
    assert up + 0.1 < outcome.duration < up + 1.5
    assert fruit.hold.is_at_rest


def test_a_fruit_that_creeps_is_watched_for_as_long_as_is_allowed():
    up = Standing(weight=2.0).lift().duration
    fruit = Standing(weight=2.0)
    feel, since = fruit.scene.fingers.feel, fruit.scene.clock.now()

    def creep(now: float) -> np.ndarray:
        wrenches = feel(now)
        place = 2e-3 * (now - since)
        wrenches[:, 4] += np.array([1.0, MIRROR[4]]) * place * -wrenches[:, 2]
        return wrenches

    fruit.scene.fingers.feel = creep
    assert fruit.lift(settle_within=0.8).duration == pytest.approx(up + 0.8, abs=0.05)


@pytest.mark.parametrize(("lever", "code"), [(0.0, "TOO_HEAVY"), (0.03, "FORCE_LIMIT")])
def test_a_fruit_that_needs_more_than_the_allowed_force_is_put_back_before_it_hangs(
    lever: float, code: str
):
    fruit = Standing(weight=20.0 if lever == 0.0 else 2.5, lever=lever)
    highest = 0.0

    def watch(_tick: int) -> None:
        nonlocal highest
        highest = max(highest, fruit.risen)

    outcome = fruit.lift(each_tick=watch)
    assert outcome.reason.code == code
    assert "put back where it stood" in outcome.reason.message
    assert outcome.reason.data["wanted_force_n"] > outcome.reason.data["limit_n"] == 8.0
    assert highest < 0.03
    assert fruit.risen == pytest.approx(0.0, abs=1e-3)
    assert fruit.scene.arm.settled()
    assert something_between(
        fruit.scene.gripper, fruit.scene.fingers
    )  # it is let go by whoever comes next


def test_a_fruit_that_slips_out_of_fingers_that_press_no_more_is_put_back():
    fruit = Standing(weight=0.0)
    pressed = fruit.scene.fingers.feel(0.0)[:, 2]
    feel = fruit.scene.fingers.feel

    def weak(now: float) -> np.ndarray:
        """The weight comes, but however the fingers close, they press as they did."""
        wrenches = feel(now)
        wrenches[:, 2] = pressed
        wrenches[:, 0] += 1.6 * min(max(fruit.risen / 2e-3, 0.0), 1.0)
        return wrenches

    fruit.scene.fingers.feel = weak
    outcome = fruit.lift()
    assert outcome.reason.code == "SLIPPED"
    assert "put back where it stood" in outcome.reason.message
    assert fruit.risen == pytest.approx(0.0, abs=1e-3)


def test_a_load_that_is_too_much_for_a_moment_only_is_borne():
    fruit = Standing(weight=2.0)
    feel = fruit.scene.fingers.feel

    def jolt(tick: int) -> None:
        loaded = 10 <= tick <= 11
        fruit.scene.fingers.feel = (
            (lambda now: feel(now) + np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0])) if loaded else feel
        )

    assert fruit.lift(each_tick=jolt).status is Status.SUCCESS


def test_a_wall_that_lets_go_of_the_fruit_again_ends_no_lift():
    fruit = Standing(weight=2.0)
    feel, begun = fruit.scene.fingers.feel, []

    def wall(_tick: int) -> None:
        """Its friction pulls until the arm has gone 20 mm up."""
        begun.extend([True] if fruit.risen > 0.005 else [])
        pulls = bool(begun) and fruit.risen < 0.02
        fruit.scene.fingers.feel = (
            (lambda now: feel(now) + np.array([2.5, 0, 0, 0, 0, 0])) if pulls else feel
        )

    outcome = fruit.lift(each_tick=wall)
    assert begun
    assert outcome.status is Status.SUCCESS
    presses = {entry.about: entry.press for topic, entry in outcome.published if topic == "account"}
    assert presses["a wall or a neighbour"] > 0.5, "of a large apple; 1.8 of one that was measured"
    assert len(fruit.scene.arm.followed) == 2
    assert fruit.risen == pytest.approx(0.15, abs=1e-3)


def test_a_fruit_that_falls_while_it_is_put_back_is_lost_and_not_reported_as_put_back():
    fruit = Standing(weight=20.0)
    highest = 0.0

    def drop(_tick: int) -> None:
        nonlocal highest
        highest = max(highest, fruit.risen)
        if highest - fruit.risen > 5e-4:  # on the way down
            fruit.scene.fingers.feel = lambda _now: np.zeros((2, 6))

    outcome = fruit.lift(each_tick=drop)
    assert outcome.reason.code == "LOST"
    assert "put back where it stood" not in outcome.reason.message
    assert fruit.scene.arm.settled()


def test_a_fruit_that_slid_down_in_the_fingers_is_not_pressed_into_the_table():
    fruit = Standing(weight=20.0)
    feel, highest, pressed = fruit.scene.fingers.feel, 0.0, []

    def carried(now: float) -> np.ndarray:
        """From 4 mm on the table carries the fruit, with 1 N for each millimetre further down."""
        wrenches = feel(now)
        wrenches[:, 0] -= 500.0 * max(0.004 - fruit.risen, 0.0)
        return wrenches

    def slide(_tick: int) -> None:
        nonlocal highest
        highest = max(highest, fruit.risen)
        if highest - fruit.risen > 5e-4 and fruit.risen > 0.004:  # on the way down
            fruit.scene.fingers.feel = carried
        if fruit.scene.fingers.feel is carried:
            pressed.append(-fruit.scene.fingers.feel(0.0)[:, 2].sum())

    outcome = fruit.lift(each_tick=slide)
    assert outcome.reason.code == "TOO_HEAVY"
    assert "put back where it stood" in outcome.reason.message
    assert 0.001 < fruit.risen < 0.004
    assert max(pressed) < pressed[0] + 0.5


def test_pads_that_have_slid_up_over_a_fruit_that_stands_are_not_driven_down_over_it():
    fruit = Standing(weight=20.0)
    feel, last, highest = fruit.scene.fingers.feel, 0.0, 0.0

    def slid_up(now: float) -> np.ndarray:
        """The pads' edges close over the fruit's top: they press it down, and it presses them up."""
        wrenches = feel(now)
        wrenches[:, 0] = -1.0
        return wrenches

    def slide(_tick: int) -> None:
        nonlocal last, highest
        if highest > 2e-3 and fruit.risen - last < 2e-4:  # the arm stops
            fruit.scene.fingers.feel = slid_up
        last, highest = fruit.risen, max(highest, fruit.risen)

    outcome = fruit.lift(each_tick=slide)
    assert fruit.scene.fingers.feel is slid_up
    assert outcome.reason.code == "TOO_HEAVY"
    assert "put back where it stood" in outcome.reason.message
    assert highest - fruit.risen < 1e-3
    assert fruit.scene.arm.settled()


def test_inertia_while_the_arm_speeds_up_is_no_table():
    fruit = Standing(weight=2.0)
    feel, highest, down = fruit.scene.fingers.feel, 0.0, False

    def slips_up_there(now: float) -> np.ndarray:
        """Too much hangs on it from 40 mm on; lowered, it weighs 0.6 N less until the arm goes steadily."""
        wrenches = feel(now)
        wrenches[:, 0] += 20.0 if not down and fruit.risen > 0.04 else 0.0
        wrenches[:, 0] -= 0.3 if down and fruit.risen > 0.02 else 0.0
        return wrenches

    def look(_tick: int) -> None:
        nonlocal highest, down
        highest = max(highest, fruit.risen)
        down = down or highest - fruit.risen > 5e-4

    fruit.scene.fingers.feel = slips_up_there
    outcome = fruit.lift(each_tick=look)
    assert highest > 0.04
    assert "put back where it stood" in outcome.reason.message
    assert fruit.risen < 2e-3


def test_without_a_path_back_it_reports_that_the_fruit_is_still_up(monkeypatch: pytest.MonkeyPatch):
    fruit = Standing(weight=20.0)

    def only_up(robot, q, T_base_goal):
        line = straight_line(robot, q, T_base_goal)
        return (
            line
            if T_base_goal[2, 3] > robot.tcp(q)[2, 3]
            else replace(line, reason="a limit is reached")
        )

    monkeypatch.setattr("pomona.skills.shared.carrying.straight_line", only_up)
    outcome = fruit.lift()
    assert outcome.reason.code == "TOO_HEAVY"
    assert "mm up, with no straight way back" in outcome.reason.message
    assert fruit.risen > 1e-3
    assert fruit.scene.arm.settled()
    assert fruit.hold.holds


def test_interrupted_while_it_is_put_back_it_stops_and_holds():
    fruit = Standing(weight=20.0)
    outcome = fruit.lift(interrupt_after=22)
    assert outcome.status is Status.INVALID
    assert fruit.scene.arm.settled()
    assert fruit.hold.holds


# ------------------------------------------------------------------------------------ without a force sensor


@pytest.mark.parametrize("motor_force", [5.0, None])
def test_plain_fingers_lift_what_stopped_them(motor_force: float | None):
    scene = PickingScene(q=q_at_grasp().copy(), width=0.085)
    scene.grip_plainly(motor_force)
    before = scene.tcp
    outcome = drive(
        Lift(), {"height": 0.15, "hold_time": 0.5}, scene.without_sensor, clock=scene.clock
    )
    assert outcome.status is Status.SUCCESS
    np.testing.assert_allclose(scene.tcp[:3, 3], before[:3, 3] + [0.0, 0.0, 0.15], atol=1e-6)


def test_plain_fingers_that_nothing_stopped_lift_nothing():
    scene = PickingScene(q=q_at_grasp().copy(), width=0.085)
    outcome = drive(Lift(), {}, scene.without_sensor, clock=scene.clock)
    assert outcome.reason.code == "NOT_HELD"
    assert outcome.reason.data["width_m"] == 0.085
    assert scene.arm.followed == []


def test_a_fruit_that_falls_from_plain_fingers_is_lost_as_soon_as_the_motor_presses_no_more():
    scene = PickingScene(q=q_at_grasp().copy(), width=0.085)
    scene.grip_plainly()
    devices = scene.without_sensor
    outcome = drive(
        Lift(),
        {},
        devices,
        clock=scene.clock,
        each_tick=lambda tick: scene.drop_plainly() if tick == 20 else None,
    )
    assert outcome.reason.code == "LOST"
    assert "the gripper's motor pressed with 5.0 N and presses no more" in outcome.reason.message
    assert outcome.reason.data["motor_force_n"] == 0.0
    assert scene.arm.settled()
    assert scene.tcp[2, 3] < ROBOT_MODEL.tcp(q_at_grasp())[2, 3] + 0.14


@pytest.mark.parametrize("width", [0.085 - 0.011, 0.085 + 0.011, 0.036, float("nan")])
def test_a_fruit_that_leaves_plain_fingers_without_a_motor_force_is_lost_by_their_width(
    width: float,
):
    scene = PickingScene(q=q_at_grasp().copy(), width=0.085)
    scene.grip_plainly(None)
    devices = scene.without_sensor

    def lose(tick: int) -> None:
        if tick == 20:
            scene.gripper.blocked_at, scene.gripper.width = 0.0, width

    outcome = drive(Lift(), {}, devices, clock=scene.clock, each_tick=lose)
    assert outcome.reason.code == "LOST"


def test_interrupted_with_plain_fingers_the_arm_stops_and_nothing_opens():
    scene = PickingScene(q=q_at_grasp().copy(), width=0.085)
    scene.grip_plainly()
    moves = len(scene.gripper.moves)
    outcome = drive(Lift(), {}, scene.without_sensor, clock=scene.clock, interrupt_after=20)
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    assert len(scene.gripper.moves) == moves
