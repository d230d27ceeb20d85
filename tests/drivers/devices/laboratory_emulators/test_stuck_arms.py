"""Joints that were stuck behind an emulated controller."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.laboratory_emulators.universal_robots import UrEmulator
from pomona.devices.laboratory_emulators.xarm import XArmEmulator


@pytest.mark.parametrize("emulator", [UrEmulator, XArmEmulator])
def test_an_arm_that_was_stuck_stays_where_it_is_when_it_comes_free(
    emulator: type[UrEmulator] | type[XArmEmulator],
) -> None:
    joints = FreeJoints(np.full(6, 0.3))
    controller = emulator(joints, np.full(6, 3.0))
    controller.advance(0.0)
    controller.inject_fault("stuck")
    controller._q = controller._q + 0.08
    controller.advance(0.1)
    controller.clear_fault()
    controller.advance(0.2)
    assert joints.measured()[0] == pytest.approx(np.full(6, 0.3))
