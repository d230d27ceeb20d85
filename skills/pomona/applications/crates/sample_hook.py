"""The skill SampleHook."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.applications.crates.hooks import Beside, hook_candidates, pull_of
from pomona.drivers import Arm, Workspace
from pomona.executive import LENGTH, Length, Line3, Outputs, Port, SceneView, Skill, Work
from pomona.skills import fruit_mesh, summary, usable_field
from pomona.skills.motion import GraspCandidates, OccupancyMap, RobotModel, arm_space
from pomona.skills.perception import MeasuredFruit


class HooksSampled(Outputs):
    """Outputs of SampleHook."""

    candidates: Annotated[
        GraspCandidates, Port(help="reachable hooks, the straightest pull first; goals of Plan")
    ]


class SampleHook(Skill):
    """Sample places from which a finger beside a wall or a neighbour can draw a fruit away from it.

    A hook's pre-grasp is over the fruit, and its grasp the lowest place of the fingers: `Hook` carries it out.
    """

    devices = (Arm, Workspace)
    moves = ()
    failures = ("NO_WALL", "NO_CANDIDATE", "MAP_STALE")

    def run(
        self,
        around: Annotated[
            MeasuredFruit, Port(help="the fruit, measured with all other fruit beside it")
        ],
        map: Annotated[OccupancyMap | None, Port(help="obstacles, without the fruit")] = None,
        distance: Annotated[Length, Port(min="10 mm", max="100 mm", help="of the pull")] = LENGTH(
            "45 mm"
        ),
        clearance: Annotated[
            Length,
            Port(min="2 mm", help="distance of the links to obstacles; less for the gripper"),
        ] = LENGTH("4 mm"),
    ) -> Work[HooksSampled]:
        arm = self.device(Arm)
        workspace = self.device(Workspace)
        beside = Beside.of(around, workspace)
        if not beside.away:
            raise self.failure(
                "NO_WALL", "neither a wall of the cell file nor another fruit is within 20 mm of it"
            )
        robot = RobotModel.load(arm.description)
        space = arm_space(arm, workspace, usable_field(self, map), robot.width_max, clearance)
        found = yield from self.compute(hook_candidates, beside, space, arm.state().q, distance)
        pulls = [
            hook.T_base_grasp[:3, 3] + np.outer([0.0, distance], pull_of(hook))
            for hook in found.grasps
        ]
        caption = (
            f"{len(found.grasps)} of {len(found.grasps) + len(found.ruled_out)} hooks are free"
        )
        lines = tuple(Line3(pull, "pull", "approach") for pull in pulls)
        self.publish(
            "candidates", SceneView(lines=lines, meshes=(fruit_mesh(around),), caption=caption)
        )
        if not found.grasps:
            words = f"all {len(found.ruled_out)} hooks are ruled out: {summary(found.ruled_out)}"
            raise self.failure("NO_CANDIDATE", words)
        return HooksSampled(found)
