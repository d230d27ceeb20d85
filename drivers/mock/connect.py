"""Mock devices for cell files, for dry runs of a tree: `world: {driver: mock}` gives the clock."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.cell_file import Settings
from drivers.device import Bench, Device
from drivers.mock.arm import MockArm
from drivers.mock.camera import MockCamera
from drivers.mock.clock import MockClock
from drivers.mock.fingers import MockForceSensor, spring_fruit
from drivers.mock.gripper import MockGripper
from drivers.motion_supervisor import read_supervision


class MockWorld(Device):
    """A clock, and nothing that could be true."""

    def __init__(self) -> None:
        super().__init__("world")
        self.clock = MockClock()

    def truth(self) -> Mapping[str, object]:
        return {}


def connect_world(settings: Settings, bench: Bench) -> MockWorld:
    """`driver: mock`"""
    return MockWorld()


def connect_arm(settings: Settings, bench: Bench) -> MockArm:
    """`driver: mock-arm`; `start` names a pose of the workspace."""
    poses = bench.workspace.poses if bench.workspace else {}
    q = poses[settings.choice("start", poses)] if settings.has("start") else None
    return MockArm(_clock(settings, bench), q, supervision=read_supervision(settings))


def connect_gripper(settings: Settings, bench: Bench) -> MockGripper:
    """`driver: mock-gripper`"""
    return MockGripper(_clock(settings, bench))


def connect_fingers(settings: Settings, bench: Bench) -> MockForceSensor:
    """`driver: mock-fingers`; `fruit` is the width of a soft fruit between the fingers, 0 for none."""
    gripper = bench.find(MockGripper)
    width = settings.number("fruit", "length", 0.0, 0.0, 0.5)
    feel = spring_fruit(gripper, width) if gripper is not None and width > 0.0 else None
    return MockForceSensor(_clock(settings, bench), feel)


def connect_camera(settings: Settings, bench: Bench) -> MockCamera:
    """`driver: mock-camera`: a camera that never sees anything."""
    return MockCamera(clock=bench.clock)


def _clock(settings: Settings, bench: Bench) -> MockClock:
    if not isinstance(bench.clock, MockClock):
        raise settings.error("a mock device needs the mock world above it (world: {driver: mock})")
    return bench.clock
