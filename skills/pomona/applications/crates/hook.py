"""The skill Hook."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.applications.crates.pull import ENOUGH, FARTHEST_OFF, LEAST, RELIEF, HookPull
from pomona.drivers import Arm, ForceSensor, Gripper, Motion, Workspace
from pomona.executive import FORCE, LENGTH, SPEED, Force, Length, Outputs, Port, SkillFailure, Speed, Work
from pomona.skills import (
    MOTION_FAILURES,
    Manner,
    MovingSkill,
    Touch,
    follow_way,
    prepare_moving,
    tool_pose,
    vertical_way,
)
from pomona.skills.motion import Grasp, RobotModel, fruit_points, gripper_shape, straight_line

START = 0.01
"""How far the TCP may stand from the place over the fruit [m]."""
DOWN = Manner(0.05, 0.5, 5.0)
"""Way down beside the wall, above the fruit's crown."""
TOUCHING = Manner(0.010, 0.5, 10.0)
"""Way down beside the fruit: a contact is 5 to 10 N/mm, and the fingers report after some 10 ms."""
UP = Manner(0.10, 1.0, 10.0)
ABOVE = 0.010
"""Height of the fingers' tips over the crown at which they slow down [m]."""


class Drawn(Outputs):
    """Outputs of Hook."""

    moved: Annotated[Length, Port(help="distance of the pull")]


class Hook(MovingSkill):
    """Draw a fruit away from a wall with one finger: down beside the wall until it touches, then across, then up.

    The fruit has moved afterwards: look again.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    moves = (Arm,)
    failures = (
        *MOTION_FAILURES,
        "NOT_AT_PRE_GRASP",
        "NO_STRAIGHT_LINE",
        "PULL_BLOCKED",
        "NOTHING_MOVED",
        "SENSOR_STALE",
    )

    def prepare(self) -> None:
        prepare_moving(self)

    def run(
        self,
        hook: Annotated[Grasp, Port(help="one of SampleHook's, at which the arm stands")],
        touch: Annotated[Force, Port(min="0.3 N", max="2 N", help="that ends the way down")] = FORCE("0.5 N"),
        force: Annotated[Force, Port(min="0.5 N", max="5 N", help="that ends the pull")] = FORCE("2 N"),
        distance: Annotated[Length, Port(min="10 mm", max="100 mm", help="of the pull")] = LENGTH("45 mm"),
        speed: Annotated[Speed, Port(min="5 mm/s", max="30 mm/s", help="of the pull")] = SPEED("0.015 m/s"),
    ) -> Work[Drawn]:
        before = tool_pose(self)
        apart = float(np.linalg.norm(before[:3, 3] - hook.T_base_pre_grasp[:3, 3]))
        if apart > START:
            words = f"the gripper stands {1e3 * apart:.0f} mm from the place over the fruit: follow a path to it first"
            raise self.failure("NOT_AT_PRE_GRASP", words)
        try:
            with Touch(self.device(ForceSensor)) as felt:
                yield from self._down(hook, felt, touch)
                moved = yield from self._across(hook, felt, force, distance, speed)
        except SkillFailure as failed:
            if failed.failure.code in ("PULL_BLOCKED", "NOTHING_MOVED", "NO_STRAIGHT_LINE"):
                yield from self._up(before)
            raise
        yield from self._up(before)
        return Drawn(moved)

    def _down(self, hook: Grasp, felt: Touch, limit: float) -> Work[None]:
        """Go down beside the wall until a finger touches the fruit's flank, or to the lowest place."""
        start, end = hook.T_base_pre_grasp[2, 3], hook.T_base_grasp[2, 3]
        robot = RobotModel.load(self.device(Arm).description)
        tips = start - float(gripper_shape(robot).points[:, 2].max())
        fast = tips - float(fruit_points(hook.fruit)[:, 2].max()) - ABOVE
        yield from self._felt(vertical_way(self, -fast, "NO_STRAIGHT_LINE"), DOWN, felt, limit)
        yield from self._felt(vertical_way(self, fast + end - start, "NO_STRAIGHT_LINE"), TOUCHING, felt, limit)
        yield from self._give_way(felt, limit, 0.0)

    def _across(self, hook: Grasp, felt: Touch, limit: float, distance: float, speed: float) -> Work[float]:
        """Draw the fruit as it rolls, and return how far the finger came [m]; between steps the finger gives way."""
        pull = HookPull(hook, tool_pose(self)[:3, 3], limit)
        for x, place in pull.places(distance):
            felt.forget_change()
            at_limit = yield from self._felt(self._line(place), Manner(speed, 0.5, 10.0), felt, limit)
            pull.off = yield from self._give_way(felt, 0.5 * limit, pull.off)
            if pull.ends(x, at_limit, felt.change, felt.present):
                if pull.came >= ENOUGH:
                    return pull.came
                raise self.failure("PULL_BLOCKED", pull.blocked, moved_m=pull.came, force_n=pull.most)
        if pull.most < LEAST:
            raise self.failure("NOTHING_MOVED", "the finger touched nothing on its way: the fruit lies elsewhere")
        return pull.came

    def _give_way(self, felt: Touch, most: float, off: float) -> Work[float]:
        """Rise until the fruit presses less than `most` [N], never sink: only the pads feel. Return the height."""
        while felt.present > most and off + RELIEF <= FARTHEST_OFF:
            yield from follow_way(self, self._line(tool_pose(self)[:3, 3] + [0.0, 0.0, RELIEF]), TOUCHING)
            off += RELIEF
        return off

    def _line(self, p_goal: np.ndarray) -> np.ndarray:
        """Return postures straight to a place of the tool, shape (n, dof)."""
        arm, goal = self.device(Arm), tool_pose(self)
        goal[:3, 3] = p_goal
        line = straight_line(RobotModel.load(arm.description), arm.state().q, goal)
        if not line.complete:
            raise self.failure("NO_STRAIGHT_LINE", f"the pull cannot be followed: {line.reason}")
        return line.q

    def _felt(self, way: np.ndarray, manner: Manner, felt: Touch, limit: float) -> Work[bool]:
        """Follow a way until the fingers' force has changed by a limit [N]; return True if it has."""

        def look() -> None:
            if stale := felt.stale_for(self.clock.now()):
                raise self.failure("SENSOR_STALE", f"the fingers have sent no force for {1e3 * stale:.0f} ms")

        def stop_at_touch(motion: Motion) -> None:
            felt.at_change(limit, motion.stop)

        if felt.change > limit:
            return True
        try:
            yield from follow_way(self, way, manner, look, started=stop_at_touch)
        except SkillFailure as failed:
            if failed.failure.code != "STOPPED" or felt.change <= limit:
                raise
            return True
        return False

    def _up(self, before: np.ndarray) -> Work[None]:
        rise = float(before[2, 3] - tool_pose(self)[2, 3])
        if rise > 0.0:
            yield from follow_way(self, vertical_way(self, rise, "NO_STRAIGHT_LINE"), UP)
