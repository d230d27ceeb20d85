"""The skill SlipAvoidGrasp."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any

from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, Pads, SampleRate
from pomona.executive.ports import FORCE, Force, Outputs, Port, Ratio
from pomona.executive.skill import CellFacts, Interrupted, SkillFailure, Work
from pomona.executive.values.sections import Problem
from pomona.skills.compiled_code import wait_for_first
from pomona.skills.grip.controller import GripController, warm_up
from pomona.skills.grip.grip import GripPhase, UnusableRate
from pomona.skills.grip.hold import Hold
from pomona.skills.grip.limit_surface import surface_table
from pomona.skills.grip.settings import ForceLaw, check_rate
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.following import MovingSkill
from pomona.skills.shared.held_fruit import grip_settings, show_grip, watch_grip
from pomona.skills.shared.live_watch import WATCH_FAILURES, LiveWatch, watched
from pomona.skills.shared.touch_view import record_touches


class Grasped(Outputs):
    """Outputs of SlipAvoidGrasp."""

    hold: Hold


class SlipAvoidGrasp(MovingSkill):
    """Close on the fruit with the minimum force that holds it; the grip continues after this node."""

    devices = (Gripper, ForceSensor, Pads)
    moves = (Gripper,)
    failures = (  # found in grip/closing.py until the fruit is held, then in grip/monitors.py
        "NO_CONTACT",
        "ONE_FINGER",
        "OUT_OF_STROKE",
        "FORCE_LIMIT",
        "SENSOR_STALE",
        "SENSOR_SATURATED",
        "SENSOR_FAULT",
        "SLIPPED",
        "LOST",
        *WATCH_FAILURES,
    )

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Refuse fingers whose sample rate no grip can use."""
        rate = None if cell is None else cell.known(SampleRate)
        if rate is not None:
            try:
                check_rate(rate.hz)
            except UnusableRate as error:
                yield Problem("", str(error))

    def prepare(self) -> None:
        wait_for_first()
        warm_up(self.device(ForceSensor).rate)

    def run(
        self,
        fruit: Annotated[
            MeasuredFruit | None, Port(help="measured fruit; beyond its size the fingers move fast")
        ] = None,
        margin: Annotated[
            Ratio, Port(min=1.0, max=3.0, help="factor on the minimum grip force")
        ] = 1.125,
        reserve: Annotated[
            Force, Port(min="0 N", max="10 N", help="expected disturbance force")
        ] = FORCE("0 N"),
        initial_force: Annotated[
            Force, Port(min="0.6 N", max="10 N", help="grasp force before the lift")
        ] = FORCE("2.2 N"),
        max_force: Annotated[
            Force,
            Port(
                min="1 N",
                max="40 N",
                help="largest grasp force, both fingers; less where `fruit` would bruise",
            ),
        ] = FORCE("14 N"),
        law: Annotated[
            str, Port(choices=tuple(law.value for law in ForceLaw), help="for comparison")
        ] = "slip_avoidance",
    ) -> Work[Grasped]:
        settings = replace(
            grip_settings(self, fruit, max_force),
            law=ForceLaw(law),
            margin=margin,
            reserve=reserve,
            initial_force=initial_force,
        )
        yield from self.compute(surface_table, settings.contact)
        eyes = yield from watched(self)
        gripper = self.device(Gripper)
        hold = Hold(
            gripper,
            self.device(ForceSensor),
            GripController(settings),
            self.clock.now,
            self.optional_device(Arm),
        ).under(gripper)
        try:
            yield from self._watch(hold, fruit, eyes)
        except Interrupted:
            if hold.phase not in (GripPhase.RAMP, GripPhase.HOLDING):
                hold.take_over()
            raise
        except BaseException:
            hold.take_over()
            raise
        show_grip(self, hold, everything=True)
        return Grasped(hold)

    def _watch(self, hold: Hold, fruit: MeasuredFruit | None, eyes: LiveWatch | None) -> Work[None]:
        try:
            while hold.phase is not GripPhase.HOLDING:
                watch_grip(self, hold)
                if eyes is not None:
                    eyes.look()
                if hold.ended:
                    raise self.failure(
                        "LOST", "another node took the fingers over before the fruit was held"
                    )
                reading = hold.reading
                yield f"{reading.phase.value}: {reading.f_n:.1f} N at {1e3 * reading.width:.0f} mm"
        except SkillFailure:
            record_touches(self, fruit, hold.first_touches)
            raise
        record_touches(self, fruit, hold.first_touches)
