"""The skill MoveTo."""

from __future__ import annotations

from typing import Annotated

from pomona.drivers.interfaces import Arm, Gripper, Workspace
from pomona.executive.ports import LENGTH, TIME, Port, Ratio, Time
from pomona.executive.skill import Work
from pomona.skills.motion.grasp import Grasp
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.following import MOTION_FAILURES
from pomona.skills.shared.moving import POSE_FAILURES, PoseSkill, move_to_pose
from pomona.skills.shared.planning import Obstacles, Spacing


class MoveTo(PoseSkill):
    """Move to a named pose of the cell file, around obstacles.

    The path avoids the fixed surroundings, the robot itself, and the obstacles of a `map`. With `carrying`, the fruit
    between the fingers is part of the robot and is moved gently. If a camera sees a new obstacle on the path (a cell
    file with `workspace.watch`), the arm stops on its path, and the skill fails with PATH_BLOCKED.
    """

    devices = (Arm, Gripper, Workspace)
    moves = (Arm,)
    failures = (*MOTION_FAILURES, *POSE_FAILURES)

    def run(
        self,
        pose: Annotated[str, Port(help="a name under workspace.poses in the cell file")],
        variation: Annotated[
            int, Port(min=1, help="1 is the pose itself, 2 its pose_2 and so on, around")
        ] = 1,
        map: Obstacles = None,
        carrying: Annotated[Grasp | None, Port(help="the grasp by which a fruit is held")] = None,
        avoiding: Annotated[
            MeasuredFruit | None, Port(help="fruit that is not in the map and must be avoided")
        ] = None,
        clearance: Spacing = LENGTH("10 mm"),
        budget: Annotated[Time, Port(min="1 ms", help="planning time")] = TIME("500 ms"),
        speed: Annotated[
            Ratio, Port(min=0.02, max=1.0, help="speed relative to the arm's limits")
        ] = 1.0,
    ) -> Work[None]:
        yield from move_to_pose(
            self,
            pose,
            variation,
            map,
            carrying,
            clearance,
            budget,
            filter(None, (avoiding,)),
            speed,
        )
