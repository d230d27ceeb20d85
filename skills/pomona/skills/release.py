"""The skill Release."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, Hand, Workspace
from pomona.drivers.plain_hand import between
from pomona.executive.account import PUT_AWAY
from pomona.executive.ports import (
    LENGTH,
    SPEED,
    Acceleration,
    Length,
    Port,
    Speed,
)
from pomona.executive.skill import CellFacts, SkillFailure, Work
from pomona.executive.values.arrays import Float64
from pomona.executive.values.sections import Problem
from pomona.skills.geometry import apply, inverse
from pomona.skills.grip.hold import Hold, current_hold, take_over
from pomona.skills.motion.collision import Margins, fruit_points
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.carrying import rest_on_contact
from pomona.skills.shared.contact_check import BLOCKED, EXPECTED, Descent, Jolted, lower_to_support
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.held_fruit import HAND_DEVICES, is_held, is_pressed, note_press
from pomona.skills.shared.moving import CARRIED_ACCELERATION, POSE_FAILURES, PoseSkill, move_to_pose
from pomona.skills.shared.planning import Clearance, HeldGrasp, Obstacles, space_around
from pomona.skills.shared.straight_travel import Manner, follow_way, tool_pose, vertical_way
from pomona.skills.shared.touch import feels_support

LOWERING = Manner(0.3, 1.0, 10.0)  # of the fruit on its way to a known support
# acceleration [m/s²] and jerk [m/s³] where a support may be: with twice as much, inertia resembles a contact
TOUCHING = (0.5, 5.0)
NEAR = 0.012  # height over a known support at which lowering slows down [m]
COVERED = 0.017  # so far above it the fruit may count as met: its spheres protrude by 12 mm [m]
SETTLED = 0.003  # way over which the inertia of braking dies away then [m]
LANDING = 0.008  # speed where the fruit is known to stand [m/s]
RISING = Manner(1.0, 6.0, 80.0)  # of the empty gripper's way up
OPENING_SPEED = 0.1  # of the fingers while they release the fruit [m/s]
BESIDE = 0.005  # distance to the path below which an obstacle is the first contact [m]; farther walls are passed
# jolts after which lowering goes on; with more the load is too restless to show a contact
JOLTS = 3
RESUMED = 2e-3  # distance that is left below which lowering does not go on after a jolt [m]
UNFELT = "the cell has no force sensor, so a contact would not be measured; the fruit is still held"
UNKNOWN = "no grasp gives the lower end of the fruit"
RELEASED_WIDTH = 0.02  # width by which the fingers open beyond the fruit [m]
OFF = 0.004  # width beyond the fruit at which they rise [m]


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
        BLOCKED,
    )
    renamed_failures: ClassVar = {"NO_WAY_DOWN": BLOCKED}

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._placed: dict[tuple[str | None, int], MeasuredFruit] = {}  # by pose and variation

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
        speed: Annotated[
            Speed,
            Port(
                min="1 mm/s",
                max="0.04 m/s",
                help="speed of lowering where a support may be, and is not known",
            ),
        ] = SPEED("0.02 m/s"),
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
                # not around: a fruit lies at the first place
                into if variation == 1 else f"{into}_{variation}",
                1,
                map,
                grasp,
                clearance,
                avoiding=(
                    fruit
                    for (pose, at), fruit in self._placed.items()
                    if pose != into or at < variation
                ),
                carried_acceleration=acceleration,
            )
        gripper = self.device(Gripper)
        before = tool_pose(self)[2, 3]
        space = space_around(self, map, clearance)
        way = vertical_way(self, -depth, BLOCKED, space)
        ends_on = not feels_support(self)
        met = None if grasp is None else self._met(way, grasp, map, clearance)
        if ends_on:
            if met is None:
                below = f"no known object within {1e3 * depth:.0f} mm below"
                raise self.failure(
                    "NO_CONTACT", f"{UNKNOWN if grasp is None else below}, and {UNFELT}"
                )
            way = way[: met + 1]
        descent = Descent(way, Manner(speed, *TOUCHING))
        if met is not None and grasp is not None:
            descent = self._descent(way, met, self._stands(grasp), speed)
        yield from self._lower(descent, speed, depth, space, grasp, ends_on)
        if hold is not None:
            note_press(self, "the pads", 0.5 * hold.peaks[1], grasp.fruit if grasp else None)
        take_over(gripper)
        if grasp is not None:
            moved = tool_pose(self) @ inverse(grasp.T_base_grasp)
            self._placed[into, variation] = replace(
                grasp.fruit, T_base_fruit=moved @ grasp.fruit.T_base_fruit
            )
        yield from self._rise(self._opening(space), before, into is not None, ends_on)

    def _rise(self, width: float, before: float, is_place: bool, ends_on: bool) -> Watching:
        """Open the fingers [m]; rise to a height of the tool [m] once they are off the fruit, while they open on."""
        gripper = self.device(Gripper)
        start = gripper.state().width
        plain = self.optional_device(ForceSensor) is None
        yield from self._open(width if plain else min(width, start + OFF), start)
        if plain and (left := between(gripper.state(), gripper.limits)):
            raise self.failure(
                "HAND_UNCLEAR", f"after the fingers opened, {left}; the fruit may still be held"
            )
        opening = self._open(width, start)
        if not plain and is_pressed(self):  # soft pads
            yield from opening
        if is_place:
            by = "width over a known support" if ends_on else "pads or wrist, a support carries it"
            self.account(
                PUT_AWAY, f"{by}; the fingers are open, {1e3 * gripper.state().width:.0f} mm"
            )
        rise = before - tool_pose(self)[2, 3]
        try:
            yield from follow_way(
                self, vertical_way(self, rise, BLOCKED), RISING, lambda: next(opening, None)
            )
            yield from opening
        finally:
            opening.close()

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
        descent: Descent,
        speed: float,
        depth: float,
        space: ArmSpace,
        grasp: Grasp | None,
        ends_on: bool,
    ) -> Watching:
        """Go down until a support carries the fruit; after a jolt it goes on at a speed [m/s]."""
        before = float(tool_pose(self)[2, 3])
        opened = self.device(Gripper).state().width
        for jolts in range(1, JOLTS + 2):
            try:
                words = yield from lower_to_support(self, descent, grasp, opened, ends_on)
            except Jolted:
                words = f"the change of load on the way down has gone again {jolts} times, as after jolts"
                if (left := depth - before + float(tool_pose(self)[2, 3])) < RESUMED:
                    break
                descent = Descent(
                    vertical_way(self, -left, BLOCKED, space), Manner(speed, *TOUCHING)
                )
            else:
                if not words:
                    return
                break
        rest_on_contact(self, None)
        lowered = before - float(tool_pose(self)[2, 3])
        raise self.failure(
            "NO_CONTACT",
            f"{words} ({1e3 * lowered:.0f} mm down); the fruit is still held",
            lowered_m=lowered,
        )

    def _met(
        self, way: Float64, held: Grasp, map: OccupancyMap | None, clearance: float
    ) -> int | None:
        """Return the first posture at which the fruit is within `BESIDE` of an object; None if there is none."""
        space = space_around(self, map, clearance, held=held)
        world = space.world.with_margins(Margins(0.0, 0.0, 0.0, BESIDE, 0.0))
        met = np.flatnonzero(~world.free(way, space.width))
        return int(met[0]) if len(met) else None

    def _stands(self, grasp: Grasp) -> float:
        """Return the height of the tool at which the fruit stands on the known box or table below [m]; NaN without.

        Exactly: the spheres that cover a fruit in `_met` protrude by up to 12 mm.
        """
        T_base_tcp = tool_pose(self)
        points = apply(T_base_tcp @ inverse(grasp.T_base_grasp), fruit_points(grasp.fruit))
        lowest = points[points[:, 2].argmin()]
        workspace = self.device(Workspace)
        tops = [] if workspace.table_z is None else [workspace.table_z]
        for box in workspace.obstacles:
            beside = np.abs(apply(inverse(box.T_base_box), lowest)) - box.half_extents
            if box.T_base_box[2, 2] > 0.999 and max(beside[:2]) <= 0.0:
                tops.append(box.T_base_box[2, 3] + box.half_extents[2])
        below = [top for top in tops if top < lowest[2]]
        return float(max(below, default=np.nan) + T_base_tcp[2, 3] - lowest[2])

    def _heights(self, way: Float64) -> Float64:
        """Return heights of the tool [m] in postures."""
        robot = RobotModel.load(self.device(Arm).description)
        return np.array([robot.tcp(q)[2, 3] for q in way])

    def _descent(self, way: Float64, met: int, stands: float, speed: float) -> Descent:
        """Return the way down that is fast until shortly before the first contact, then slow."""
        heights = self._heights(way)
        if not heights[met] <= stands + COVERED:  # something else is met first
            stands = np.nan
        near = NEAR + (heights[met] if np.isnan(stands) else stands)
        at = np.arange(heights[0], heights[-1], -5e-4)
        most = np.where(at > near, LOWERING.speed, speed)
        most[np.abs(at - stands) < EXPECTED] = min(speed, LANDING)
        slow_below = near - SETTLED if np.isnan(stands) else stands + EXPECTED
        return Descent(way, LOWERING, most, slow_below, stands)

    def _open(self, width: float, start: float) -> Watching:
        """Open the fingers from and to a width [m]; once off the fruit, something beside it may block them."""
        gripper = self.device(Gripper)
        try:
            yield from self.move_fingers(width, min(OPENING_SPEED, gripper.limits.speed_max))
        except SkillFailure as failed:
            released = gripper.state().width - start > OFF - 1e-3
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
