"""The skill Insert."""

from __future__ import annotations

from typing import Annotated

from pomona.applications.crates.feeling import (
    GENTLE,
    OVER_FAILURES,
    SETTLE,
    FeelingSkill,
    ManoeuvreHand,
    as_it_stands,
)
from pomona.applications.crates.hooks import Beside, touched
from pomona.applications.crates.insertion import OVER, FeltByHand, Insertion
from pomona.applications.crates.inserts import crowded_side, finger_corners
from pomona.applications.crates.pull import bears_at_edges, weight_of
from pomona.drivers import Arm, ForceSensor, Gripper, Workspace
from pomona.executive import Float64, Force, Length, Outputs, Port, SkillFailure, Work
from pomona.skills import Manner, tool_pose
from pomona.skills.motion import Grasp, RobotModel, fruit_points, gripper_shape

DOWN = Manner(0.08, GENTLE, 5.0)
"""Way down above all fruit."""
SLOW = Manner(0.012, GENTLE, 20.0)
"""Way down beside fruit that was not touched yet: a contact is 5 to 10 N/mm, and the motor is looked at every 20 ms."""
TOUCHING = Manner(0.006, GENTLE, 20.0)
"""Every other way."""
CENTRINGS = 20
"""Steps in which the hand is centred on the fruit."""
ABOVE = 0.010
"""Height of the fingers' tips over the highest crown at which they slow down [m]."""
LEAST = 1.0
MOST = 2.0
"""Limits of the fingers' force [N]: thrice a touch, whatever the floor presses, and what no fruit needs more of."""


class Inserted(Outputs):
    """Outputs of Insert."""

    grasp: Annotated[
        Grasp, Port(help="the grasp as the hand stands, for Lift, Retreat and Release")
    ]
    felt: Annotated[Force, Port(help="largest force on a face of the fingers")]
    shifted: Annotated[Length, Port(help="way by which the hand gave way")]


class Insert(FeelingSkill):
    """Go down around a fruit between its neighbours with open fingers, giving way sideways where they touch.

    Neighbours and the fruit may have moved afterwards: after a failure the hand is over the fruit again; look again.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    moves = (Arm, Gripper)
    failures = (*OVER_FAILURES, "FORCE_LIMIT")

    def run(
        self,
        insert: Annotated[
            Grasp, Port(help="one of SampleInsert's, at whose pre-grasp the arm stands")
        ],
    ) -> Work[Inserted]:
        before = yield from self.stand_over(insert)
        force = min(MOST, max(bears_at_edges(insert) - weight_of(insert), LEAST))
        with self.feeling() as hand:
            try:
                law, offset = yield from self._down(insert, before, hand, force)
                if law.arrived:
                    yield from self.centre(
                        hand,
                        offset,
                        OVER * force,
                        CENTRINGS,
                        lambda felt: law.centred(tool_pose(self)[:3, 3], felt),
                    )
            except SkillFailure as failed:
                if failed.failure.code == "NO_STRAIGHT_LINE":
                    yield from self.rise_to(before)
                raise
        if not law.arrived:
            yield from self.rise_to(before)
            words = f"the fingers met {law.most:.1f} N {1e3 * law.left:.0f} mm before the grasp: nothing gives way there"
            raise self.failure("FORCE_LIMIT", words, before_grasp_m=law.left, force_n=law.most)
        return Inserted(as_it_stands(insert, tool_pose(self)), law.most, law.shifted)

    def _down(
        self, insert: Grasp, before: Float64, hand: ManoeuvreHand, limit: float
    ) -> Work[tuple[Insertion, Float64]]:
        fingers = gripper_shape(RobotModel.load(self.device(Arm).description))
        beside = Beside.of(insert.fruit, self.device(Workspace))

        def blocked(p: Float64) -> bool:
            T = before.copy()
            T[:3, 3] = p
            return bool(
                touched(finger_corners(fingers, T, insert.width), fingers.bodies * 2, beside.walls)
            )

        side = crowded_side(beside, fingers, insert)
        law = Insertion(before, float(insert.T_base_grasp[2, 3]), limit, side, blocked)
        yield from self.wait(SETTLE)
        hand, offset = hand.touching_nothing(), hand.pads.average()
        crown = max(
            float(fruit_points(each)[:, 2].max()) for each in (insert.fruit, *insert.fruit.beside)
        )
        fast = float(before[2, 3] - fingers.points[:, 2].max()) - crown - ABOVE
        if fast > 0.0:
            yield from self.feel_way(
                self.line_to(before[:3, 3] - [0.0, 0.0, fast]), DOWN, hand, law.touch, law.touch
            )
        manner = SLOW
        stopped = False
        while (
            step := law.next(tool_pose(self)[:3, 3], self._felt(hand, offset), stopped)
        ) is not None:
            hand.forget_change()
            stopped = yield from self.feel_way(
                self.line_to(step.p_end), manner, hand, step.stop, law.touch
            )
            if stopped:
                manner = TOUCHING
                yield from self.wait(SETTLE)
            yield f"{1e3 * law.left:.0f} mm before the grasp, {law.most:.1f} N, {1e3 * law.shifted:.0f} mm aside"
        return law, offset

    def _felt(self, hand: ManoeuvreHand, offset: Float64) -> FeltByHand:
        self.require_fresh(hand)
        return FeltByHand(
            hand.pads.average() - offset, max(hand.outer.force, hand.edges - hand.at_rest)
        )
