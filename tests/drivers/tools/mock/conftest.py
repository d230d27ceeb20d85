"""The mock devices' fixtures, by import: `pytest_plugins` works in a top-level conftest only."""

from pomona.tools.mock.fixtures import (
    mock_arm,
    mock_camera,
    mock_cell,
    mock_clock,
    mock_devices,
    mock_fingers,
    mock_gripper,
)

__all__ = [
    "mock_arm",
    "mock_camera",
    "mock_cell",
    "mock_clock",
    "mock_devices",
    "mock_fingers",
    "mock_gripper",
]
