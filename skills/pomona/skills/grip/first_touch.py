"""Width of the fingers at each pad's first touch: where a fruit lies between them, and how wide it is.

The pads close on a fruit whose place and size the camera has measured. The first touch shows its place along the
fingers' axis, the second its width. Records hold both for every pick, so that a calibration can be compared with them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pomona.drivers.interfaces import GripperState
from pomona.executive.values.arrays import Float64
from pomona.executive.values.units import FORCE, LENGTH, TIME, Array

TOUCH = 0.4  # change of a pad's force that counts as a touch [N]: twice the largest error of the real fingers
LASTING = 3  # number of successive samples that confirm a touch: one sample may be a spike
OLDEST = 0.05  # age of the gripper's state up to which its width is carried on with its speed [s]

Pose = Annotated[Float64, Array(4, 4)]


@dataclass(frozen=True, slots=True)
class PadTouch:
    """The first touch of a pad."""

    stamp: Annotated[float, TIME]  # of the sample, on the cell's clock [s]
    width: Annotated[float, LENGTH]  # opening between the pads' faces [m]
    force: Annotated[float, FORCE]  # force on this pad, the bias removed [N]; of a plain gripper, its motor's


@dataclass(frozen=True, slots=True, eq=False)
class PickTouches:
    """Touches of one pick, with the measured fruit and the poses that belong to them."""

    fruit: str  # kind of the fruit
    left: PadTouch | None  # the finger on the side of the tool's y axis; None: it felt nothing
    right: PadTouch | None  # the other finger
    closed: PadTouch | None  # where a plain gripper has stopped on the fruit: it does not feel its pads one by one
    T_base_tcp: Pose  # the tool during the touches: z approach, y from the right to the left finger
    T_base_fruit: Pose  # the fruit as the camera has measured it
    T_base_camera: Pose  # the camera at that look
    T_mount_camera: Pose  # the camera in its mount, as the look had it
    on_arm: bool  # True: the mount is the arm's flange, else the base frame
    dimensions: Annotated[Float64, Array(3, of=LENGTH)]  # of the measured fruit [m]
    # distances of the measured skin from the tool's centre along its y axis, left and right [m]
    skin: Annotated[Float64, Array(2, of=LENGTH)]


class TouchRecorder:
    """Finds the first touch of each pad in the samples of a closing.

    Attributes:
        touches: of the left and the right pad; None until it has touched.
    """

    def __init__(self) -> None:
        self.touches: list[PadTouch | None] = [None, None]
        self._begun: list[PadTouch | None] = [None, None]
        self._count = [0, 0]

    @property
    def complete(self) -> bool:
        """True when both pads have touched."""
        return None not in self.touches

    def take(self, stamp: float, wrenches: Float64, state: GripperState) -> None:
        """Take one sample.

        Args:
            stamp: its time [s].
            wrenches: of both pads without their bias, shape (2, 6) [N, N·m].
            state: newest state of the gripper.
        """
        forces = np.sqrt((wrenches[:, :3] ** 2).sum(axis=1))
        for side in range(2):
            if not forces[side] > TOUCH:
                self._count[side] = 0
                continue
            self._count[side] += 1
            if self._count[side] == 1:
                width = state.width + state.speed * min(max(stamp - state.stamp, 0.0), OLDEST)
                self._begun[side] = PadTouch(stamp, float(width), float(forces[side]))
            if self._count[side] == LASTING and self.touches[side] is None:
                self.touches[side] = self._begun[side]


def skin_along(points: Float64, T_base_tcp: Float64) -> Float64:
    """Return the distances of a shape's skin from the tool's centre along its y axis, left and right, shape (2,) [m].

    Args:
        points: of the shape in the base frame, shape (n, 3) [m].
        T_base_tcp: pose of the tool, shape (4, 4).
    """
    along = (points - T_base_tcp[:3, 3]) @ T_base_tcp[:3, 1]
    return np.array([along.max(), -along.min()])
