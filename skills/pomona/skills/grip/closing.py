"""Closing on the fruit and raising the force, until the fruit is held or the grip has failed.

The pads close on a fruit whose place and size the camera has measured. The first touch shows its place along the
fingers' axis, the second its width. Records hold both for every pick, so that a calibration can be compared with them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pomona.drivers.interfaces import GripperState
from pomona.executive.values.arrays import Float64
from pomona.executive.values.units import FORCE, LENGTH, TIME, Array
from pomona.skills.grip.grip import GripMode, GripProblem
from pomona.skills.grip.monitors import GripState
from pomona.skills.grip.reference import ForceReference
from pomona.skills.grip.sensor import Timer
from pomona.skills.grip.settings import GripSettings
from pomona.skills.grip.tracking import ForceTracker


class Closing:
    """Speed of the fingers in the modes CLOSING and RAMP, once a command; STANDING or FAILED ends it.

    Attributes:
        problem: why it failed.
    """

    def __init__(
        self,
        settings: GripSettings,
        reference: ForceReference,
        tracker: ForceTracker,
        interval: float,
    ) -> None:
        """Take the time between two commands [s] besides the parts of the grip."""
        self.problem: GripProblem | None = None
        self._settings = settings
        self._reference = reference
        self._tracker = tracker
        self._interval = interval
        self._stuck, self._gone, self._reached = Timer(), Timer(), Timer()
        self._touched_at = self._last_width = math.nan

    def command(self, now: GripState, speed: float) -> float:
        """Return the rate of the opening [m/s].

        Args:
            now: state of the grip.
            speed: rate commanded before [m/s].
        """
        wanted = (
            self._ramp(now, speed)
            if self._reference.mode is GripMode.RAMP
            else self._close(now, speed)
        )
        self._last_width = now.width
        return wanted

    def fail(self, problem: GripProblem) -> float:
        """End with a problem and return the speed of fingers at rest [m/s]."""
        self._reference.fail()
        self.problem = problem
        return 0.0

    def _close(self, now: GripState, speed: float) -> float:
        s = self._settings
        estimate = now.estimate
        width = now.width
        touch = (estimate.left > s.watch.contact, estimate.right > s.watch.contact)
        if all(touch):
            self._reference.begin(estimate.f_n)
            return 0.0
        if any(touch) and math.isnan(self._touched_at):
            self._touched_at = width
        at_end = width <= max(s.width_min + s.watch.stroke_end, s.narrowest)
        pushed = 0.5 * (self._touched_at - width)
        if any(touch) and (
            pushed > s.off_centre or estimate.stronger > s.watch.push_limit or at_end
        ):
            message = (
                f"only the {('left', 'right')[touch[1]]} finger touches: it pushed the fruit "
                f"{1e3 * pushed:.1f} mm with {estimate.stronger:.1f} N"
            )
            return self.fail(now.problem("ONE_FINGER", message, pushed=pushed, width=width))
        if at_end:
            words = f"no finger touched anything down to an opening of {1e3 * width:.1f} mm: the fruit has moved, or"
            message = f"{words} camera or tool are not where the cell file has them"
            return self.fail(now.problem("NO_CONTACT", message, width=width))
        if self._is_stuck(now, speed):
            message = "the fingers do not move although they are commanded to close"
            return self.fail(now.problem("NO_CONTACT", message, width=width))
        braking = s.approach_speed * s.loop.command_period * 2.0
        if s.contact_width is not None and not any(touch) and width - s.contact_width > braking:
            return -s.approach_speed
        return -s.contact_speed

    def _ramp(self, now: GripState, speed: float) -> float:
        s = self._settings
        estimate = now.estimate
        if now.width <= s.width_min + s.watch.stroke_end and estimate.f_n < s.initial_force - 0.2:
            message = (
                f"the gripper's stroke ends at {1e3 * now.width:.1f} mm with {estimate.f_n:.1f} N"
            )
            return self.fail(
                now.problem("OUT_OF_STROKE", message, width=now.width, f_n=estimate.f_n)
            )
        if (
            self._gone.update(estimate.weaker < s.watch.gone, self._interval)
            > 2.0 * s.watch.gone_after
        ):
            # A fruit that one finger pushes may hop to the other one and back: closing goes on, with its bounds.
            if estimate.stronger > s.watch.contact:
                self._reference.close()
                return 0.0
            return self.fail(
                now.problem(
                    "NO_CONTACT", "the fruit slipped away while the force rose", width=now.width
                )
            )
        f_ref = self._reference.ramp(self._interval)
        is_reached = f_ref >= s.initial_force and estimate.f_n >= 0.9 * s.initial_force
        if self._reached.update(is_reached, self._interval) > 1.5 * self._interval:
            self._reference.stand(estimate.load)
        elif f_ref >= s.initial_force and not is_reached and self._is_stuck(now, speed):
            message = f"the fingers stand still at {estimate.f_n:.1f} N and do not reach {s.initial_force:.1f} N"
            return self.fail(now.problem("FORCE_LIMIT", message, f_n=estimate.f_n, f_ref=f_ref))
        return min(self._tracker.on_ramp(f_ref, estimate.f_n, speed), 0.0)

    def _is_stuck(self, now: GripState, speed: float) -> bool:
        """Return True when fingers that should close have not moved for `stuck_after`."""
        stands = speed < -1e-3 and abs(now.width - self._last_width) < 1e-5
        return self._stuck.update(stands, self._interval) > self._settings.watch.stuck_after


TOUCH = 0.4  # change of a pad's force that counts as a touch [N]: twice the largest error of the real fingers
LASTING = 3  # number of successive samples that confirm a touch: one sample may be a spike
OLDEST = 0.05  # age of the gripper's state up to which its width is carried on with its speed [s]

Pose = Annotated[Float64, Array(4, 4)]


@dataclass(frozen=True, slots=True)
class PadTouch:
    """The first touch of a pad."""

    stamp: Annotated[float, TIME]  # of the sample, on the cell's clock [s]
    width: Annotated[float, LENGTH]  # opening between the pads' faces, which have given way [m]
    force: Annotated[
        float, FORCE
    ]  # force on this pad, the bias removed [N]; of a plain gripper, its motor's


@dataclass(frozen=True, slots=True, eq=False)
class PickTouches:
    """Touches of one pick, with the measured fruit and the poses that belong to them."""

    fruit: str  # kind of the fruit
    left: PadTouch | None  # the finger on the side of the tool's y axis; None: it felt nothing
    right: PadTouch | None  # the other finger
    closed: (
        PadTouch | None
    )  # where a plain gripper has stopped on the fruit: it does not feel its pads one by one
    T_base_tcp: Pose  # the tool during the touches: z approach, y from the right to the left finger
    T_base_fruit: Pose  # the fruit as the camera has measured it
    T_base_camera: Pose  # the camera at that look
    T_mount_camera: Pose  # the camera in its mount, as the look had it
    on_arm: bool  # True: the mount is the arm's flange, else the base frame
    dimensions: Annotated[Float64, Array(3, of=LENGTH)]  # of the measured fruit [m]
    # distances of the measured skin from the tool's centre along its y axis, left and right [m]
    skin: Annotated[Float64, Array(2, of=LENGTH)]
    table: Annotated[Float64, Array(2, 4)] | None  # `SeenTable.planes` of that look
    # of a finger that landed on the fruit on the approach: way from the measured skin to it, in the base frame
    landed: Annotated[Float64, Array(3, of=LENGTH)] | None = None


class TouchRecorder:
    """Finds the first touch of each pad in the samples of a closing.

    Attributes:
        touches: of the left and the right pad; None until it has touched.
    """

    def __init__(self, stiffness: float) -> None:
        """Take the pads' stiffness [N/m]: a fruit that one pad pushes along presses it in before the other touches."""
        self._stiffness, self.touches = stiffness, list[PadTouch | None]([None, None])
        self._begun: list[PadTouch | None] = [None, None]
        self._count = [0, 0]

    @property
    def complete(self) -> bool:
        """True when both pads have touched."""
        return None not in self.touches

    def take(self, stamp: float, wrenches: Float64, state: GripperState) -> None:
        """Take one sample.

        Args:
            stamp: its time [s].
            wrenches: of both pads without their bias, shape (2, 6) [N, N·m].
            state: newest state of the gripper.
        """
        forces = np.sqrt((wrenches[:, :3] ** 2).sum(axis=1))
        for side in range(2):
            if not forces[side] > TOUCH:
                self._count[side] = 0
                continue
            self._count[side] += 1
            if self._count[side] == 1:
                moved = state.speed * min(max(stamp - state.stamp, 0.0), OLDEST)
                width = (
                    state.width + moved + max(0.0, -float(wrenches[:, 2].sum())) / self._stiffness
                )
                self._begun[side] = PadTouch(stamp, float(width), float(forces[side]))
            if self._count[side] == LASTING and self.touches[side] is None:
                self.touches[side] = self._begun[side]


def skin_along(points: Float64, T_base_tcp: Float64) -> Float64:
    """Return the distances of a shape's skin from the tool's centre along its y axis, left and right, shape (2,) [m].

    Args:
        points: of the shape in the base frame, shape (n, 3) [m].
        T_base_tcp: pose of the tool, shape (4, 4).
    """
    along = (points - T_base_tcp[:3, 3]) @ T_base_tcp[:3, 1]
    return np.array([along.max(), -along.min()])
