from pathlib import Path

import numpy as np
import pytest

from pomona.devices.realsense.camera_mount import CameraMount
from pomona.drivers.errors import DeviceLost
from pomona.drivers.interfaces import ArmState


class ScriptedArm:
    description = Path("robot.xml")

    def __init__(self, states: list[ArmState | None]) -> None:
        self._states = states

    def state(self) -> ArmState:
        state = self._states.pop(0)
        if state is None:
            raise DeviceLost("arm", "gone")
        return state


def at(stamp: float, angle: float) -> ArmState:
    return ArmState(stamp, np.full(7, angle), np.zeros(7), True)


def test_joints_are_those_of_the_exposure_and_not_of_the_arrival() -> None:
    mount = CameraMount(ScriptedArm([at(1.0, 0.0), at(1.1, 0.2), None, at(1.2, 0.3)]), np.eye(4))  # type: ignore[arg-type]
    for _ in range(4):
        mount.note()
    for stamp, angle in ((1.05, 0.1), (1.15, 0.25), (0.5, 0.0), (2.0, 0.3)):
        q = mount.joints(stamp)
        assert q is not None
        assert q == pytest.approx(np.full(7, angle))


def test_a_camera_without_an_arm_has_no_joints() -> None:
    mount = CameraMount(None, np.eye(4))
    mount.note()
    assert mount.joints(1.0) is None
