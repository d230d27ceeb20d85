"""Grasp candidates on the paper's sphere: what can be reached without touching anything, best first.

Every candidate is followed through: opening against the estimated width, fingers against the table, joint solutions of
the pre-grasp, the straight approach in one arm configuration, and everything on the way against the map. One that fails
is ruled out with the reason of the step at which it came furthest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skills.approach.straight_line import straight_line
from skills.collision.convex import fruit_points
from skills.geometry import transform
from skills.plan.space import Space
from skills.refine.measured_fruit import MeasuredFruit
from skills.robot import RobotModel
from skills.robot.inverse_kinematics import inverse_kinematics
from skills.sample_grasp.fruit_section import FruitSection, fruit_section
from skills.sample_grasp.grasp import Grasp, RuledOut
from skills.sample_grasp.gripper_shape import GripperShape, gripper_shape
from skills.sample_grasp.sphere import Sphere, pre_grasp_orientation

Float64 = NDArray[np.float64]

LINE_STEP = 30e-3
"""Distance of poses along an approach when it is judged [m]; segments between them are checked whole."""


class Surroundings(Protocol):
    """Collision checks for an arm whose fingers are open to a width."""

    def at_width(self, width: float) -> ApproachSpace: ...


class ApproachSpace(Space, Protocol):
    """Collision checks that also say how far away the nearest obstacle is."""

    def clearances(self, q: Float64) -> Float64:
        """Distances of postures, shape (n, dof), from the nearest obstacle beyond the margins, shape (n,) [m]."""
        ...


@dataclass(frozen=True, slots=True)
class GraspRules:
    """What a grasp must keep to.

    Attributes:
        side: air between each pad and the fruit on the approach that is wanted, and that is needed at least [m].
        table: air between finger tips and table at the grasp [m].
        sigmas: how many standard deviations of the measurement are kept on top of both.
        raise_up_to: how far the grasp may be drawn back from the widest section to clear the table [m].
        palm: air between fruit and palm [m].
        solutions: joint solutions that are kept of each candidate.
        tried_solutions: joint solutions that are looked at, nearest to where the arm stands first.
        check: follow every candidate through; without it only the joint solutions are sought (the paper's way).
    """

    side: tuple[float, float] = (6e-3, 2e-3)
    table: float = 3e-3
    sigmas: float = 2.0
    raise_up_to: float = 5e-3
    palm: float = 5e-3
    solutions: int = 3
    tried_solutions: int = 12
    check: bool = True


class _OutOfQuestion(Exception):
    """A candidate that is ruled out, and how far it came."""

    def __init__(self, code: str, reason: str, depth: int) -> None:
        self.code, self.reason, self.depth = code, reason, depth
        super().__init__(reason)


@dataclass(frozen=True, slots=True, eq=False)
class _Setting:
    """What all candidates of one fruit share."""

    measured: MeasuredFruit
    vertices_base: Float64
    robot: RobotModel
    shape: GripperShape
    surroundings: Surroundings
    table_z: float | None
    q_now: Float64
    sphere: Sphere
    rules: GraspRules


def sample_pre_grasps(
    measured: MeasuredFruit,
    robot: RobotModel,
    surroundings: Surroundings,
    q_now: Float64,
    table_z: float | None = None,
    sphere: Sphere | None = None,
    rules: GraspRules | None = None,
) -> tuple[tuple[Grasp, ...], tuple[RuledOut, ...]]:
    """Sample the sphere around a fruit.

    Args:
        measured: the refined fruit; its covariance enters as margin.
        robot: kinematics and geometry.
        surroundings: collision checks; the target must be left out of its map.
        q_now: where the arm stands, shape (dof,) [rad]; near solutions are preferred.
        table_z: height of the plane below the fruit [m], None for none.
        sphere: which part of the sphere, how finely.
        rules: margins.

    Returns:
        candidates, best first (without `check`: in the sampling's order), and those ruled out with their reasons.
    """
    chosen = sphere or Sphere()
    setting = _Setting(
        measured, fruit_points(measured), robot, gripper_shape(robot), surroundings, table_z, robot.checked(q_now),
        chosen, rules or GraspRules(),
    )  # fmt: skip
    grasps: list[Grasp] = []
    ruled_out: list[RuledOut] = []
    for index, (theta, alpha) in enumerate(chosen.attempts()):
        try:
            grasps.append(_candidate(setting, index, theta, alpha))
        except _OutOfQuestion as out:
            ruled_out.append(RuledOut(index, theta, alpha, out.code, out.reason))
    if setting.rules.check:
        grasps.sort(key=lambda grasp: cost(grasp, robot, setting.q_now))
    return tuple(grasps), tuple(ruled_out)


def cost(grasp: Grasp, robot: RobotModel, q_now: Float64) -> float:
    """Order of candidates, smallest first: a sum of shares between 0 and 1, by how much each matters for a safe grasp.

    Little clearance (30 mm is plenty), a tilted approach (the fingers come nearer to the table), a posture near a
    singularity, and a long way from where the arm stands.
    """
    q = grasp.q_pre_grasp[0]
    tight = 1.0 - min(grasp.clearance / 0.03, 1.0)
    tilted = grasp.theta / (np.pi / 2.0)
    stiff = 1.0 / (1.0 + 20.0 * robot.manipulability(q))
    far = min(float(np.abs(q - q_now).max()) / np.pi, 1.0)
    return 1.0 * tight + 0.5 * tilted + 0.5 * stiff + 0.5 * far


def _candidate(setting: _Setting, index: int, theta: float, alpha: float) -> Grasp:
    """Follow one candidate through.

    Raises:
        _OutOfQuestion: at the first step that fails for all joint solutions.
    """
    R_base_tcp = pre_grasp_orientation(theta, alpha)
    section = fruit_section(setting.measured, setting.vertices_base, R_base_tcp)
    width = _opening(setting, section)
    T_base_grasp = transform(R_base_tcp, section.p_base)
    if setting.rules.check:
        _clear_palm(setting, section)
        T_base_grasp = _above_table(setting, section, T_base_grasp, width)
    T_base_pre_grasp = T_base_grasp.copy()
    T_base_pre_grasp[:3, 3] -= setting.sphere.radius * R_base_tcp[:, 2]
    solutions = inverse_kinematics(setting.robot, T_base_pre_grasp, near=setting.q_now)
    if len(solutions) == 0:
        raise _OutOfQuestion("UNREACHABLE", "the arm does not reach the pre-grasp", 0)
    kept, clearance = solutions[: setting.rules.solutions], np.inf
    if setting.rules.check:
        kept, clearance = _approachable(setting, solutions, T_base_grasp, width)
    return Grasp(
        index, theta, alpha, T_base_pre_grasp, T_base_grasp, width, kept, clearance, setting.measured
    )  # fmt: skip


def _opening(setting: _Setting, section: FruitSection) -> float:
    """Opening to approach with: the fruit's width and air on both sides, as far as the gripper opens."""
    wanted, needed = setting.rules.side
    unsure = setting.rules.sigmas * np.hypot(section.sigma_across, section.sigma_width / 2.0)
    if section.width + 2.0 * (needed + unsure) > setting.robot.width_max:
        raise _OutOfQuestion(
            "TOO_WIDE",
            f"the fruit is {1e3 * section.width:.0f} ± {2e3 * unsure:.0f} mm wide here, the fingers open to "
            f"{1e3 * setting.robot.width_max:.0f} mm",
            0,
        )
    return float(min(section.width + 2.0 * (wanted + unsure), setting.robot.width_max))


def _clear_palm(setting: _Setting, section: FruitSection) -> None:
    left = setting.shape.palm_depth - section.behind
    if left < setting.rules.palm:
        raise _OutOfQuestion("TOO_TALL", f"the fruit would be {1e3 * left:.0f} mm from the palm", 0)


def _above_table(setting: _Setting, section: FruitSection, T_base_grasp: Float64, width: float) -> Float64:
    """The grasp, drawn back along the approach until the finger tips clear the table."""
    if setting.table_z is None:
        return T_base_grasp
    lowest, body = setting.shape.lowest(T_base_grasp, width)
    air = lowest - setting.table_z - setting.rules.sigmas * section.sigma_height
    missing = setting.rules.table - air
    if missing <= 0.0:
        return T_base_grasp
    back = missing / max(-float(T_base_grasp[2, 2]), 1e-6)
    if back > setting.rules.raise_up_to:
        name = body.replace("_", " ").replace("finger left", "left finger").replace("finger right", "right finger")
        where = f"{-1e3 * air:.0f} mm inside" if air < 0.0 else f"only {1e3 * air:.0f} mm above"
        raise _OutOfQuestion("TABLE", f"the {name} would be {where} the table", 0)
    raised = T_base_grasp.copy()
    raised[:3, 3] -= back * T_base_grasp[:3, 2]
    return raised


def _approachable(setting: _Setting, solutions: Float64, T_base_grasp: Float64, width: float) -> tuple[Float64, float]:
    """Joint solutions whose pre-grasp and whole approach are free, and the least distance kept on the first one's."""
    space = setting.surroundings.at_width(width)
    kept: list[Float64] = []
    clearance = 0.0
    furthest = _OutOfQuestion("IN_COLLISION", "nothing is free", -1)
    for q in solutions[: setting.rules.tried_solutions]:
        try:
            line = _free_line(setting.robot, space, q, T_base_grasp)
        except _OutOfQuestion as out:
            furthest = max(furthest, out, key=lambda failed: failed.depth)
            continue
        if not kept:
            clearance = float(space.clearances(line).min())
        kept.append(q)
        if len(kept) == setting.rules.solutions:
            break
    if not kept:
        raise furthest
    return np.array(kept), clearance


def _free_line(robot: RobotModel, space: ApproachSpace, q: Float64, T_base_grasp: Float64) -> Float64:
    if not space.free(q):
        raise _OutOfQuestion("IN_COLLISION", f"at the pre-grasp {space.explain(q)[0]}", 1)
    line = straight_line(robot, q, T_base_grasp, LINE_STEP)
    if not line.complete:
        raise _OutOfQuestion("UNREACHABLE", f"on the approach {line.reason}", 2)
    for here, there in zip(line.q[:-1], line.q[1:], strict=True):
        if not space.free_between(here, there):
            raise _OutOfQuestion("IN_COLLISION", f"on the approach {space.explain(there)[0]}", 3)
    return line.q
