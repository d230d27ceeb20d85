"""Straight motions of the tool that skills share."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pomona.drivers.interfaces import Arm, Motion
from pomona.executive.values.arrays import Float64
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.lines import StraightLine, straight_line
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel
from pomona.skills.shared.following import MovingSkill, Watching

LEAST_POSTURES = 4  # fewer postures give no path that can be timed


class Manner(NamedTuple):
    """Limits of a motion of the tool."""

    speed: float  # [m/s]
    acceleration: float  # [m/s²]
    jerk: float  # [m/s³]


def tool_pose(skill: MovingSkill) -> Float64:
    """Return T_base_tcp of the arm as it stands, shape (4, 4)."""
    arm = skill.device(Arm)
    return RobotModel.load(arm.description).tcp(arm.state().q)


def free_line(
    skill: MovingSkill,
    T_base_goal: Float64,
    space: ArmSpace,
    codes: tuple[str, str],
    words: str,
    **data: object,
) -> StraightLine:
    """Return the complete and free straight line of the tool to a pose.

    Args:
        codes: failure codes of a line that the arm cannot follow, and of one that is blocked.
        words: begins the message of a blocked line, such as "on the way up".
        data: added to the failure.

    Raises SkillFailure: one of the codes; nothing has moved.
    """
    arm = skill.device(Arm)
    line = straight_line(RobotModel.load(arm.description), arm.state().q, T_base_goal)
    reached = line.reached * line.length
    if not line.complete:
        message = f"{line.reason} after {1e3 * reached:.0f} of {1e3 * line.length:.0f} mm"
        raise skill.failure(codes[0], message, **data, reached_m=reached)
    blocked = space.first_blocked(line.q)
    if blocked is not None:
        reason, found = space.explain(line.q[blocked + 1])
        raise skill.failure(codes[1], f"{words} {reason}", **data, **found)
    return line


def vertical_way(
    skill: MovingSkill, rise: float, code: str, space: ArmSpace | None = None
) -> Float64:
    """Return postures straight up, or down for a negative rise [m], as far as the arm reaches, shape (n, dof).

    They end before obstacles of a space; None on a way that the arm has just come.

    Raises SkillFailure: the code; nothing has moved.
    """
    arm = skill.device(Arm)
    T_base_goal = tool_pose(skill)
    T_base_goal[2, 3] += rise
    line = straight_line(RobotModel.load(arm.description), arm.state().q, T_base_goal)
    way = line.q
    reason = line.reason
    blocked = None if space is None else space.first_blocked(way)
    if space is not None and blocked is not None:
        way, reason = way[: blocked + 1], space.explain(way[blocked + 1])[0]
    if len(way) < LEAST_POSTURES:
        raise skill.failure(code, f"the gripper cannot move vertically: {reason}")
    return way


def follow_way(
    skill: MovingSkill,
    way: Float64,
    manner: Manner,
    watch: Callable[[], str | None] | None = None,
    held: Grasp | None = None,
    started: Callable[[Motion], None] | None = None,
    most: Float64 | None = None,
) -> Watching:
    """Follow postures on a straight line of the tool, shape (n, dof) [rad].

    `watch`: see `following.follow_motion`; `held` is the grasp by which a fruit is held; `started` is called with the
    motion; `most`: see `time_curve`.
    """
    arm = skill.device(Arm)
    robot = RobotModel.load(arm.description)
    length = float(np.linalg.norm(robot.tcp(way[-1])[:3, 3] - robot.tcp(way[0])[:3, 3]))
    if length > 0.0:
        curve = time_curve(way, length, arm.limits, *manner, most=most)
        yield from skill.travel(curve, watch, carrying=held, started=started)
