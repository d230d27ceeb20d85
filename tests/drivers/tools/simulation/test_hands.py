"""Simulated hands hold the fruit between the fingers, and pull it until it slides."""

from __future__ import annotations

import numpy as np

from pomona.drivers.interfaces import ForceSensor, Gripper, Hands, HandTask
from pomona.executive.cell.connect import load_cell
from pomona.executive.files import find_cell


def test_hands_hold_a_fruit_that_the_fingers_feel_and_pull_it_until_it_slides() -> None:
    cell = load_cell(
        find_cell("sim"), overrides={"friction": "0.8", "force_noise": "0 N", "shape_noise": "0"}
    )
    gripper, sensor, hands = cell.device(Gripper), cell.device(ForceSensor), cell.device(Hands)
    before = sensor.latest()
    assert before is not None
    hands.do(HandTask.HOLD)
    pressing = 0.0
    while pressing < 1.0:
        gripper.set_speed(-0.02 if pressing < 0.1 else -0.004)
        cell.clock.advance(0.02)  # type: ignore[attr-defined]
        sample = sensor.latest()
        assert sample is not None
        pressing = -float((sample.wrenches - before.wrenches)[:, 2].max())
    hands.do(HandTask.PULL)
    shares = []
    for _ in range(60):
        gripper.set_speed(0.0)
        cell.clock.advance(0.02)  # type: ignore[attr-defined]
        sample = sensor.latest()
        assert sample is not None
        felt = sample.wrenches - before.wrenches
        shares.append(float(np.abs(felt[:, 0]).mean() / -felt[:, 2].mean()))
    cell.close()
    assert max(shares) > 0.7
    assert max(shares) < 0.9
