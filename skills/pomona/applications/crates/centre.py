"""The skill Centre."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.applications.crates.feeling import FEELING_FAILURES, SETTLE, FeelingSkill, as_it_stands
from pomona.applications.crates.insertion import centred
from pomona.drivers import Arm, ForceSensor, Gripper, Workspace
from pomona.executive import FORCE, Float64, Force, Length, Outputs, Port, Work
from pomona.skills import tool_pose
from pomona.skills.grip import take_over
from pomona.skills.motion import Grasp

FREED = 3e-3
"""Way by which the fingers open when both have felt the fruit [m]: a grip begins with pads that touch nothing."""
FARTHEST = 6e-3
"""Largest way of the hand [m]."""
STEPS = 40
"""Steps of hand or fingers at most."""


class Centred(Outputs):
    """Outputs of Centre."""

    centred: Annotated[Grasp, Port(help="the grasp as the hand stands")]
    shifted: Annotated[Length, Port(help="way of the hand along its sliding direction")]


class Centre(FeelingSkill):
    """Shift a hand around a fruit along its fingers until both pads touch the fruit at once, then open them a little.

    A fruit that leans on a wall or a neighbour does not come along with one finger: the hand goes to it.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    moves = (Arm, Gripper)
    failures = (*FEELING_FAILURES, "ONE_FINGER")

    def run(
        self,
        grasp: Annotated[Grasp, Port(help="the grasp at which the hand stands around the fruit")],
        force: Annotated[
            Force, Port(min="0.5 N", max="3 N", help="that ends a step of the hand")
        ] = FORCE("2 N"),
    ) -> Work[Centred]:
        gripper = self.device(Gripper)
        begin = tool_pose(self)
        take_over(gripper)
        yield from self.move_fingers(
            min(grasp.width, gripper.limits.width_max), gripper.limits.speed_max
        )
        yield from self.wait(2.0 * SETTLE)

        def place(pressed: Float64) -> Float64 | None:
            where = centred(tool_pose(self)[:3, 3], begin[:3, :3], pressed)
            return (
                None if where is None or np.linalg.norm(where - begin[:3, 3]) > FARTHEST else where
            )

        with self.feeling() as hand:
            yield from self.wait(2.0 * SETTLE)
            both = yield from self.centre(hand, hand.pads.average(), force, STEPS, place)
        shifted = float(np.linalg.norm(tool_pose(self)[:3, 3] - begin[:3, 3]))
        if not both:
            words = f"after {1e3 * shifted:.0f} mm towards the fruit still only one finger touches it, or none"
            raise self.failure(
                "ONE_FINGER", words, shifted_m=shifted, width_m=gripper.state().width
            )
        width = min(gripper.state().width + FREED, gripper.limits.width_max)
        yield from self.move_fingers(width, gripper.limits.speed_max)
        return Centred(as_it_stands(grasp, tool_pose(self)), shifted)
