"""The skill SampleHanging."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.applications.harvest.hanging import HangingRules, sample_hanging
from pomona.drivers import Arm, Workspace
from pomona.executive import LENGTH, Float64, Length, Outputs, Points3, Port, SceneView, Skill, Work
from pomona.skills import fruit_mesh, summary, usable_field
from pomona.skills.motion import (
    SAME_PLACE,
    Grasp,
    GraspCandidates,
    OccupancyMap,
    RobotModel,
    arm_space,
    warm_up,
)
from pomona.skills.perception import MeasuredFruit


class HangingSampled(Outputs):
    """What SampleHanging gives."""

    candidates: GraspCandidates


class SampleHanging(Skill):
    """Sample grasps of a hanging fruit that can be approached and rolled, level ones first.

    A candidate that comes back through `tried` is not given again for the same fruit in this run: what failed once from
    one direction fails again.
    """

    devices = (Arm, Workspace)
    moves = ()
    failures = ("NO_CANDIDATE", "MAP_STALE")

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._tried: list[
            tuple[Float64, int]
        ] = []  # place of the fruit in the base frame [m], and the candidate

    def prepare(self) -> None:
        warm_up(RobotModel.load(self.device(Arm).description))

    def run(
        self,
        around: Annotated[MeasuredFruit, Port(help="the refined fruit")],
        map: Annotated[OccupancyMap | None, Port(help="obstacles, without the target")] = None,
        tried: Annotated[Grasp | None, Port(help="the candidate of the previous attempt")] = None,
        clearance: Annotated[
            Length,
            Port(min="0 mm", help="distance of the links to obstacles; less for the gripper"),
        ] = LENGTH("6 mm"),
        before: Annotated[
            Length, Port(min="50 mm", max="200 mm", help="distance of the pre-grasp from the grasp")
        ] = LENGTH("100 mm"),
        enough: Annotated[int, Port(min=1, help="candidates after which the sampling ends")] = 4,
    ) -> Work[HangingSampled]:
        arm = self.device(Arm)
        robot = RobotModel.load(arm.description)
        if tried is not None:
            self._tried.append((tried.fruit.T_base_fruit[:3, 3], tried.index))
        here = around.T_base_fruit[:3, 3]
        without = frozenset(
            index for place, index in self._tried if np.linalg.norm(place - here) < SAME_PLACE
        )
        field = usable_field(self, map)
        space = arm_space(
            arm, self.device(Workspace), field, robot.width_max, clearance, target=around
        )
        rules = HangingRules(before=before, enough=enough)
        grasps, ruled_out = yield from self.compute(
            sample_hanging, around, robot, space, arm.state().q, rules, without
        )
        shown = tuple(
            Points3(np.array(p), label, style)
            for label, style, p in (
                ("left to try", "free", [g.T_base_pre_grasp[:3, 3] for g in grasps]),
            )
            if p
        )
        caption = f"{len(grasps)} grasps, {len(ruled_out)} ruled out, {len(without)} tried"
        self.publish(
            "candidates", SceneView(points=shown, meshes=(fruit_mesh(around),), caption=caption)
        )
        if not grasps:
            reasons = summary(ruled_out)
            raise self.failure(
                "NO_CANDIDATE", f"all {len(ruled_out)} grasps are ruled out: {reasons}"
            )
        return HangingSampled(GraspCandidates(grasps, ruled_out, len(without) + 1))
