"""Every arm keeps the claims of arms, or declares that it cannot."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.devices.ros2 import arm as module
from pomona.drivers.conformance import arm_claims
from tests.drivers.conformance.arms import BENCHES

pytestmark = pytest.mark.landmark


@pytest.fixture(autouse=True)
def no_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver of ROS 2 waits for messages on the host's time."""
    monkeypatch.setattr(module, "PATIENCE", 0.0)


test_claims = arm_claims(**BENCHES)


@pytest.mark.parametrize("name", ["motoman", "universal_robots", "xarm"])
def test_an_arm_that_moves_while_it_is_made_ready_is_noticed(name: str) -> None:
    bench = BENCHES[name]()
    bench.begin()
    bench.harm("frozen", 0.5)
    bench.heal()
    bench.serve(1.0)
    assert bench.problem()
    bench.device.acknowledge()
    bench.body.pushed = 0.02 * np.eye(len(bench.way))[1]
    bench.serve(1.0, lambda: "without a command" in bench.problem())
    assert "joint 2 moves without a command" in bench.problem()
