"""What must still be true when a paused cell goes on: the arm where it stopped, the fruit still between the fingers."""

from __future__ import annotations

import numpy as np

from pomona.drivers.errors import DeviceError, DeviceFault
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper
from pomona.executive.values.arrays import Float64

MOVED = 0.01
"""A joint that changed by more than this while paused was moved by somebody [rad]."""
HELD_FORCE, LOST_FORCE = 0.5, 0.2
"""Grasp force of one finger [N]: above the first at the pause something is held, below the second it is gone."""
GIVE = 0.01
"""Fingers that open or close by more than this have let go of what they held, or lost it [m]: what skin and pads give
at 14 N, where they give 1.5 N/mm."""


class HoldWatch:
    """Notes arm and grip once they are at rest, and compares before motion goes on."""

    def __init__(self, arm: Arm | None, fingers: ForceSensor | None, gripper: Gripper | None) -> None:
        self._arm, self._fingers, self._gripper = arm, fingers, gripper
        self._q: Float64 | None = None
        self._force: float | None = None
        self._hand = ""
        self._held_at: float | None = None

    def forget(self) -> None:
        """Nothing is remembered any more."""
        self._q = self._force = None

    def note(self) -> None:
        """Keep the state at rest; later calls change nothing until `forget`."""
        if self._q is None and self._arm is not None:
            self._q = self._arm.state().q.copy()
        if self._force is None:
            self._force = self._least_force()

    def compare(self) -> None:
        """Compare with what was noted.

        Raises:
            DeviceFault: the arm was moved, or the fruit is gone.
        """
        if self._q is not None and self._arm is not None:
            moved = float(np.abs(self._arm.state().q - self._q).max())
            if not moved <= MOVED:  # so that joints that are no number are not as they were
                raise DeviceFault("arm", f"was moved by {np.degrees(moved):.1f}° while the run was paused")
        force = self._least_force()
        if self._force is not None and self._force > HELD_FORCE and (force is None or not force >= LOST_FORCE):
            now = "nothing is felt" if force is None else f"now {force:.1f} N"
            raise DeviceFault("fingers", f"the fruit that was held with {self._force:.1f} N is gone ({now})")

    def in_hand(self) -> str | None:
        """What is felt between the fingers, as a sentence; empty for nothing, None when nobody feels anything.

        Fingers that press less than can be felt, and stand where they held something, may hold it still: friction is
        felt with less.
        """
        force = self._least_force()
        if force is None:
            return None
        width = self._width()
        if force > HELD_FORCE:
            self._hand, self._held_at = "something is between the fingers", width
        elif force < LOST_FORCE and self._hand:
            away = width is None or self._held_at is None or abs(width - self._held_at) > GIVE
            self._hand = "" if away else "something was held, and is hardly felt now"
        return self._hand

    def _width(self) -> float | None:
        """Between the fingers [m]; None when nobody knows."""
        try:
            return None if self._gripper is None else self._gripper.state().width
        except DeviceError:
            return None

    def _least_force(self) -> float | None:
        """The smaller of the two fingers' normal forces [N]."""
        sample = self._fingers.latest() if self._fingers is not None else None
        return None if sample is None else float((-sample.wrenches[:, 2]).min())
