"""Where a camera that rides on the arm was when it looked: the arm's joints at the time of the exposure."""

from __future__ import annotations

from collections import deque

import numpy as np

from pomona.drivers import Arm, DeviceError
from pomona.executive import Float64

KEPT = 64


class CameraMount:
    """Remembers the arm's last states; without an arm the camera stands in the cell.

    Attributes:
        T_mount_camera: pose of the camera in tool0 (hand-eye) on an arm, in the base frame without one.
    """

    def __init__(self, arm: Arm | None, T_mount_camera: Float64) -> None:
        self.T_mount_camera = T_mount_camera
        self._arm = arm
        self._states: deque[tuple[float, Float64]] = deque(maxlen=KEPT)

    def note(self) -> None:
        """Remember the arm's present state; call it more often than frames come."""
        if self._arm is None:
            return
        try:
            state = self._arm.state()
        except DeviceError:
            return  # the arm's own driver reports it
        if not self._states or state.stamp > self._states[-1][0]:
            self._states.append((state.stamp, state.q))

    def joints(self, stamp: float) -> Float64 | None:
        """Return the joints at a time on the cell's clock, shape (dof,) [rad], by interpolation; None without arm."""
        if not self._states:
            return None
        times = [time for time, _ in self._states]
        i = int(np.searchsorted(times, stamp))
        if i == 0:
            return self._states[0][1]
        if i == len(times):
            return self._states[-1][1]
        (before, q0), (after, q1) = self._states[i - 1], self._states[i]
        share = (stamp - before) / (after - before)
        q: Float64 = q0 + share * (q1 - q0)
        return q
