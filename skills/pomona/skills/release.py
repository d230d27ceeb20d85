"""The skill Release."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, Hand, Workspace
from pomona.drivers.plain_hand import between
from pomona.executive.account import PUT_AWAY
from pomona.executive.ports import (
    ANGLE,
    FORCE,
    LENGTH,
    SPEED,
    Acceleration,
    Force,
    Length,
    Port,
    Speed,
)
from pomona.executive.skill import CellFacts, SkillFailure, Work
from pomona.executive.values.arrays import Float64
from pomona.executive.values.sections import Problem
from pomona.skills.grip.hold import Hold, current_hold, take_over
from pomona.skills.motion.collision import Margins
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.robot import RobotModel
from pomona.skills.shared.contact_check import Jolted, Leg, lower_to_support
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.held_fruit import HAND_DEVICES, is_held, note_press
from pomona.skills.shared.moving import CARRIED_ACCELERATION, POSE_FAILURES, PoseSkill, move_to_pose
from pomona.skills.shared.planning import Clearance, HeldGrasp, Obstacles, Tilt, space_around
from pomona.skills.shared.straight_travel import Manner, follow_way, tool_pose, vertical_way
from pomona.skills.shared.touch import feels_support

LOWERING = (1.0, 10.0)  # acceleration [m/s²] and jerk [m/s³] of the fruit while nothing is near
TOUCHING = (0.5, 5.0)  # the same near its support: with twice as much, inertia resembles a contact
RISING = Manner(0.5, 3.0, 30.0)  # of the empty gripper's way up
OPENING_SPEED = 0.05  # of the fingers while they release the fruit [m/s]
BESIDE = 0.005  # distance to the path below which an obstacle is the first contact [m]; farther walls are passed
# jolts after which lowering goes on; with more the load is too restless to show a contact
JOLTS = 3
RESUMED = 2e-3  # distance that is left below which lowering does not go on after a jolt [m]
UNFELT = "the cell has no force sensor, so a contact would not be measured; the fruit is still held"
UNKNOWN = "no grasp gives the lower end of the fruit"
RELEASED_WIDTH = 0.02  # width by which the fingers open beyond the fruit before they rise [m]


class Release(PoseSkill):
    """Put a held fruit down: lower it until it touches, open gently, rise again.

    Without a support within `depth`, or with an obstacle too near, the fruit stays held and the skill fails.

    Without force fingers and a fine load sensor no contact is measured: the fruit is lowered to the known object below
    it and falls the last `BESIDE`. Without a `grasp` its lower end is unknown, and it stays held.
    """

    devices = (Arm, Gripper, Workspace)
    optional_devices = (*MovingSkill.optional_devices, *HAND_DEVICES)
    moves = (Arm, Gripper)
    pose_port = "into"
    failures = (
        *MOTION_FAILURES,
        *POSE_FAILURES,
        "NOT_HELD",
        "HAND_UNCLEAR",
        "LOST",
        "NO_CONTACT",
        "LOWERING_BLOCKED",
    )
    renamed_failures: ClassVar = {"NO_WAY_DOWN": "LOWERING_BLOCKED"}

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Check that the cell has the pose, and as many places as the tree counts on."""
        yield from super().judge(known, cell)
        workspace = None if cell is None else cell.known(Workspace)
        into = known.get("into")
        places = [f"{into}_{k}" for k in range(2, (known.get("places") or 1) + 1)]
        if (
            cell is not None
            and workspace is not None
            and (lacking := [p for p in places if p not in workspace.poses])
        ):
            message = f"it counts on {len(places) + 1} places, and the cell '{cell.name}' has no pose '{lacking[0]}'"
            yield Problem(
                "places", message, "lower `places`, or add the pose below `workspace.poses`"
            )

    def run(
        self,
        into: Annotated[
            str | None,
            Port(
                help="pose of the cell file above the place for the fruit; the arm moves there first"
            ),
        ] = None,
        variation: Annotated[
            int, Port(min=1, help="place: 1 is the pose itself, 2 its pose_2 and so on")
        ] = 1,
        places: Annotated[
            int, Port(min=1, help="number of such poses that the cell must have before the run")
        ] = 1,
        depth: Annotated[
            Length, Port(min="1 mm", max="1 m", help="maximum distance of lowering")
        ] = LENGTH("150 mm"),
        grasp: HeldGrasp = None,
        hold: Annotated[
            Hold | None, Port(help="grip that continues until the fruit is released")
        ] = None,
        map: Obstacles = None,
        clearance: Clearance = LENGTH("5 mm"),
        upright: Tilt = ANGLE("180 deg"),
        contact: Annotated[
            Force, Port(min="0.1 N", help="change of load that shows contact")
        ] = FORCE("0.35 N"),
        speed: Annotated[
            Speed, Port(min="1 mm/s", max="0.1 m/s", help="speed of lowering")
        ] = SPEED("0.02 m/s"),
        fast: Annotated[
            Speed, Port(min="1 mm/s", max="0.5 m/s", help="speed while no known object is near")
        ] = SPEED("0.15 m/s"),
        slow_within: Annotated[
            Length,
            Port(
                min="5 mm",
                max="200 mm",
                help="height over the known support at which lowering slows down",
            ),
        ] = LENGTH("15 mm"),
        acceleration: Annotated[
            Acceleration,
            Port(
                min="0.5 m/s²",
                max="5 m/s²",
                help="maximum acceleration of the held fruit on the way to the pose",
            ),
        ] = CARRIED_ACCELERATION,
    ) -> Work[None]:
        if not is_held(self):
            raise self._not_held()
        if into is not None:
            yield from move_to_pose(
                self,
                into
                if variation == 1
                else f"{into}_{variation}",  # not around: a fruit lies at the first place
                1,
                map,
                grasp,
                clearance,
                upright=upright,
                carried_acceleration=acceleration,
            )
        gripper = self.device(Gripper)
        before = tool_pose(self)[2, 3]
        space = space_around(self, map, clearance)
        way = vertical_way(self, -depth, "LOWERING_BLOCKED", space)
        ends_on = not feels_support(self)
        met = None if grasp is None else self._met(way, grasp, map, clearance)
        if ends_on:
            if met is None:
                words = (
                    UNKNOWN
                    if grasp is None
                    else f"no known object within {1e3 * depth:.0f} mm below"
                )
                raise self.failure("NO_CONTACT", f"{words}, and {UNFELT}")
            way = way[: met + 1]
        slow_from = self._near(way, met, slow_within)
        legs = (
            Leg(way[: slow_from + 1], Manner(fast, *LOWERING)),
            Leg(way[slow_from:], Manner(speed, *TOUCHING)),
        )
        yield from self._lower(legs, depth, space, hold, grasp, contact, ends_on)
        width = self._opening(space)
        if hold is not None:
            note_press(self, "the pads", 0.5 * hold.peaks[1], grasp.fruit if grasp else None)
        take_over(gripper)
        yield from self._open(width)
        if self.optional_device(ForceSensor) is None and (
            left := between(gripper.state(), gripper.limits)
        ):
            raise self.failure(
                "HAND_UNCLEAR", f"after the fingers opened, {left}; the fruit may still be held"
            )
        if into is not None:
            by = "width over a known support" if ends_on else "pads or wrist, a support carries it"
            self.account(
                PUT_AWAY, f"{by}; the fingers are open, {1e3 * gripper.state().width:.0f} mm"
            )
        yield from follow_way(
            self, vertical_way(self, before - tool_pose(self)[2, 3], "LOWERING_BLOCKED"), RISING
        )

    def _not_held(self) -> Exception:
        """Return NOT_HELD, or HAND_UNCLEAR if the hand may hold a fruit that the fingers do not measure."""
        hand = (
            None if current_hold(self.device(Gripper)) is not None else self.optional_device(Hand)
        )
        held = None if hand is None else hand.in_hand()
        if held:
            return self.failure(
                "HAND_UNCLEAR",
                f"{held}; it cannot be put down, since a contact would not be measured",
            )
        return self.failure("NOT_HELD", "there is nothing between the fingers to put down")

    def _lower(
        self,
        legs: Sequence[Leg],
        depth: float,
        space: ArmSpace,
        hold: Hold | None,
        grasp: Grasp | None,
        contact: float,
        ends_on: bool,
    ) -> Watching:
        """Go down along legs until a support carries the fruit; after a jolt it goes on."""
        before = float(tool_pose(self)[2, 3])
        opened = self.device(Gripper).state().width
        for jolts in range(1, JOLTS + 2):
            try:
                words = yield from lower_to_support(
                    self, legs, hold, grasp, contact, "LOWERING_BLOCKED", opened, ends_on
                )
            except Jolted:
                words = f"the change of load on the way down has gone again {jolts} times, as after jolts"
                if (left := depth - before + float(tool_pose(self)[2, 3])) < RESUMED:
                    break
                legs = [Leg(vertical_way(self, -left, "LOWERING_BLOCKED", space), legs[-1].manner)]
            else:
                if not words:
                    return
                break
        if (held := current_hold(self.device(Gripper))) is not None:
            held.rest_on_contact(None)
        lowered = before - float(tool_pose(self)[2, 3])
        message = f"{words} ({1e3 * lowered:.0f} mm down); the fruit is still held"
        raise self.failure("NO_CONTACT", message, lowered_m=lowered)

    def _met(
        self, way: Float64, held: Grasp, map: OccupancyMap | None, clearance: float
    ) -> int | None:
        """Return the first posture at which the fruit is within `BESIDE` of an object; None if there is none."""
        space = space_around(self, map, clearance, held=held)
        world = space.world.with_margins(Margins(0.0, 0.0, 0.0, BESIDE, 0.0))
        met = np.flatnonzero(~world.free(way, space.width))
        return int(met[0]) if len(met) else None

    def _near(self, way: Float64, met: int | None, within: float) -> int:
        """Return the first posture at which the fruit is so near to its first contact [m]; 0 if that is unknown."""
        if met is None:
            return 0
        robot = RobotModel.load(self.device(Arm).description)
        heights = np.array([robot.tcp(q)[2, 3] for q in way[: met + 1]])
        return int(np.flatnonzero(heights <= heights[-1] + within)[0])

    def _open(self, width: float) -> Watching:
        """Open the fingers to a width [m]; something beside the fruit may block them once they have released it."""
        gripper = self.device(Gripper)
        start = gripper.state().width
        try:
            yield from self.move_fingers(width, min(OPENING_SPEED, gripper.limits.speed_max))
        except SkillFailure as failed:
            released = gripper.state().width - start > RELEASED_WIDTH / 4.0 - 1e-3
            if failed.failure.code != "MOTION_FAILED" or not released:
                raise

    def _opening(self, space: ArmSpace) -> float:
        """Return the largest opening that touches nothing beside the fruit [m]."""
        gripper = self.device(Gripper)
        widths = [
            min(gripper.state().width + RELEASED_WIDTH / part, gripper.limits.width_max)
            for part in (1, 2, 4)
        ]
        return next(
            (width for width in widths if space.at_width(width).free(self.device(Arm).state().q)),
            widths[-1],
        )
