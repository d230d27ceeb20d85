"""A skill: typed ports, a body that is ticked, a failure code. Run: python examples/one_skill.py

Needs the distribution pomona.
"""

from typing import Annotated

import numpy as np

from pomona.drivers import ForceSensor
from pomona.executive import TIME, Mass, Outputs, Port, Skill, Time, Work, drive
from pomona.tools.mock import MockClock, MockForceSensor


class Weighed(Outputs):
    """Outputs of Weigh."""

    mass: Mass


class Weigh(Skill):
    """Weigh the held fruit by the tangential force of both pads."""

    devices = (ForceSensor,)
    failures = ("SENSOR_STALE",)

    def run(
        self, settle: Annotated[Time, Port(min="0 s", help="settling time")] = TIME("200 ms")
    ) -> Work[Weighed]:
        yield from self.wait(settle)
        sample = self.device(ForceSensor).latest()
        if sample is None or self.clock.now() - sample.stamp > 0.05:
            raise self.failure("SENSOR_STALE", "the fingers deliver no samples")
        left, right = sample.wrenches
        return Weighed(mass=abs(float(left[0] + right[0])) / 9.81)


clock = MockClock()
pad = np.array([-0.981, 0.0, -3.0, 0.0, 0.0, 0.0])  # force [N] and moment [N·m] in the pad's frame
fingers = MockForceSensor(clock, lambda _now: np.array([pad, pad]))
end = drive(Weigh(), devices={ForceSensor: fingers}, clock=clock)
print(f"{end.status.value} after {end.duration:.1f} s: {end.outputs['mass']:.3f} kg")

fingers.lose(10.0)
end = drive(Weigh(), devices={ForceSensor: fingers}, clock=clock)
print(f"{end.status.value}: {end.reason.code if end.reason else ''}")
