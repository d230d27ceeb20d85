"""Scripted devices without physics, for unit tests of skills and for dry runs.

    clock = MockClock()
    arm = MockArm(clock)
    outcome = drive(MoveTo(), {"pose": "home"}, devices={Arm: arm}, clock=clock)

Time passes when the clock is advanced, in steps of 2 ms; devices move and streams deliver inside the steps, as on the
simulated cell. `pytest_plugins = ["pomona.tools.mock.fixtures"]` in a conftest.py gives them as fixtures.
"""

from pomona.tools.mock.arm import MockArm
from pomona.tools.mock.hand import (
    MockCamera,
    MockClock,
    MockForceSensor,
    MockGripper,
    MockLoadSensor,
    spring_fruit,
)

__all__ = [
    "MockArm",
    "MockCamera",
    "MockClock",
    "MockForceSensor",
    "MockGripper",
    "MockLoadSensor",
    "spring_fruit",
]
