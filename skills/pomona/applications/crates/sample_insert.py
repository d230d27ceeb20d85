"""The skill SampleInsert."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.applications.crates.hooks import Beside
from pomona.applications.crates.inserts import insert_candidates
from pomona.drivers import Arm, Workspace
from pomona.executive import LENGTH, Length, Line3, Outputs, Port, SceneView, Skill, Work
from pomona.skills import fruit_mesh, summary, usable_field
from pomona.skills.motion import GraspCandidates, OccupancyMap, RobotModel, arm_space, gripper_shape
from pomona.skills.perception import MeasuredFruit


class InsertsSampled(Outputs):
    """Outputs of SampleInsert."""

    candidates: Annotated[
        GraspCandidates, Port(help="reachable grasps, the one with the least push first")
    ]


class SampleInsert(Skill):
    """Sample plumb grasps of a fruit between neighbours, which the fingers may push aside by some millimetres.

    A pre-grasp is over the fruit and the walls beside it: `Insert` goes down from it.
    """

    devices = (Arm, Workspace)
    moves = ()
    failures = ("NO_CANDIDATE", "MAP_STALE")

    def run(
        self,
        around: Annotated[
            MeasuredFruit, Port(help="the fruit, measured with all other fruit beside it")
        ],
        map: Annotated[OccupancyMap | None, Port(help="obstacles, without the fruit")] = None,
        clearance: Annotated[
            Length,
            Port(min="2 mm", help="distance of the links to obstacles; less for the gripper"),
        ] = LENGTH("4 mm"),
    ) -> Work[InsertsSampled]:
        arm = self.device(Arm)
        workspace = self.device(Workspace)
        robot = RobotModel.load(arm.description)
        beside = Beside.of(around, workspace)
        space = arm_space(arm, workspace, usable_field(self, map), robot.width_max, clearance)
        found = yield from self.compute(
            insert_candidates, beside, space, arm.state().q, gripper_shape(robot), robot.width_max
        )
        ways = [np.array([g.T_base_pre_grasp[:3, 3], g.T_base_grasp[:3, 3]]) for g in found.grasps]
        caption = f"{len(found.grasps)} of {len(found.grasps) + len(found.ruled_out)} ways between the neighbours"
        lines = tuple(Line3(way, "insert", "approach") for way in ways)
        self.publish(
            "candidates", SceneView(lines=lines, meshes=(fruit_mesh(around),), caption=caption)
        )
        if not found.grasps:
            words = f"all {len(found.ruled_out)} inserts are ruled out: {summary(found.ruled_out)}"
            raise self.failure("NO_CANDIDATE", words)
        return InsertsSampled(found)
