"""Grasp candidates on the paper's sphere: those reachable without contact, best first.

Every candidate is checked step by step: opening against the estimated width, fingers against the table, joint solutions
of the pre-grasp, the straight approach in one arm configuration, and everything on the way against the map. A failing
one is excluded with the reason of the furthest step that it reached.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.drivers.interfaces import Workspace
from pomona.executive.values.arrays import Float64, Int64
from pomona.skills.geometry import inverse, transform
from pomona.skills.motion.collision import CollisionWorld, fruit_points
from pomona.skills.motion.grasp import Grasp, RuledOut
from pomona.skills.motion.grasps.follow_through import (
    GOOD,
    LINE_BROKEN,
    START_BLOCKED,
    follow_through,
)
from pomona.skills.motion.grasps.gripper_shape import (
    CrossSection,
    GripperShape,
    extent,
    fruit_section,
    gripper_shape,
)
from pomona.skills.motion.grasps.sphere import Sphere, pre_grasp_orientations
from pomona.skills.motion.lines import LARGEST_RATE
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.robot.inverse_kinematics import inverse_kinematics
from pomona.skills.perception.measured_fruit import MeasuredFruit

LINE_STEP = 30e-3  # distance of poses along an approach when it is judged [m]; segments between them are checked whole


@dataclass(frozen=True, slots=True)
class GraspRules:
    """Rules for a grasp."""

    # air between each pad and the fruit on the approach that is wanted, and that is needed at least [m]
    side: tuple[float, float] = (6e-3, 2e-3)
    table: float = 3e-3  # air between finger tips and table at the grasp [m]
    sigmas: float = 2.0  # how many standard deviations of the measurement are kept on top of both
    # how far the grasp may be drawn back from the widest section to clear the table [m]
    raise_up_to: float = 5e-3
    palm: float = 5e-3  # air between fruit and palm [m]
    solutions: int = 2  # joint solutions that are kept of each candidate
    # number of joint solutions to check, nearest to the present joints first
    tried_solutions: int = 8
    arm_angles: int = 18  # how finely a redundant arm's solutions are sampled
    # follow every candidate through; without it only the joint solutions are sought (the paper's way)
    check: bool = True


class CandidateRejected(Exception):
    """A candidate that is ruled out."""

    def __init__(self, code: str, reason: str) -> None:
        self.code = code
        self.reason = reason
        super().__init__(reason)


@dataclass(frozen=True, slots=True, eq=False)
class GraspSetting:
    """Common data of all candidates of one fruit, such as the TCP's pose in the last link, shape (3, 4), and the
    distances from the grasp at which an approach is checked, shape (m,) [m].
    """

    measured: MeasuredFruit
    vertices_base: Float64
    robot: RobotModel
    shape: GripperShape
    space: ArmSpace
    table_z: float | None
    q_now: Float64
    sphere: Sphere
    rules: GraspRules
    T_last_tcp: Float64
    back: Float64


def sample_pre_grasps(
    measured: MeasuredFruit,
    robot: RobotModel,
    space: ArmSpace,
    q_now: Float64,
    table_z: float | None = None,
    sphere: Sphere | None = None,
    rules: GraspRules | None = None,
) -> tuple[tuple[Grasp, ...], tuple[RuledOut, ...]]:
    """Sample the sphere around a fruit; return candidates, best first, and those ruled out with their reasons.

    Args:
        measured: the refined fruit; its covariance enters as margin.
        space: collision checks; the target must be left out of its map, and the fingers allowed near it.
        q_now: where the arm stands, shape (dof,) [rad]; near solutions are preferred.
        table_z: height of the plane below the fruit [m], None for none.
    """
    chosen = sphere or Sphere()
    setting = grasp_setting(measured, robot, space, q_now, table_z, chosen, rules or GraspRules())
    grasps: list[Grasp] = []
    ruled_out: list[RuledOut] = []
    for index, ((theta, alpha), R_base_tcp) in enumerate(
        zip(chosen.attempts(), pre_grasp_orientations(chosen), strict=True)
    ):
        try:
            grasps.append(judge_candidate(setting, index, theta, alpha, R_base_tcp))
        except CandidateRejected as out:
            ruled_out.append(RuledOut(index, theta, alpha, out.code, out.reason))
    if setting.rules.check:
        grasps.sort(key=lambda grasp: cost(grasp, robot, setting.q_now))
    return tuple(grasps), tuple(ruled_out)


def grasp_setting(
    measured: MeasuredFruit,
    robot: RobotModel,
    space: ArmSpace,
    q_now: Float64,
    table_z: float | None,
    sphere: Sphere,
    rules: GraspRules,
) -> GraspSetting:
    """Return what all candidates of one fruit share; the arguments are those of `sample_pre_grasps`."""
    return GraspSetting(
        measured,
        fruit_points(measured),
        robot,
        gripper_shape(robot),
        space,
        table_z,
        robot.checked(q_now),
        sphere,
        rules,
        np.ascontiguousarray(robot.T_link_tcp[:3]),
        np.linspace(sphere.radius, 0.0, 1 + max(3, int(np.ceil(sphere.radius / LINE_STEP)))),
    )


def cost(grasp: Grasp, robot: RobotModel, q_now: Float64) -> float:
    """Return the order of a candidate, smallest first: a sum of ratios weighted by their effect on a safe grasp.

    They are little clearance (30 mm is plenty), pads that meet the skin obliquely or press on the ends of a long fruit,
    a tilted approach, a posture near a singularity, and a long way from the arm.
    """
    q = grasp.q_pre_grasp[0]
    tight = 1.0 - min(grasp.clearance / 0.03, 1.0)
    tilted = grasp.theta / (np.pi / 2.0)
    stiff = 1.0 / (1.0 + 20.0 * robot.manipulability(q))
    # pads that meet the skin at this angle turn a fruit between them, even with good friction [rad]
    oblique = min(grasp.oblique / 0.35, 1.0)
    wide = min(grasp.width / float(grasp.fruit.dimensions.min()) - 1.0, 1.0)
    far = min(float(np.abs(q - q_now).max()) / np.pi, 1.0)
    return 1.0 * tight + 1.0 * oblique + 1.0 * wide + 0.5 * tilted + 0.5 * stiff + 0.5 * far


def judge_candidate(
    setting: GraspSetting, index: int, theta: float, alpha: float, R_base_tcp: Float64
) -> Grasp:
    """Follow one candidate through. Raises CandidateRejected: at the first step that fails for all joint solutions."""
    section = fruit_section(setting.measured, setting.vertices_base, R_base_tcp)
    width = _opening(setting, section)
    T_base_grasp = transform(
        R_base_tcp, section.p_base - setting.shape.forward(section.width) * R_base_tcp[:, 2]
    )
    if setting.rules.check:
        _clear_palm(setting, section)
        T_base_grasp = _above_table(setting, section, T_base_grasp, width)
    T_base_pre_grasp = T_base_grasp.copy()
    T_base_pre_grasp[:3, 3] -= setting.sphere.radius * R_base_tcp[:, 2]
    angles = setting.rules.arm_angles
    solutions = inverse_kinematics(
        setting.robot, T_base_pre_grasp, arm_angles=angles, near=setting.q_now
    )
    if len(solutions) == 0:
        raise CandidateRejected("UNREACHABLE", "the arm does not reach the pre-grasp")
    kept = solutions[: setting.rules.solutions]
    clearance = np.inf
    if setting.rules.check:
        kept, clearance = _approachable(setting, solutions, T_base_grasp, width, section.width)
    return Grasp(
        index,
        theta,
        alpha,
        T_base_pre_grasp,
        T_base_grasp,
        width,
        kept,
        clearance,
        section.oblique,
        setting.measured,
    )


def _opening(setting: GraspSetting, section: CrossSection) -> float:
    """Opening to approach with: the fruit's width and air on both sides, as far as the gripper opens."""
    wanted, needed = setting.rules.side
    unsure = setting.rules.sigmas * np.hypot(section.sigma_across, section.sigma_width / 2.0)
    if section.width + 2.0 * (needed + unsure) > setting.robot.width_max:
        raise CandidateRejected(
            "TOO_WIDE",
            f"the fruit is {1e3 * section.width:.0f} ± {2e3 * unsure:.0f} mm wide here, the fingers open to "
            f"{1e3 * setting.robot.width_max:.0f} mm",
        )
    return float(min(section.width + 2.0 * (wanted + unsure), setting.robot.width_max))


def _clear_palm(setting: GraspSetting, section: CrossSection) -> None:
    left = setting.shape.palm_depth + setting.shape.forward(section.width) - section.behind
    if left < setting.rules.palm:
        raise CandidateRejected("TOO_TALL", f"the fruit would be {1e3 * left:.0f} mm from the palm")


def _above_table(
    setting: GraspSetting, section: CrossSection, T_base_grasp: Float64, width: float
) -> Float64:
    """Return the grasp, drawn back along the approach until the finger tips clear the table."""
    if setting.table_z is None:
        return T_base_grasp
    lowest, body = setting.shape.lowest(T_base_grasp, width)
    air = lowest - setting.table_z - setting.rules.sigmas * section.sigma_height
    missing = setting.rules.table - air
    if missing <= 0.0:
        return T_base_grasp
    back = missing / max(-float(T_base_grasp[2, 2]), 1e-6)
    if back > setting.rules.raise_up_to:
        name = (
            body.replace("_", " ")
            .replace("finger left", "left finger")
            .replace("finger right", "right finger")
        )
        where = f"{-1e3 * air:.0f} mm inside" if air < 0.0 else f"only {1e3 * air:.0f} mm above"
        raise CandidateRejected("TABLE", f"the {name} would be {where} the table")
    raised = T_base_grasp.copy()
    raised[:3, 3] -= back * T_base_grasp[:3, 2]
    return raised


def _approachable(
    setting: GraspSetting,
    solutions: Float64,
    T_base_grasp: Float64,
    width: float,
    closed_width: float,
) -> tuple[Float64, float]:
    """Joint solutions whose pre-grasp and whole approach are free, and the least distance kept on the first one's.

    The fingers are free when they have closed on the fruit, too: one outside a crate would close on its wall.
    """
    robot = setting.robot
    rules = setting.rules
    space = setting.space.at_width(width)
    tried = np.ascontiguousarray(solutions[: rules.tried_solutions])
    poses = np.repeat(T_base_grasp[None, :3], len(setting.back), axis=0)
    poses[:, :, 3] -= setting.back[:, None] * T_base_grasp[:3, 2]
    lines, verdicts, witnesses = _judge(
        robot, space, tried, poses, setting.T_last_tcp, rules.solutions
    )
    good = np.flatnonzero(verdicts == GOOD)
    if len(good) == 0:
        raise _why_not(space, verdicts, witnesses)
    closed = space.at_width(closed_width)
    q_grasp = lines[good[0], -1]
    # in something, not only near it
    if closed.clearances(q_grasp[None])[0] < -closed.world.margins.fingers:
        raise CandidateRejected(
            "IN_COLLISION", f"as the fingers close {closed.explain(q_grasp)[0]}"
        )
    return tried[good], float(space.clearances(lines[good[0]]).min())


def _judge(
    robot: RobotModel,
    space: ArmSpace,
    solutions: Float64,
    poses: Float64,
    T_last_tcp: Float64,
    wanted: int,
) -> tuple[Float64, Int64, Float64]:
    """Follow the approach along `poses` through for joint solutions; results as in `follow_through`."""
    apart = float(np.linalg.norm(poses[1, :, 3] - poses[0, :, 3]))
    lines = np.empty((len(solutions), len(poses), robot.dof))
    verdicts = np.empty(len(solutions), dtype=np.int64)
    witnesses = np.empty_like(solutions)
    follow_through(
        space.world.shape.arrays,
        space.world.arrays,
        T_last_tcp,
        robot.lower,
        robot.upper,
        solutions,
        poses,
        space.width,
        LARGEST_RATE * apart,
        wanted,
        lines,
        verdicts,
        witnesses,
    )
    return lines, verdicts, witnesses


def support_below(workspace: Workspace, p_base: Float64) -> float | None:
    """Return the height of the table or the floor of a crate below a point of the base frame, shape (3,); None: none.

    Boxes of the cell file count that stand upright.
    """
    heights = [-np.inf if workspace.table_z is None else workspace.table_z]
    for box in workspace.obstacles:
        p_box = inverse(box.T_base_box)[:3] @ np.append(p_base, 1.0)
        half = np.array(box.half_extents)
        if (
            box.T_base_box[2, 2] > 0.999
            and (np.abs(p_box[:2]) < half[:2]).all()
            and p_box[2] > half[2]
        ):
            heights.append(float(box.T_base_box[2, 3] + half[2]))
    return max(heights) if np.isfinite(max(heights)) else None


def warm_up(robot: RobotModel) -> None:
    """Compile the functions of the sampling before a run's clock starts."""
    q = (robot.lower + robot.upper) / 2.0
    space = ArmSpace(CollisionWorld.build(robot), robot.width_max)
    poses = np.tile(robot.tcp(q)[:3], (2, 1, 1))
    extent(
        np.zeros((1, 3)), robot.tcp(q)[:3, 3], pre_grasp_orientations(Sphere())[0], 1.0, np.empty(3)
    )
    space.world.field.distance(np.zeros((1, 3)))
    space.clearances(q[None])
    inverse_kinematics(robot, robot.tcp(q), near=q)
    _judge(robot, space, q[None], poses, np.ascontiguousarray(robot.T_link_tcp[:3]), 1)


def _why_not(space: ArmSpace, verdicts: Int64, witnesses: Float64) -> CandidateRejected:
    """Return the reason of the solution that came furthest."""
    furthest = int(verdicts.argmax())
    if verdicts[furthest] == LINE_BROKEN:
        return CandidateRejected(
            "UNREACHABLE", "the arm cannot go straight from the pre-grasp to the grasp"
        )
    where = "at the pre-grasp" if verdicts[furthest] == START_BLOCKED else "on the approach"
    return CandidateRejected("IN_COLLISION", f"{where} {space.explain(witnesses[furthest])[0]}")
