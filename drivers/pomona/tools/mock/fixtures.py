"""Mock devices as pytest fixtures, for this project's tests and for those of anybody who writes a skill.

# conftest.py
pytest_plugins = ["pomona.tools.mock.fixtures"]

# test_my_skill.py
def test_it_stops_when_the_arm_refuses(mock_arm, mock_clock):
    mock_arm.refuse_next("servo off")
    outcome = drive(MySkill(), devices={Arm: mock_arm}, clock=mock_clock)
    assert outcome.reason.code == "MOTION_REFUSED"
"""

from __future__ import annotations

import pytest

from pomona.drivers.interfaces import Arm, Camera, ForceSensor, Gripper
from pomona.drivers.services import RobotServices
from pomona.executive.cell.cell import Cell
from pomona.tools.mock.arm import MockArm
from pomona.tools.mock.hand import MockCamera, MockClock, MockForceSensor, MockGripper


@pytest.fixture
def mock_clock() -> MockClock:
    """Return the clock that moves all mock devices of a test."""
    return MockClock()


@pytest.fixture
def mock_arm(mock_clock: MockClock) -> MockArm:
    """Return an arm on the fixture's clock."""
    return MockArm(mock_clock)


@pytest.fixture
def mock_gripper(mock_clock: MockClock) -> MockGripper:
    """Return a gripper on the fixture's clock."""
    return MockGripper(mock_clock)


@pytest.fixture
def mock_fingers(mock_clock: MockClock) -> MockForceSensor:
    """Fingers on the fixture's clock."""
    return MockForceSensor(mock_clock)


@pytest.fixture
def mock_camera(mock_clock: MockClock) -> MockCamera:
    """Return a camera without frames: give it some with `show`."""
    return MockCamera(clock=mock_clock)


@pytest.fixture
def mock_devices(
    mock_arm: MockArm,
    mock_gripper: MockGripper,
    mock_fingers: MockForceSensor,
    mock_camera: MockCamera,
) -> dict[type, object]:
    """Return all of them by interface, as `pomona.executive.skill_testing.drive` takes them."""
    return {Arm: mock_arm, Gripper: mock_gripper, ForceSensor: mock_fingers, Camera: mock_camera}


@pytest.fixture
def mock_cell(
    mock_clock: MockClock,
    mock_arm: MockArm,
    mock_gripper: MockGripper,
    mock_fingers: MockForceSensor,
    mock_camera: MockCamera,
) -> Cell:
    """Return a whole cell of mock devices."""
    devices = {
        "arm": mock_arm,
        "gripper": mock_gripper,
        "fingers": mock_fingers,
        "camera": mock_camera,
    }
    return Cell("mock", "mock", mock_clock, devices, RobotServices(devices))
