"""The skill Grasp."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pomona.drivers.interfaces import (
    ForceSensor,
    Gripper,
    GripperLimits,
    GripperState,
    PressSensor,
)
from pomona.drivers.plain_hand import between, gone
from pomona.executive.ports import FORCE, LENGTH, SPEED, Force, Length, Port, Speed
from pomona.executive.skill import CellFacts, SkillFailure, Work
from pomona.executive.values.sections import Problem
from pomona.skills.grip.closing import PadTouch
from pomona.skills.grip.hold import take_over
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.following import (
    MOTION_FAILURES,
    MovingSkill,
    Watching,
)
from pomona.skills.shared.held_fruit import bearable_force
from pomona.skills.shared.live_watch import LiveWatch, watched
from pomona.skills.shared.touch import pressing_forces, something_between
from pomona.skills.shared.touch_view import record_touches

NARROWEST = 0.5  # smallest width of a fruit between the fingers, relative to its smallest dimension
WIDEST = 8e-3  # width over the fruit's largest dimension at which something else is between the fingers [m]
LEAST_WAY = 1e-3  # distance that the fingers must be able to close before they meet the fruit [m]
# distance of the aim to the closed gripper [m]: twice that of fingers that hold nothing
AIMED = 4e-3
DEFAULT_FORCE = FORCE("10 N")
SETTLE = 0.3  # time before the grip is verified [s]
CREEP = 2e-3  # change of the width in that time after which the fruit may slip out [m]

UNMEASURED = (
    "the cell has no force sensor: no minimum grip force and no slip detection; the gripper's own force limit bounds "
    "the force on the fruit, and the port `force` where the driver obeys it"
)

PRESSED_ALONE = (
    "the fingertips measure pressing force alone: no load along the pads, so no minimum grip force and no slip "
    "detection; the port `force` bounds the force on the fruit"
)


class PressedEnough(Exception):
    """The motor or the fingertips press with the force that was asked for."""


class Grasp(MovingSkill):
    """Close a plain gripper on the fruit until it is stopped or its motor presses with `force`, and verify the grip.

    A fruit is gripped if the fingers were stopped before their aim, or the motor presses, and both still hold after
    `SETTLE`. The force on the fruit is not controlled, and slip is not measured. Fingertips that measure their pressing
    force take the motor's place.
    """

    devices = (Gripper,)
    optional_devices = (
        *MovingSkill.optional_devices,
        PressSensor,
    )
    moves = (Gripper,)
    failures = (*MOTION_FAILURES, "NO_CONTACT", "TOO_WIDE", "LOST")

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Refuse a gripper that always presses harder than `force` and than any apple bears; warn of what bruises."""
        if cell is None:
            return
        limits = cell.known(GripperLimits)
        force = known.get("force", DEFAULT_FORCE)
        bears = bearable_force(None)
        if limits is not None and force is not None:
            if words := _too_strong(limits, force, bears):
                yield Problem("force", words, "allow bruises by it, or take another gripper")
            elif force > bears:
                words = f"{force:g} N bruise an apple, which bears {bears:.0f} N at most"
                yield Problem("force", words, warning=True)
        if cell.place(ForceSensor) is None:
            tips = cell.place(PressSensor)
            words, where = (
                (UNMEASURED, cell.place(Gripper)) if tips is None else (PRESSED_ALONE, tips)
            )
            yield Problem(
                "", words, "SlipAvoidGrasp needs `fingers:` in the cell file", True, where
            )

    def run(
        self,
        fruit: Annotated[
            MeasuredFruit | None, Port(help="measured fruit; its size bounds the width of a grip")
        ] = None,
        width: Annotated[
            Length, Port(min="0 mm", help="aim of the fingers; 0: half the fruit's least dimension")
        ] = LENGTH("0 mm"),
        force: Annotated[
            Force,
            Port(
                min="1 N",
                max="100 N",
                help="grasp force by the motor's current at which the fingers stop; more, up to what the fruit bears, "
                "where the gripper always presses harder",
            ),
        ] = DEFAULT_FORCE,
        speed: Annotated[Speed, Port(min="1 mm/s", max="0.2 m/s", help="speed of closing")] = SPEED(
            "0.02 m/s"
        ),
    ) -> Work[None]:
        gripper = self.device(Gripper)
        limits = gripper.limits
        bears = 0.0 if fruit is None else bearable_force(fruit)
        if too_strong := _too_strong(limits, force, bears):
            raise self.failure("REFUSED", f"{too_strong}; nothing has moved")
        force = max(force, 2.0 * limits.force_min)
        eyes = yield from watched(self)
        take_over(gripper)
        start = gripper.state()
        narrowest = 0.0 if fruit is None else NARROWEST * float(fruit.dimensions.min())
        aim = max(width or narrowest, limits.width_min + AIMED)
        if start.width - aim < LEAST_WAY:
            raise self._fail(
                "NO_CONTACT", f"the fingers stand at {1e3 * start.width:.1f} mm already", start
            )
        yield from self._close(aim, min(speed, limits.speed_max), force, eyes)
        met = gripper.state()
        if start.width - met.width < LEAST_WAY:
            raise self._fail(
                "TOO_WIDE", f"the fingers met something after {1e3 * LEAST_WAY:g} mm or less", met
            )
        if fruit is not None and met.width > float(fruit.dimensions.max()) + WIDEST:
            raise self._fail(
                "TOO_WIDE", f"the fruit measures {1e3 * float(fruit.dimensions.max()):.0f} mm", met
            )
        yield from self.wait(SETTLE)
        now = gripper.state()
        tips = self.optional_device(PressSensor)
        evidence = between(now, limits) if tips is None else self._felt(tips)
        if not evidence:
            raise self._fail("NO_CONTACT", "the fingers met nothing, and nothing presses", now)
        if lost := gone(met, now, limits, CREEP):
            raise self._fail("LOST", f"{lost} after the grip", now)
        record_touches(
            self, fruit, (None, None), PadTouch(met.stamp, met.width, met.motor_force or 0.0)
        )
        yield evidence

    def _close(self, aim: float, speed: float, force: float, eyes: LiveWatch | None) -> Watching:
        """Close until the fingers are at their aim, are stopped by something, or press with a force [N]."""
        gripper = self.device(Gripper)
        tips = self.optional_device(PressSensor)

        def watch() -> str:
            state = gripper.state()
            pressed = state.motor_force if tips is None else sum(pressing_forces(tips))
            if pressed is not None and pressed >= force:
                raise PressedEnough
            return f"{1e3 * state.width:.0f} mm"

        try:
            yield from self._carry_out(
                lambda: gripper.move(aim, speed, force / 2.0), watch, eyes=eyes
            )
        except PressedEnough:
            pass
        except SkillFailure as ended:
            blocked = ended.failure.code == "MOTION_FAILED"
            if not (blocked and between(gripper.state(), gripper.limits)):
                raise

    def _felt(self, tips: PressSensor) -> str:
        """Return the evidence of an object between the fingertips; empty without any."""
        left, right = pressing_forces(tips)
        held = something_between(self.device(Gripper), tips)
        return f"the fingertips press with {left:.1f} and {right:.1f} N" if held else ""

    def _fail(self, code: str, why: str, state: GripperState) -> Exception:
        force = {} if state.motor_force is None else {"motor_force_n": round(state.motor_force, 3)}
        message = f"nothing is gripped: {why}, at {1e3 * state.width:.1f} mm"
        return self.failure(code, message, width_m=round(state.width, 5), **force)


def _too_strong(limits: GripperLimits, force: float, bears: float) -> str:
    """Return why a gripper cannot press as gently as is allowed or as the fruit bears [N]; empty if it can."""
    least = 2.0 * limits.force_min
    if least <= max(force, bears) + 1e-6:
        return ""
    allowed = f"the fruit bears {bears:.0f} N and 'force' allows {force:g} N"
    return f"the gripper presses with {least:g} N at least, where {allowed}"
