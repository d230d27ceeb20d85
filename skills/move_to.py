"""The skill MoveTo."""

from __future__ import annotations

from drivers.interfaces import Arm, Gripper, Workspace
from executive.ports import LENGTH, TIME, Port, Ports, optional
from executive.skill import Work
from skills.motion.grasp import Grasp
from skills.motion.occupancy import OccupancyMap
from skills.perception.measured_fruit import MeasuredFruit
from skills.shared.following import MOTION_FAILURES, MovingSkill
from skills.shared.moving import POSE_FAILURES, move_to_pose
from skills.shared.warm_motion import prepare_planning


class MoveTo(MovingSkill):
    """Move to a named pose of the cell file, around what is in the way.

    The fixed surroundings and the robot itself are always avoided, what a `map` holds as well, and with `carrying` the
    fruit between the fingers is part of the robot and is moved gently.
    """

    inputs = Ports(
        pose=Port(str, help="a name under workspace.poses in the cell file"),
        variation=Port(int, default=1, min=1, help="1 is the pose itself, 2 its pose_2 and so on, around"),
        map=optional(OccupancyMap, "what is in the way"),
        carrying=optional(Grasp, "the grasp by which a fruit is held"),
        avoiding=optional(MeasuredFruit, "a fruit that was left out of the map and is still there"),
        clearance=Port(LENGTH, default="10 mm", min="2 mm", help="kept by the links; gripper and fingers keep a share"),
        budget=Port(TIME, default="500 ms", min="1 ms", help="planning time"),
    )
    devices = (Arm, Gripper, Workspace)
    failures = (*MOTION_FAILURES, *POSE_FAILURES)

    def prepare(self) -> None:
        prepare_planning(self)

    def run(  # type: ignore[override]
        self,
        pose: str,
        variation: int,
        map: OccupancyMap | None,
        carrying: Grasp | None,
        avoiding: MeasuredFruit | None,
        clearance: float,
        budget: float,
    ) -> Work:
        yield from move_to_pose(self, pose, variation, map, carrying, clearance, budget, avoiding)
        return {}
