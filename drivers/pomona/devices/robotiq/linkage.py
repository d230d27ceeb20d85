"""Where the fingertips of a 2F are at an opening: its linkage draws them back towards the palm as they open.

Each fingertip hangs on a crank and stays parallel to itself. So it goes on a circle: across the gripper by half of the
opening, and along the approach. A description has fingers that slide in a line; `slide_axis` returns the line's
direction that touches the circle at one opening.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Linkage:
    """The circle of a fingertip."""

    crank: float  # length of the crank [m]
    open_angle: float  # of the crank from the direction in which the fingers open, at the largest opening [rad]
    width_max: float  # that opening [m]

    def angle(self, width: float) -> float:
        """Return the crank's angle at an opening [m], in [rad]. Raises ValueError: it opens less far."""
        if not 0.0 <= width <= self.width_max:
            raise ValueError(
                f"an opening of {1e3 * width:.1f} mm is none of 0 to {1e3 * self.width_max:.0f} mm"
            )
        return float(
            np.arccos(np.cos(self.open_angle) - (self.width_max - width) / (2.0 * self.crank))
        )

    def forward(self, width: float) -> float:
        """Return how much further along the approach the fingertips are than at the largest opening [m]."""
        return float(self.crank * (np.sin(self.angle(width)) - np.sin(self.open_angle)))

    def slide_axis(self, width: float) -> tuple[float, float]:
        """Return the direction of a sliding finger that opens: across the gripper, and along its approach.

        It is a unit vector, the tangent of the circle at this opening.
        """
        angle = self.angle(width)
        return float(np.sin(angle)), float(-np.cos(angle))


LINKAGES = {
    "2f-85": Linkage(float(np.hypot(0.0376, 0.0430)), float(np.arctan2(0.0430, 0.0376)), 0.085),
    "2f-140": Linkage(
        float(np.hypot(0.09998, 0.00222)),
        float(np.pi / 2.0 - 0.725 + np.arctan2(0.00222, 0.09998)),
        0.140,
    ),
}
"""By model. Ends of the crank: origins of the joints `outer_finger` and `inner_finger`, fingers open, in the public
descriptions of ROS-Industrial's package `robotiq` (BSD-3). They were not measured on a gripper."""
