"""The skill Release."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, Hand, Workspace
from pomona.executive.ports import ANGLE, FORCE, LENGTH, SPEED, Angle, Force, Length, Port, Speed
from pomona.executive.skill import CellFacts, Work
from pomona.executive.values.arrays import Float64
from pomona.executive.values.sections import Problem
from pomona.skills.grip.hold import Hold, current_hold, take_over
from pomona.skills.motion.collision import Margins
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.arm_space import ArmSpace, arm_space
from pomona.skills.motion.planning.timing import time_curve
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.straight_line import straight_line
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill, Watching
from pomona.skills.shared.grip_view import show_grip
from pomona.skills.shared.live_watch import prepare_watch
from pomona.skills.shared.moving import POSE_FAILURES, move_to_pose
from pomona.skills.shared.named_pose import judge_pose, offered_poses
from pomona.skills.shared.touch import HELD_FORCE, Touch, load, pressing_forces, something_between
from pomona.skills.shared.usable_map import usable_field
from pomona.skills.shared.warm_motion import prepare_planning

ACCELERATION, JERK = 0.5, 5.0
"""Of lowering [m/s², m/s³]: with twice as much the fruit's own inertia feels like a contact."""
RISING, RISING_JERK = 1.5, 15.0
"""Of the empty gripper's way up [m/s², m/s³]."""
RAISING_SPEED = 0.02
"""Of being raised a little from what carries it [m/s]."""
OPENING_SPEED = 0.05
"""Of the opening while the fruit is let go [m/s]."""
SLOW_WITHIN = 0.015
"""Way of the fruit to what it will meet at which lowering slows down [m]: more than its measured height and what it has
slid in the fingers are wrong together."""
BESIDE = 0.005
"""What is nearer than this to the fruit's way may be met [m]; a wall that is farther is passed."""
RESTING = 0.1
"""So long after the arm has come to rest a fruit that is carried must still weigh less [s]: a jolt is over then."""
RAISED = 0.002
"""So far it is then raised again: from a floor it hangs as before, while what only drifts goes on as it did [m]."""
LOST = "the fruit was lost on the way down: it presses on neither finger"
RELEASED_WIDTH = 0.02
"""How much wider than the fruit the fingers open before they rise [m]."""


class _Grounded(Exception):
    """The fruit touched something below."""


class Release(MovingSkill):
    """Put a held fruit down: lower it until it touches, open gently, rise again.

    The fingers open only after the fruit has met something that carries it. When it meets nothing within `depth`, or
    before the gripper itself would come too near to something, the fruit stays held and the skill fails: nothing is
    dropped.
    """

    devices = (Arm, Gripper, ForceSensor, Workspace)
    optional_devices = (*MovingSkill.optional_devices, Hand)
    moves = (Arm, Gripper)
    failures = (*MOTION_FAILURES, *POSE_FAILURES, "NOT_HELD", "HAND_UNCLEAR", "LOST", "NO_CONTACT", "LOWERING_BLOCKED")
    renamed_failures: ClassVar = {"NO_WAY_DOWN": "LOWERING_BLOCKED"}

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Where to must be a pose of the cell."""
        return judge_pose("into", known, cell)

    @classmethod
    def offers(cls, port: str, cell: CellFacts | None) -> tuple[str, ...]:
        """The cell's poses."""
        return offered_poses(cell) if port == "into" else ()

    def prepare(self) -> None:
        prepare_planning(self)
        prepare_watch(self)

    def run(
        self,
        into: Annotated[
            str | None, Port(help="a pose of the cell file to go to first, above where the fruit is put")
        ] = None,
        variation: Annotated[int, Port(min=1, help="1 is the pose itself, 2 its pose_2 and so on, around")] = 1,
        depth: Annotated[Length, Port(min="1 mm", max="1 m", help="how far down to search for a support")] = LENGTH(
            "150 mm"
        ),
        grasp: Annotated[
            Grasp | None, Port(help="the grasp by which the fruit is held: it is then part of the robot on the way")
        ] = None,
        hold: Annotated[Hold | None, Port(help="the grip that goes on until the fruit is released")] = None,
        map: Annotated[OccupancyMap | None, Port(help="what is in the way")] = None,
        clearance: Annotated[
            Length, Port(min="0 mm", help="kept by the links; gripper and fingers keep a share")
        ] = LENGTH("5 mm"),
        upright: Annotated[
            Angle, Port(min="1 deg", max="180 deg", help="the fruit is tilted by no more than this on the way")
        ] = ANGLE("180 deg"),
        contact: Annotated[Force, Port(min="0.1 N", help="change of load that shows contact")] = FORCE("0.35 N"),
        speed: Annotated[Speed, Port(min="1 mm/s", max="0.1 m/s", help="at which the fruit is lowered")] = SPEED(
            "0.02 m/s"
        ),
        fast: Annotated[Speed, Port(min="1 mm/s", max="0.5 m/s", help="used while nothing known is near")] = SPEED(
            "0.25 m/s"
        ),
    ) -> Work[None]:
        if not self._held():
            raise self._not_held()
        if into is not None:
            yield from move_to_pose(self, into, variation, map, grasp, clearance, upright=upright)
        gripper, before = self.device(Gripper), self._tcp()[2, 3]
        way = self._vertical(-depth, map, clearance)
        slow_from = self._near(way, grasp, map, clearance)
        yield from self._lower((way[: slow_from + 1], fast), (way[slow_from:], speed), hold, grasp, contact)
        width = self._opening(map, clearance)
        take_over(gripper)
        yield from self.move_fingers(width, min(OPENING_SPEED, gripper.limits.speed_max))
        yield from self._along(self._vertical(before - self._tcp()[2, 3]), fast, None, RISING, RISING_JERK)
        return None

    def _not_held(self) -> Exception:
        """Nothing is felt: the state of the hand decides whether that means that nothing is there."""
        hand = None if current_hold(self.device(Gripper)) is not None else self.optional_device(Hand)
        held = None if hand is None else hand.in_hand()
        if held:
            return self.failure("HAND_UNCLEAR", f"{held}; it cannot be put down, since no contact would be felt")
        return self.failure("NOT_HELD", "there is nothing between the fingers to put down")

    def _held(self) -> bool:
        hold = current_hold(self.device(Gripper))
        if hold is not None:
            return hold.holds
        return something_between(self.device(Gripper), self.device(ForceSensor))

    def _lower(
        self,
        quickly: tuple[Float64, float],
        gently: tuple[Float64, float],
        hold: Hold | None,
        grasp: Grasp | None,
        contact: float,
    ) -> Watching:
        """Down along two ways with their speeds until the load on the pads changes: something carries the fruit."""
        before = float(self._tcp()[2, 3])
        with Touch(self.device(ForceSensor), load) as touch:

            def watch() -> None:
                if hold is not None:
                    show_grip(self, hold)
                if touch.change > contact:  # asked first: a floor's push may take the pressing force from a finger
                    raise _Grounded
                if not self._held():
                    raise self.failure("LOST", LOST)

            try:
                yield from self._along(*quickly, watch, held=grasp)
                yield from self._along(*gently, watch, held=grasp)
            except _Grounded:
                words = yield from self._doubt_contact(touch, contact)
                if not words:
                    return
                lowered = before - float(self._tcp()[2, 3])
                raise self.failure("NO_CONTACT", f"{words}: the fruit is still held", lowered_m=lowered) from None
        lowered = before - float(self._tcp()[2, 3])
        raise self.failure(
            "NO_CONTACT", f"the fruit met nothing within {1e3 * lowered:.0f} mm and is still held", lowered_m=lowered
        )

    def _doubt_contact(self, touch: Touch, contact: float) -> Work[str]:
        """Return why what was felt is no contact with a floor; empty for a fruit that something carries.

        The fingers stand meanwhile: force control would answer a floor's push by pressing harder. It goes on unless the
        fruit is carried.
        """
        hold, carried = current_hold(self.device(Gripper)), False
        if hold is not None:
            hold.stand(True)
        try:
            yield from self.wait(RESTING)
            self._refuse_lost()
            if touch.present <= 0.5 * contact or touch.stale_for(self.clock.now()):
                return "what was felt on the way down has gone again, as after a jolt"
            if (yield from self._hangs_when_raised(touch, contact)):
                carried = True
                return ""
            self._refuse_lost()
            return "what was felt stays when the fruit is raised again: the fingers drift"
        finally:
            if hold is not None and not carried:
                hold.stand(False)

    def _refuse_lost(self) -> None:
        if max(pressing_forces(self.device(ForceSensor))) <= HELD_FORCE:
            raise self.failure("LOST", LOST) from None

    def _hangs_when_raised(self, touch: Touch, contact: float) -> Work[bool]:
        """Whether what is felt goes back, at least by half a contact, while the fruit is raised from what carries it.

        Ends where it began. Sensors that drift, grow or are told a bias in between do not go back with a motion.
        """
        below = touch.average()
        yield from self._along(self._vertical(RAISED), RAISING_SPEED)
        yield from self.wait(RESTING)
        raised = touch.average()
        yield from self._along(self._vertical(-RAISED), RAISING_SPEED)
        return touch.gone_back(below, raised) > 0.5 * contact

    def _near(self, way: Float64, grasp: Grasp | None, map: OccupancyMap | None, clearance: float) -> int:
        """From which posture of the way on the fruit is near to what it will meet; 0 when nothing is known of that."""
        if grasp is None:
            return 0
        space = self._space(map, clearance, grasp)
        world = space.world.with_margins(Margins(0.0, 0.0, 0.0, BESIDE, 0.0))
        met = np.flatnonzero(~world.free(way, space.width))
        if not len(met):
            return 0
        robot = RobotModel.load(self.device(Arm).description)
        heights = np.array([robot.tcp(q)[2, 3] for q in way[: met[0] + 1]])
        return int(np.flatnonzero(heights <= heights[-1] + SLOW_WITHIN)[0])

    def _opening(self, map: OccupancyMap | None, clearance: float) -> float:
        """How wide to open: as much less as it takes not to touch what is beside the fruit."""
        gripper, q = self.device(Gripper), self.device(Arm).state().q
        widths = [min(gripper.state().width + RELEASED_WIDTH / part, gripper.limits.width_max) for part in (1, 2, 4)]
        space = self._space(map, clearance)
        return next((width for width in widths if space.at_width(width).free(q)), widths[-1])

    def _vertical(self, rise: float, map: OccupancyMap | None = None, clearance: float | None = None) -> Float64:
        """Postures straight up (or down, for a negative rise) as far as the arm reaches, shape (n, dof).

        With a clearance they end where the gripper (not the fruit, which is to touch) would come too near to something.
        The way up is the one that it came, and free.
        """
        arm = self.device(Arm)
        T_base_goal = self._tcp()
        T_base_goal[2, 3] += rise
        line = straight_line(RobotModel.load(arm.description), arm.state().q, T_base_goal)
        way, ends = line.q, line.reason
        if clearance is not None:
            space = self._space(map, clearance)
            blocked = space.first_blocked(way)
            if blocked is not None:
                way, ends = way[: blocked + 1], space.explain(way[blocked + 1])[0]
        if len(way) < 4:
            raise self.failure("LOWERING_BLOCKED", f"the gripper cannot move vertically: {ends}")
        return way

    def _along(
        self,
        way: Float64,
        speed: float,
        watch: Callable[[], None] | None = None,
        acceleration: float = ACCELERATION,
        jerk: float = JERK,
        held: Grasp | None = None,
    ) -> Watching:
        """Follow postures on a straight line of the tool."""
        arm = self.device(Arm)
        robot = RobotModel.load(arm.description)
        length = float(np.linalg.norm(robot.tcp(way[-1])[:3, 3] - robot.tcp(way[0])[:3, 3]))
        if length > 0.0:
            curve = time_curve(way, length, arm.limits, speed, acceleration, jerk)
            yield from self.travel(curve, watch, carrying=held)

    def _space(self, map: OccupancyMap | None, clearance: float, held: Grasp | None = None) -> ArmSpace:
        width = self.device(Gripper).state().width
        field = usable_field(self, map)
        return arm_space(self.device(Arm), self.device(Workspace), field, width, clearance, held=held)

    def _tcp(self) -> Float64:
        arm = self.device(Arm)
        return RobotModel.load(arm.description).tcp(arm.state().q)
