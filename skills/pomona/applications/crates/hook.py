"""The skill Hook."""

from __future__ import annotations

from typing import Annotated

from pomona.applications.crates.feeling import (
    GENTLE,
    OVER_FAILURES,
    SETTLE,
    FeelingSkill,
    ManoeuvreHand,
)
from pomona.applications.crates.pull import (
    DOWNWARDS,
    ENOUGH,
    FARTHEST_OFF,
    LEAST,
    RELIEF,
    HookPull,
    bears_at_edges,
    weight_of,
)
from pomona.drivers import HARD_MODULUS, Arm, ForceSensor, Gripper, Workspace
from pomona.executive import (
    FORCE,
    LENGTH,
    SPEED,
    Float64,
    Force,
    Length,
    Outputs,
    Port,
    SkillFailure,
    Speed,
    Work,
)
from pomona.skills import Manner, bruising, follow_way, tool_pose, vertical_way
from pomona.skills.motion import Grasp, RobotModel, fruit_points, gripper_shape

DOWN = Manner(0.02, GENTLE, 5.0)
"""Way down beside the wall, above the fruit's crown: a sensor at the wrist shows a contact after 30 ms."""
TOUCHING = Manner(0.005, GENTLE, 10.0)
"""Way down beside the fruit: a contact is 5 to 10 N/mm, and the sensors report after 10 to 30 ms."""
CREEPING = Manner(0.002, GENTLE, 10.0)
"""Way at the fruit while it does not roll: within the sensors' delay the force grows by 0.3 N, not by 1 N."""
ABOVE = 0.010
"""Height of the fingers' tips over the crown at which they slow down [m]."""
OUTER = 3.0
"""Push on the fingers from outside that ends the motion [N], by the motor: within a tick it grows by 2 N at most."""


class Drawn(Outputs):
    """Outputs of Hook."""

    finger: Annotated[
        Length, Port(help="way that the finger came; a rolling fruit comes about half as far")
    ]


class Hook(FeelingSkill):
    """Draw a fruit away from a wall with one finger: down beside the wall until it touches, then across, then up.

    The fruit has moved afterwards: look again.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    moves = (Arm, Gripper)
    failures = (*OVER_FAILURES, "PULL_BLOCKED", "NOTHING_MOVED")

    def run(
        self,
        hook: Annotated[Grasp, Port(help="one of SampleHook's, at which the arm stands")],
        touch: Annotated[
            Force, Port(min="0.3 N", max="2 N", help="that ends the way down")
        ] = FORCE("0.5 N"),
        force: Annotated[
            Force, Port(min="0.5 N", max="5 N", help="that ends a step of the pull, at first")
        ] = FORCE("1 N"),
        distance: Annotated[Length, Port(min="10 mm", max="100 mm", help="of the pull")] = LENGTH(
            "45 mm"
        ),
        speed: Annotated[Speed, Port(min="5 mm/s", max="30 mm/s", help="of the pull")] = SPEED(
            "0.010 m/s"
        ),
    ) -> Work[Drawn]:
        before = yield from self.stand_over(hook)
        try:
            with self.feeling() as hand:
                yield from self.wait(SETTLE)
                hand = hand.touching_nothing(bears_at_edges(hook))
                self._press = 0.0
                try:
                    yield from self._down(hook, hand, touch)
                    yield from self._give_way(hand, 0.0)
                    moved = yield from self._across(hook, hand, (touch, force), distance, speed)
                finally:
                    self._note_press(hook)
        except SkillFailure as failed:
            if failed.failure.code in (
                "PULL_BLOCKED",
                "NOTHING_MOVED",
                "NO_STRAIGHT_LINE",
                "CONTACT",
            ):
                yield from self.rise_to(before)
            raise
        yield from self.rise_to(before)
        return Drawn(moved)

    def _note_press(self, hook: Grasp) -> None:
        """Add the force of the floor to the account: the fruit's weight, and the largest force of the hand."""
        force = self._press + weight_of(hook)
        share = force / bruising(hook.fruit, HARD_MODULUS)
        words = f"the crate pressed a fruit with {force:.1f} N, {share:.2f} of its limit"
        self.account("the crate", words, share)

    def _down(self, hook: Grasp, hand: ManoeuvreHand, limit: float) -> Work[None]:
        """Go down beside the wall until a finger touches the fruit's flank, or to the lowest place."""
        start = hook.T_base_pre_grasp[2, 3]
        end = hook.T_base_grasp[2, 3]
        robot = RobotModel.load(self.device(Arm).description)
        tips = start - float(gripper_shape(robot).points[:, 2].max())
        fast = tips - float(fruit_points(hook.fruit)[:, 2].max()) - ABOVE
        if (
            yield from self._felt(vertical_way(self, -fast, "NO_STRAIGHT_LINE"), DOWN, hand, limit)
        ):
            words = f"the hand met {hand.change:.1f} N above the fruit: the crate, or a fruit that was not measured"
            raise self.failure("CONTACT", words, force_n=hand.change)
        yield from self._felt(
            vertical_way(self, fast + end - start, "NO_STRAIGHT_LINE"), TOUCHING, hand, limit
        )

    def _across(
        self,
        hook: Grasp,
        hand: ManoeuvreHand,
        limits: tuple[float, float],
        distance: float,
        speed: float,
    ) -> Work[float]:
        """Draw the fruit as it rolls, and return how far the finger came [m].

        Between steps the finger gives way, or sinks until it touches again: `limits` are of a touch and the pull [N].
        """
        touch, limit = limits
        pull = HookPull(hook, tool_pose(self)[:3, 3], limit)
        for place in pull.places(distance):
            hand.forget_change()
            manner = CREEPING if pull.is_held else Manner(speed, GENTLE, 10.0)
            at_limit = yield from self._felt(self.line_to(place), manner, hand, pull.limit)
            if not (at_edges := hand.edges > hand.bears):
                pull.off = yield from self._give_way(hand, pull.off, at_limit)
                pull.off = yield from self._sink(hand, touch, pull.off)
            came = tool_pose(self)[:3, 3]
            if at_edges or pull.ends(came, at_limit, hand.change, hand.downwards):
                if pull.came >= ENOUGH:
                    return pull.came
                raise self.failure(
                    "PULL_BLOCKED", pull.blocked, moved_m=pull.came, force_n=pull.most
                )
        if pull.most < LEAST:
            raise self.failure(
                "NOTHING_MOVED", "the finger touched nothing on its way: the fruit lies elsewhere"
            )
        return pull.way

    def _felt(self, way: Float64, manner: Manner, hand: ManoeuvreHand, limit: float) -> Work[bool]:
        """Follow a way until the hand feels a limit [N]; return True if it has. Nothing may push the outer faces."""
        stopped = yield from self.feel_way(way, manner, hand, limit, OUTER)
        self._press = max(self._press, hand.downwards)
        if stopped and hand.outer.pushed(OUTER):
            words = f"something pushes the fingers from outside with {hand.outer.force:.1f} N: the crate, or a neighbour"
            raise self.failure("CONTACT", words, force_n=hand.outer.force, moved_m=hand.outer.moved)
        return stopped

    def _give_way(self, hand: ManoeuvreHand, off: float, at_limit: bool = False) -> Work[float]:
        """Rise until the finger presses down less than `DOWNWARDS`; return the height over a rolling ball's way [m].

        After a limit it rises once at least: a fruit that is pressed less tips. More by a pull alone, and the rubber
        would slip over its shoulder.
        """
        while (at_limit or hand.downwards > DOWNWARDS) and off + RELIEF <= FARTHEST_OFF:
            at_limit = False
            yield from follow_way(
                self, self.line_to(tool_pose(self)[:3, 3] + [0.0, 0.0, RELIEF]), TOUCHING
            )
            yield from self.wait(SETTLE)
            off += RELIEF
        return off

    def _sink(self, hand: ManoeuvreHand, touch: float, off: float) -> Work[float]:
        """Sink until the finger touches the fruit again [N], where the wrist feels its tip. Return the height [m]."""
        deep = off + FARTHEST_OFF
        if hand.wrist is None or hand.present > LEAST or deep < RELIEF:
            return off
        begin = tool_pose(self)[:3, 3]
        hand.forget_change()
        yield from self._felt(self.line_to(begin - [0.0, 0.0, deep]), CREEPING, hand, touch)
        return off + float(tool_pose(self)[2, 3] - begin[2])
