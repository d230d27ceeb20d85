"""Grasps of a fruit that hangs before the arm: approach, grip and roll free of collision, best first."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pomona.executive import Float64
from pomona.skills import rot_z, transform
from pomona.skills.motion import (
    ArmSpace,
    CandidateRejected,
    Grasp,
    GraspRules,
    RobotModel,
    RuledOut,
    Sphere,
    grasp_setting,
    judge_candidate,
    nearest_solution,
    straight_line,
)
from pomona.skills.perception import MeasuredFruit

STEM = 0.025  # length of an apple's stem above its cavity [m]; the simulated wall draws 15 to 35 mm
SEAT = 0.44  # height of the stem's end above the fruit's middle, over the fruit's height: in its cavity
UPRIGHT = 0.5  # least vertical component of a measured stem axis that is used; else the stem is taken as vertical

ROLL_STEP = np.radians(10.0)
DRAWN = 0.03 * np.array([0.0, 0.94, 0.34])
"""Shift of the hand at the end of a roll in the base frame [m]: the pull draws soft branches along."""
JUMP = np.radians(60.0)  # largest step of a joint within `ROLL_STEP`: more is another posture [rad]


@dataclass(frozen=True, slots=True)
class HangingRules:
    """Directions from which a hanging fruit is approached, in the order of preference.

    Attributes:
        elevations: of the approach over the level, positive from below [rad].
        azimuths: of the approach from straight along -y [rad].
        turns: of the hand about the approach; 0 closes the fingers from the sides, the camera below [rad].
        before: distance of the pre-grasp [m].
        roll: angle that the hand must be able to roll one way or the other [rad].
        roll_wanted: angle up to which the roll is checked [rad]; roll_good: candidates that reach it are preferred,
            since a stem breaks at 57° to 100° [rad].
        enough: good candidates after which the sampling ends; three times as many of any kind end it, too.
    """

    elevations: tuple[float, ...] = tuple(np.radians([0.0, 20.0, -20.0, 40.0]))
    azimuths: tuple[float, ...] = tuple(np.radians([0.0, 25.0, -25.0, 50.0, -50.0]))
    turns: tuple[float, ...] = tuple(
        np.radians([0.0, 180.0, 25.0, -25.0, 155.0, -155.0, 50.0, -50.0, 90.0, -90.0])
    )
    before: float = 0.10
    roll: float = float(np.radians(70.0))
    roll_wanted: float = float(np.radians(120.0))
    roll_good: float = float(np.radians(100.0))
    enough: int = 4


def knuckle_of(measured: MeasuredFruit) -> Float64:
    """Return the place where a fruit's stem sits on its spur, in the base frame, shape (3,) [m]."""
    up = -measured.T_base_fruit[:3, 1]
    up = up if up[2] > UPRIGHT else np.array([0.0, 0.0, 1.0])
    place: Float64 = (
        measured.T_base_fruit[:3, 3] + (STEM + SEAT * float(measured.dimensions[1])) * up
    )
    return place


def hanging_orientation(azimuth: float, elevation: float, turn: float) -> Float64:
    """Return the axes of the TCP in the base frame, shape (3, 3): z the approach, y the fingers' sliding direction."""
    c = np.cos(elevation)
    z = np.array([np.sin(azimuth) * c, -np.cos(azimuth) * c, np.sin(elevation)])
    y = np.cross(z, [0.0, 0.0, 1.0])
    y /= np.linalg.norm(y)
    R: Float64 = np.stack([np.cross(y, z), y, z], axis=1) @ rot_z(turn)
    return R


def free_roll(
    robot: RobotModel,
    q: Float64,
    p_base_knuckle: Float64,
    way: float,
    most: float,
    space: ArmSpace | None = None,
) -> float:
    """Return how far the hand can roll about its approach through the knuckle in one posture of the arm [rad].

    Args:
        robot: kinematics and limits.
        q: joints at the grasp, shape (dof,) [rad].
        p_base_knuckle: where the stem sits on its spur, shape (3,) [m].
        way: 1 rolls counterclockwise about the approach, -1 clockwise.
        most: angle at which the search ends [rad].
        space: obstacles to keep from; None asks for the joints alone.
    """
    T = robot.tcp(q)
    lever = T[:3, :3].T @ (T[:3, 3] - p_base_knuckle)
    reached = 0.0
    while reached < most - 1e-9:
        angle = min(reached + ROLL_STEP, most)
        R = T[:3, :3] @ rot_z(way * angle)
        drawn = DRAWN * min(angle / 1.0, 1.0) if space is not None else np.zeros(3)
        solved = nearest_solution(robot, transform(R, p_base_knuckle + R @ lever + drawn), q)
        if solved is None or np.abs(solved - q).max() > JUMP:
            break
        if space is not None and not space.free(solved):
            break
        q, reached = solved, angle
    return reached


def sample_hanging(
    measured: MeasuredFruit,
    robot: RobotModel,
    space: ArmSpace,
    q_now: Float64,
    rules: HangingRules | None = None,
    without: frozenset[int] = frozenset(),
) -> tuple[tuple[Grasp, ...], tuple[RuledOut, ...]]:
    """Sample grasps of a hanging fruit that can be approached and rolled.

    Args:
        measured: the refined fruit; its covariance enters as margin.
        robot: kinematics and geometry.
        space: collision checks; the target must be left out of its map, and the fingers allowed near it.
        q_now: where the arm stands, shape (dof,) [rad]; near solutions are preferred.
        rules: directions and the roll that is needed.
        without: numbers of candidates that are not wanted.

    Returns:
        candidates in the order of preference, each with the joint solutions that can roll, and those ruled out.
    """
    rules = rules or HangingRules()
    follow = GraspRules(sigmas=1.0, solutions=6, tried_solutions=40, arm_angles=16)
    setting = grasp_setting(measured, robot, space, q_now, None, Sphere(rules.before), follow)
    knuckle = knuckle_of(measured)
    good: list[Grasp] = []
    others: list[Grasp] = []
    ruled_out: list[RuledOut] = []
    order = product(rules.turns, rules.elevations, rules.azimuths)
    ranked = sorted(enumerate(order), key=lambda each: _effort(*each[1]))
    for index, (turn, elevation, azimuth) in ranked:
        if index in without:
            continue
        theta = float(np.pi / 2.0 + elevation)
        try:
            R_base_tcp = hanging_orientation(azimuth, elevation, turn)
            grasp = judge_candidate(setting, index, theta, azimuth, R_base_tcp)
            grasp, roll = _rolling(grasp, robot, space, knuckle, rules)
            (good if roll >= rules.roll_good else others).append(grasp)
        except CandidateRejected as out:
            ruled_out.append(RuledOut(index, theta, azimuth, out.code, out.reason))
        if len(good) >= rules.enough or len(good) + len(others) >= 3 * rules.enough:
            break
    return tuple(good or others[: rules.enough]), tuple(ruled_out)


def _effort(turn: float, elevation: float, azimuth: float) -> float:
    """Order of directions: level and straight first, the fingers from the sides."""
    return (
        1.0 * abs(elevation)
        + 0.7 * abs(azimuth)
        + 0.8 * min(abs(turn), np.pi - abs(turn))
        + 0.05 * abs(turn)
    )


def _rolling(
    grasp: Grasp, robot: RobotModel, space: ArmSpace, knuckle: Float64, rules: HangingRules
) -> tuple[Grasp, float]:
    """Return the grasp with those joint solutions that can roll furthest one way, and that angle [rad].

    Raises CandidateRejected: none can.
    """
    kept, furthest = [], 0.0
    narrow = space.at_width(float(grasp.fruit.dimensions.max()))
    for q in grasp.q_pre_grasp:
        line = straight_line(robot, q, grasp.T_base_grasp)
        if not line.complete:
            continue
        rolls = [
            free_roll(robot, line.q[-1], knuckle, way, rules.roll_wanted, narrow)
            for way in (1.0, -1.0)
        ]
        furthest = max(furthest, *rolls)
        if max(rolls) >= rules.roll:
            kept.append((max(rolls), q))
    if not kept:
        raise CandidateRejected(
            "ROLL_BLOCKED", f"the hand could roll by {np.degrees(furthest):.0f}° only"
        )
    least = min(furthest, rules.roll_good)
    q_good = np.array(
        [q for roll, q in sorted(kept, key=lambda each: -each[0]) if roll >= least - 1e-6]
    )
    return replace(grasp, q_pre_grasp=q_good), furthest
