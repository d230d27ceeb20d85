"""The skill Plan."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from pomona.drivers.interfaces import Arm, Gripper, Trajectory, Workspace
from pomona.executive.ports import LENGTH, TIME, Outputs, Port, Time
from pomona.executive.skill import Skill, SkillFailure, Work
from pomona.executive.views import Line3, Points3, SceneView
from pomona.skills.motion.grasp import Grasp, GraspCandidates
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.plan import PLANNERS, BudgetUse, PlanRequest, PlanResult
from pomona.skills.motion.robot import RobotModel
from pomona.skills.shared.grasp_view import grasp_picture
from pomona.skills.shared.planning import (
    PLANNING_FAILURES,
    Spacing,
    patience,
    planned,
    space_around,
)
from pomona.skills.shared.warm_motion import prepare_planning

OPTIMISING = tuple(
    name for name, planner in PLANNERS.items() if planner.kind is BudgetUse.OPTIMISING
)


class Planned(Outputs):
    """Outputs of Plan."""

    grasp: Grasp
    path: Trajectory


class Plan(Skill):
    """Plan a timed, checked path from where the arm stands to the pre-grasp of any candidate.

    All candidates' joint solutions are one goal set; the output `grasp` is the candidate that the path leads to. Within
    the budget a first path is found in milliseconds and then improved. The budget counts iterations, not seconds on the
    wall, so a seed gives the same path on a loaded machine.
    """

    devices = (Arm, Gripper, Workspace)
    moves = ()
    failures = (*PLANNING_FAILURES, "MAP_STALE")

    def prepare(self) -> None:
        prepare_planning(self)

    def run(
        self,
        to: Annotated[GraspCandidates, Port(help="goals; the path leads to any one of them")],
        map: Annotated[OccupancyMap, Port(help="obstacles, without the target")],
        planner: Annotated[
            str, Port(choices=tuple(PLANNERS), help="planner that finds the path")
        ] = "RRTConnect",
        improve: Annotated[
            str,
            Port(
                choices=("none", *OPTIMISING),
                help="planner that improves the path for the rest of the budget",
            ),
        ] = "InformedRRTstar",
        budget: Annotated[
            Time, Port(min="1 ms", max="60 s", help="planning time on an unloaded core")
        ] = TIME("200 ms"),
        clearance: Spacing = LENGTH("10 mm"),
        direct: Annotated[
            bool, Port(help="try straight joint motions first; the paper does not")
        ] = True,
    ) -> Work[Planned]:
        arm = self.device(Arm)
        robot = RobotModel.load(arm.description)
        goals = [(grasp, q) for grasp in to.grasps for q in grasp.q_pre_grasp]
        target = to.grasps[0].fruit if to.grasps else None
        space = space_around(self, map, clearance, target=target)
        request = PlanRequest(
            space=space,
            q_start=arm.state().q,
            q_goals=np.array([q for _, q in goals]).reshape(-1, robot.dof),
            limits=arm.limits,
            planner=planner,
            improve="" if improve == "none" else improve,
            budget=budget,
            seed=int(self.rng().integers(2**31)),
            patience=patience(self, budget),
            direct=direct,
        )
        try:
            result = yield from planned(self, request)
        except SkillFailure as failed:
            candidates = sorted({grasp.index for grasp, _ in goals})
            reason = failed.failure
            raise SkillFailure(
                replace(reason, data={**reason.data, "candidates": candidates})
            ) from failed
        grasp = goals[result.goal][0]
        self._show(robot, result, grasp)
        return Planned(grasp=grasp, path=result.path)

    def _show(self, robot: RobotModel, result: PlanResult, grasp: Grasp) -> None:
        tcp = np.array([robot.tcp(q)[:3, 3] for q in result.path.q[::4]])
        chosen = Points3(grasp.T_base_pre_grasp[None, :3, 3], f"candidate {grasp.index}", "chosen")
        caption = (
            f"{result.found_by}: {result.path.duration:.2f} s to candidate {grasp.index} "
            f"(θ {np.degrees(grasp.theta):.0f}°, α {np.degrees(grasp.alpha):.0f}°)"
        )
        self.publish(
            "path",
            SceneView(
                lines=(Line3(tcp, "planned path", "planned"),), points=(chosen,), caption=caption
            ),
        )
        self.publish("grasp", grasp_picture(grasp))
