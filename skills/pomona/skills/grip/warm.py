"""Compile what a grip needs before a run's clock starts; the compiled code is kept on disk."""

from __future__ import annotations

import numpy as np

from pomona.skills.grip.controller import GripController
from pomona.skills.grip.settings import GripSettings, check_rate


def warm_up(rate: float = 500.0) -> None:
    """Step a controller that nothing hangs on through its phases.

    Args:
        rate: of the sensor's samples [Hz].

    Raises:
        UnusableRate: no grip can use such a sensor.
    """
    check_rate(rate)
    controller = GripController(GripSettings())
    controller.width = 0.08
    for i in range(300):
        pressing = 0.0 if i < 120 else -1.0
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = pressing
        controller.step(0.002 * i, i, wrenches)
