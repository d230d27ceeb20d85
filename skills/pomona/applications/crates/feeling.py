"""The common part of the manoeuvres: a hand over a fruit that feels its way down, across and up again.

Pads feel on their inner faces, the gripper's motor a push on the outer ones. Tips, backs and the hand feel by a load
sensor at the wrist alone, where the cell has one.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pomona.drivers import Arm, ForceSensor, Gripper, LoadSensor, Motion
from pomona.executive import Float64, SkillFailure, TableView, Work
from pomona.skills import (
    MOTION_FAILURES,
    Manner,
    MovingSkill,
    Touch,
    follow_way,
    tool_pose,
    vertical_way,
)
from pomona.skills.grip import take_over
from pomona.skills.motion import Grasp, RobotModel, straight_line

START = 0.01
START_ANGLE = 0.1
"""How far the TCP may stand from the place over the fruit [m, rad]."""
OPEN = 1e-3
"""Deviation of the opening that is none [m]."""
PUSHED = 2e-3
"""Motion of the resting fingers that shows a push [m]; a gripper's supervisor allows 3 mm."""
REST = 0.15
"""Time after a motion of the fingers until the motor's force shows rest [s]: it brakes them."""
PRESSED = 2.0
"""Force of the motor of resting fingers that shows something at them before a motion [N]."""
UP = Manner(0.10, 1.0, 10.0)
GENTLE = 0.2
"""Acceleration of a hand that feels its way [m/s²]: a sensor at the wrist measures the inertia of 1.5 kg by 0.3 N."""
SHIFTING = Manner(0.006, GENTLE, 20.0)
"""Way of a hand that is shifted beside a fruit."""
SLOW = 0.012
"""Speed of fingers that close until they feel the fruit [m/s]."""
CLOSING = 0.5e-3
"""Way by which they close in a step [m]."""
SETTLE = 0.06
"""Time over which the fingers' force is averaged [s]."""
FELT = 0.3
"""Force of a pad that counts as a touch [N]; the fingers' noise is 0.2 N."""

LATEST = 8
"""Number of ways whose forces the page shows."""

FEELING_FAILURES = (*MOTION_FAILURES, "NO_STRAIGHT_LINE", "SENSOR_STALE")
OVER_FAILURES = (*FEELING_FAILURES, "NOT_AT_PRE_GRASP", "CONTACT")
"""Failures of a manoeuvre that begins over the fruit."""


Forces = tuple[Float64, Float64 | None]


class OuterFaces:
    """Pushes on the resting fingers, by the gripper's motor and width: outer faces have no sensor of their own."""

    def __init__(self, gripper: Gripper) -> None:
        self._gripper, state = gripper, gripper.state()
        self._opened = state.width
        self._resting = state.motor_force or 0.0

    @property
    def moved(self) -> float:
        """How far the fingers were pushed [m]."""
        return abs(self._gripper.state().width - self._opened)

    @property
    def force(self) -> float:
        """Force that pushes the fingers together [N]; 0 where the gripper does not report its motor's."""
        now = self._gripper.state().motor_force
        return 0.0 if now is None else max(self._resting - now, 0.0)

    def pushed(self, limit: float) -> bool:
        """Return True if a force [N], or a motion of the fingers, shows a push."""
        return self.force > limit or self.moved > PUSHED


class ManoeuvreHand(NamedTuple):
    """The senses of a manoeuvre.

    Attributes:
        wrist: None in a cell without a load sensor.
        R_tool_tcp: orientation of the hand in the frame of that sensor, shape (3, 3).
        free: forces of a hand that touches nothing; None until they are measured.
        bears: force of the fingers' edges that ends a way [N].
    """

    pads: Touch
    outer: OuterFaces
    wrist: Touch | None = None
    R_tool_tcp: Float64 = np.eye(3)
    free: Forces | None = None
    bears: float = math.inf

    def touching_nothing(self, bears: float = math.inf) -> ManoeuvreHand:
        """Return these senses with the forces of now as those of a free hand."""
        return self._replace(free=self.forces, bears=bears)

    def forget_change(self) -> None:
        """Start the largest changes again."""
        self.pads.forget_change()
        if self.wrist is not None:
            self.wrist.forget_change()

    @property
    def change(self) -> float:
        """Largest change of a pad's force, or of the whole hand's beyond the sensor's error [N]."""
        return max(
            self.pads.change, 0.0 if self.wrist is None else self.wrist.change - self.at_rest
        )

    @property
    def present(self) -> float:
        """How much a pad's force, or the whole hand's, differs from the beginning now [N]."""
        return max(
            self.pads.present, 0.0 if self.wrist is None else self.wrist.present - self.at_rest
        )

    @property
    def at_rest(self) -> float:
        """Change that the wrist's sensor shows by its errors and the hand's inertia alone [N]."""
        return 0.0 if self.wrist is None else self.wrist.limit(0.0, GENTLE)

    @property
    def edges(self) -> float:
        """Force that the wrist feels and the pads do not: of the fingers' edges, and the sensors' errors [N]; or 0."""
        if self.wrist is None or self.free is None or self.free[1] is None:
            return 0.0
        left, right = self.pads.average() - self.free[0]
        by_pads = np.array(
            [right[1] - left[1], right[2] - left[2], left[0] + right[0]]
        )  # in the hand's frame
        by_all = self.R_tool_tcp.T @ (self.wrist.average() - self.free[1])[0]
        return float(np.linalg.norm(by_all - by_pads))

    @property
    def forces(self) -> Forces:
        """Forces now of the pads, shape (2, 3), and at the wrist, shape (1, 3), if it has a sensor [N]."""
        return self.pads.average(), None if self.wrist is None else self.wrist.average()

    @property
    def downwards(self) -> float:
        """Force by which the hand presses along its approach [N].

        The pads feel it along their faces, the wrist that of the fingers' edges too.
        """
        assert self.free is not None
        pads, wrist = self.forces
        by_pads = -float((pads - self.free[0])[:, 0].sum())
        if wrist is None or self.free[1] is None:
            return by_pads
        return max(by_pads, -float((wrist - self.free[1])[0, 2]) - self.at_rest)

    def stop_at(self, limit: float, stop: Callable[[], None]) -> None:
        """Call `stop` in the sensors' own loops when `change` exceeds a limit [N]."""
        self.pads.at_change(limit, stop)
        if self.wrist is not None:
            self.wrist.at_change(limit + self.at_rest, stop)


class _Pushed(Exception):
    """Something pushes the fingers from outside, or their edges."""


class FeelingSkill(MovingSkill):
    """A skill that feels with pads, motor, width and wrist; its failures: `FEELING_FAILURES`."""

    optional_devices = (*MovingSkill.optional_devices, LoadSensor)
    _ways: tuple[tuple[str, ...], ...] = ()

    def stand_over(self, grasp: Grasp) -> Work[Float64]:
        """Require the hand at the pre-grasp, open the fingers as the grasp needs them, and return T_base_tcp, (4, 4).

        Raises SkillFailure: NOT_AT_PRE_GRASP; CONTACT, if something keeps the fingers from it or pushes them; the arm
        has not moved.
        """
        gripper = self.device(Gripper)
        pose = tool_pose(self)
        apart = float(np.linalg.norm(pose[:3, 3] - grasp.T_base_pre_grasp[:3, 3]))
        cosine = (float(np.trace(pose[:3, :3].T @ grasp.T_base_pre_grasp[:3, :3])) - 1.0) / 2.0
        angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        if apart > START or angle > START_ANGLE:
            words = f"the gripper stands {1e3 * apart:.0f} mm and {np.degrees(angle):.0f}° from the place over the fruit"
            raise self.failure("NOT_AT_PRE_GRASP", f"{words}: follow a path to it first")
        width = min(grasp.width, gripper.limits.width_max)
        if abs(gripper.state().width - width) > OPEN:
            take_over(gripper)
            try:
                yield from self.move_fingers(width, gripper.limits.speed_max)
            except SkillFailure as failed:
                if failed.failure.code != "MOTION_FAILED":
                    raise
                raise self.failure(
                    "CONTACT", f"over the fruit {failed.failure.message}"
                ) from failed
            yield from self.wait(REST)
        force = gripper.state().motor_force or 0.0
        if abs(force) > PRESSED:
            words = f"something pushes the fingers with {abs(force):.1f} N over the fruit; the arm has not moved"
            raise self.failure("CONTACT", words, force_n=force)
        return pose

    def feel_way(
        self, way: Float64, manner: Manner, hand: ManoeuvreHand, felt: float, outer: float
    ) -> Work[bool]:
        """Follow a way until `felt` [N] changes, or `outer` [N] pushes the outer faces; return True if it was ended.

        Raises SkillFailure: SENSOR_STALE, or a failure of the motion.
        """
        begin = tool_pose(self)[:3, 3]
        ended = yield from self._feel_way(way, manner, hand, felt, outer)
        self._show(tool_pose(self)[:3, 3] - begin, hand, ended)
        return ended

    def _show(self, way: Float64, hand: ManoeuvreHand, ended: bool) -> None:
        """Publish the latest ways with their forces, the newest first; `way` is the last one, shape (3,) [m]."""
        across = float(np.linalg.norm(way[:2]))
        up = float(way[2])
        where = "across" if across > abs(up) else "down" if up < 0.0 else "up"
        length = f"{1e3 * max(across, abs(up)):.0f} mm {where}"
        row = (
            self.name,
            length,
            f"{hand.change:.1f} N",
            f"{hand.outer.force:.1f} N",
            "a touch" if ended else "its end",
        )
        self._ways = (row, *self._ways[: LATEST - 1])
        self.publish(
            "manoeuvre",
            TableView(("manoeuvre", "way", "felt", "on outer faces", "ended by"), self._ways),
        )

    def _feel_way(
        self, way: Float64, manner: Manner, hand: ManoeuvreHand, felt: float, outer: float
    ) -> Work[bool]:
        def look() -> None:
            self.require_fresh(hand)
            touches = hand.change > felt or hand.edges > hand.bears
            if touches or hand.outer.pushed(outer):
                raise _Pushed

        def stop_at_touch(motion: Motion) -> None:
            hand.stop_at(felt, motion.stop)

        if hand.change > felt or hand.outer.pushed(outer):
            return True
        try:
            yield from follow_way(self, way, manner, look, started=stop_at_touch)
        except _Pushed:
            return True
        return False

    def centre(
        self,
        hand: ManoeuvreHand,
        offset: Float64,
        limit: float,
        steps: int,
        place: Callable[[Float64], Float64 | None],
    ) -> Work[bool]:
        """Close until both pads feel the fruit, shifting the hand towards the one that feels it alone.

        Args:
            offset: wrenches of pads that touch nothing, as in `WrenchSample`, shape (2, 3) or wider [N].
            limit: force that ends a step [N].
            steps: of the hand or the fingers, at most.
            place: maps the pads' normal forces, shape (2,) [N], negative where they press, to the next place of the
                tool, shape (3,) [m]; None to close further.

        Returns:
            Whether both feel it.
        """
        gripper = self.device(Gripper)
        before = 0.0
        blocked = False
        for _ in range(steps):
            self.require_fresh(hand)
            pressed = (hand.pads.average() - offset)[:, 2]
            if (pressed < -FELT).all():
                return True
            side = float(np.sign(pressed[1] - pressed[0]))
            where = place(pressed)
            if where is not None and (
                blocked or side != -before
            ):  # else the last shift went past the fruit
                before = side
                blocked = False
                shifting = hand._replace(outer=OuterFaces(gripper))
                yield from self.feel_way(self.line_to(where), SHIFTING, shifting, limit, limit)
            elif blocked:
                break
            else:
                before = 0.0
                blocked = not (yield from self._close(gripper.state().width - CLOSING))
            yield from self.wait(SETTLE)
            hand.forget_change()
        return False

    def _close(self, width: float) -> Work[bool]:
        """Close to an opening [m]; return False if the fruit keeps the fingers from it."""
        try:
            yield from self.move_fingers(max(width, self.device(Gripper).limits.width_min), SLOW)
        except SkillFailure as failed:
            if failed.failure.code != "MOTION_FAILED":
                raise
            return False
        return True

    def require_fresh(self, hand: ManoeuvreHand) -> None:
        """Raise SkillFailure SENSOR_STALE if the fingers feel nothing any more."""
        if stale := hand.pads.stale_for(self.clock.now()):
            raise self.failure(
                "SENSOR_STALE", f"the fingers have sent no force for {1e3 * stale:.0f} ms"
            )
        if hand.wrist is not None and (stale := hand.wrist.stale_for(self.clock.now())):
            raise self.failure(
                "SENSOR_STALE", f"the load sensor has sent no force for {1e3 * stale:.0f} ms"
            )

    @contextlib.contextmanager
    def feeling(self) -> Iterator[ManoeuvreHand]:
        """Give the senses, which compare with the forces of now."""
        load = self.optional_device(LoadSensor)
        with contextlib.ExitStack() as open_:
            pads = open_.enter_context(Touch(self.device(ForceSensor)))
            wrist = None if load is None else open_.enter_context(Touch(load))
            R_tool_tcp = RobotModel.load(self.device(Arm).description).T_tool_tcp[:3, :3]
            yield ManoeuvreHand(pads, OuterFaces(self.device(Gripper)), wrist, R_tool_tcp)

    def line_to(self, p_goal: Float64) -> Float64:
        """Return postures straight to a place of the tool, shape (3,) [m] -> (n, dof) [rad]."""
        return straight_to(self, p_goal)

    def rise_to(self, before: Float64) -> Work[None]:
        """Go straight up to the height of a pose, shape (4, 4)."""
        rise = float(before[2, 3] - tool_pose(self)[2, 3])
        if rise > 1e-4:
            yield from follow_way(self, vertical_way(self, rise, "NO_STRAIGHT_LINE"), UP)


def straight_to(skill: MovingSkill, p_goal: Float64) -> Float64:
    """Return postures straight to a place of the tool, shape (3,) [m] -> (n, dof) [rad].

    Raises SkillFailure: NO_STRAIGHT_LINE; nothing has moved.
    """
    arm = skill.device(Arm)
    goal = tool_pose(skill)
    goal[:3, 3] = p_goal
    line = straight_line(RobotModel.load(arm.description), arm.state().q, goal)
    if not line.complete:
        raise skill.failure("NO_STRAIGHT_LINE", f"the way cannot be followed: {line.reason}")
    return line.q


def as_it_stands(grasp: Grasp, T_base_tcp: Float64) -> Grasp:
    """Return a grasp where the hand stands, T_base_tcp (4, 4): the fruit is between the fingers as it was planned."""
    shift = T_base_tcp[:3, 3] - grasp.T_base_grasp[:3, 3]
    T_base_fruit = grasp.fruit.T_base_fruit.copy()
    T_base_over = grasp.T_base_pre_grasp.copy()
    T_base_fruit[:2, 3] += shift[:2]
    T_base_over[:2, 3] += shift[:2]
    fruit = replace(grasp.fruit, T_base_fruit=T_base_fruit)
    return replace(grasp, T_base_pre_grasp=T_base_over, T_base_grasp=T_base_tcp, fruit=fruit)
