"""Every gripper keeps the claims of grippers, or declares that it cannot."""

from __future__ import annotations

import pytest

from pomona.devices.ros2 import gripper as module
from pomona.drivers.conformance import gripper_claims
from tests.drivers.conformance.grippers import BENCHES

pytestmark = pytest.mark.landmark


@pytest.fixture(autouse=True)
def no_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver of ROS 2 waits for messages on the host's time."""
    monkeypatch.setattr(module, "PATIENCE", 0.0)


test_claims = gripper_claims(**BENCHES)
