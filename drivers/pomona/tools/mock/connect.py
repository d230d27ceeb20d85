"""Mock devices for cell files, for dry runs of a tree: `world: {driver: mock}` gives the clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pomona.drivers.motion_supervisor import Supervision
from pomona.drivers.services import ConnectContext
from pomona.executive.cell.device import Device
from pomona.executive.cell.registration import NoOptions, Settings, Surroundings, driver
from pomona.executive.values.kinds import Measure, Text, choose
from pomona.executive.values.sections import Problem, Section, value
from pomona.executive.values.units import LENGTH
from pomona.tools.mock.arm import SIA5F_LIMITS, MockArm
from pomona.tools.mock.hand import (
    MockCamera,
    MockClock,
    MockForceSensor,
    MockGripper,
    MockLoadSensor,
    spring_fruit,
)


class MockWorld(Device):
    """A clock, and nothing that could be true."""

    def __init__(self) -> None:
        super().__init__("world")
        self.clock = MockClock()

    def truth(self) -> Mapping[str, object]:
        return {}


@dataclass(frozen=True, slots=True, kw_only=True)
class InMockWorld:
    """A device that lives in the mock world."""

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        if not around.has(MockWorld):
            yield Problem(
                "driver", "a mock device needs the mock world above it", "world: {driver: mock}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class MockArmOptions(InMockWorld):
    """An arm that follows trajectories exactly."""

    start: str = value(Text(), "", "pose of the workspace in which it stands; zeros without one")

    supervision: Supervision = value(
        Section(Supervision), Supervision(), "how closely the arm must follow its commands"
    )

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        yield from InMockWorld.fits(self, around)
        poses = around.workspace.poses if around.workspace else {}
        if self.start and self.start not in poses:
            yield Problem("start", f"it cannot be '{self.start}'", choose(self.start, poses))

    def known(self) -> Iterator[object]:
        yield SIA5F_LIMITS


@dataclass(frozen=True, slots=True, kw_only=True)
class MockFingersOptions(InMockWorld):
    """Fingers that feel a soft fruit, or nothing."""

    fruit: float = value(
        Measure(LENGTH, "0 mm", "500 mm"),
        "0 mm",
        "width of a soft fruit between them, 0 mm for none",
    )


@driver(MockWorld, NoOptions)
def connect_world(settings: Settings[NoOptions], context: ConnectContext) -> MockWorld:
    """`driver: mock`"""
    return MockWorld()


@driver(MockArm, MockArmOptions)
def connect_arm(settings: Settings[MockArmOptions], context: ConnectContext) -> MockArm:
    """`driver: mock-arm`"""
    said = settings.values
    q = context.workspace.poses[said.start] if said.start and context.workspace else None
    return MockArm(_clock(context), q, supervision=said.supervision)


@driver(MockGripper, InMockWorld)
def connect_gripper(settings: Settings[InMockWorld], context: ConnectContext) -> MockGripper:
    """`driver: mock-gripper`"""
    return MockGripper(_clock(context))


@driver(MockForceSensor, MockFingersOptions)
def connect_fingers(
    settings: Settings[MockFingersOptions], context: ConnectContext
) -> MockForceSensor:
    """`driver: mock-fingers`"""
    gripper = context.find(MockGripper)
    width = settings.values.fruit
    feel = spring_fruit(gripper, width) if gripper is not None and width > 0.0 else None
    return MockForceSensor(_clock(context), feel)


@driver(MockLoadSensor, InMockWorld)
def connect_load(settings: Settings[InMockWorld], context: ConnectContext) -> MockLoadSensor:
    """`driver: mock-load`"""
    return MockLoadSensor(_clock(context))


@driver(MockCamera, NoOptions)
def connect_camera(settings: Settings[NoOptions], context: ConnectContext) -> MockCamera:
    """`driver: mock-camera`: a camera that never sees anything."""
    return MockCamera(clock=context.clock)


def _clock(context: ConnectContext) -> MockClock:
    assert isinstance(context.clock, MockClock), "judged when the cell file was read"
    return context.clock
