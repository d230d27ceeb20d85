"""The second look: the view of a virtual camera turned to one fruit.

The virtual camera has the real one's place, is turned to the fruit and zoomed to its size; a plain crop would not do.
Away from the picture's middle a round fruit appears up to a fifth longer than wide; in the turned view it is round,
and its stem axis appears the same at every place in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.outputs import AXIS, CENTRE, CLOSE_LOOK_SIZE, SIZE
from pomona.skills.perception.detection.symmetry import STEM_AXIS, minimal_rotation

MARGIN = 1.15  # half side of the look over the corners' mean distance: the fruit fills two thirds
REFERENCE_LENGTH = 0.0633  # length whose picture is a fruit's size [m]: mean distance of an apple's corners
OUTLINE_RADIUS = 0.046  # radius of a CAD-sized fruit's outline [m]: the cone that touches the fruit

SIZE_OF_BOX = 0.64
"""Apparent size of a whole fruit over its box's longer side: 0.636 in 242 rendered looks (standard deviation 0.015),
and 0.644 (0.030) as `keypoint_size` of 2 991 rendered fruit."""

MIDDLE = 0.5 * (CLOSE_LOOK_SIZE - 1)


def keypoint_size(keypoints: Float64) -> float:
    """Return the mean distance of the corners 0..7 from the centroid, in the unit of `keypoints` (9, 2)."""
    return float(np.linalg.norm(keypoints[:8] - keypoints[8], axis=1).mean())


@dataclass(frozen=True, slots=True, eq=False)
class VirtualCamera:
    """A virtual camera at the real one's place, turned to a fruit."""

    K: Float64  # matrix of the real camera (3, 3) [px]
    R_camera_look: Float64  # turn from the look's frame to the real camera's, (3, 3)
    focal: float  # focal length of the look [px of the look]

    @property
    def picture_from_look(self) -> Float64:
        """Homography (3, 3) from the look's pixels to the picture's."""
        inverse = np.array([[1.0, 0.0, -MIDDLE], [0.0, 1.0, -MIDDLE], [0.0, 0.0, self.focal]])
        homography: Float64 = self.K @ self.R_camera_look @ inverse
        return homography

    def label(self, T_camera_object: Float64, scale: float) -> Float64:
        """Return the label of a fruit: centre and log size in half sides, and stem axis, (6,)."""
        p_look = self.R_camera_look.T @ T_camera_object[:3, 3]
        stem_look = self.R_camera_look.T @ T_camera_object[:3, :3] @ STEM_AXIS
        distance = float(np.linalg.norm(p_look))
        half = 0.5 * CLOSE_LOOK_SIZE
        touching = np.sqrt(max(distance**2 - (scale * OUTLINE_RADIUS) ** 2, 1e-6))
        label = np.empty(6)
        label[CENTRE] = self.focal * p_look[:2] / p_look[2] / half
        label[SIZE] = np.log(self.focal * scale * REFERENCE_LENGTH / touching / half)
        label[AXIS] = minimal_rotation((0.0, 0.0, 1.0), p_look / distance).T @ stem_look
        return label

    def place(self, label: Float64) -> tuple[Float64, Float64]:
        """Return centre of a CAD-sized fruit and stem axis in the real camera's frame, from the network's output.

        Args:
            label: as `label` gives it, (6,); the axis may have any length.

        Returns:
            p_camera (3,) [m] and a unit vector (3,).
        """
        half = 0.5 * CLOSE_LOOK_SIZE
        ray = np.array([*(half * label[CENTRE] / self.focal), 1.0])
        ray /= np.linalg.norm(ray)
        touching = self.focal * REFERENCE_LENGTH / (half * np.exp(np.clip(label[SIZE], -2.0, 2.0)))
        distance = np.hypot(touching, OUTLINE_RADIUS)
        axis = label[AXIS] / max(float(np.linalg.norm(label[AXIS])), 1e-9)
        stem = minimal_rotation((0.0, 0.0, 1.0), ray) @ axis
        return self.R_camera_look @ (distance * ray), self.R_camera_look @ stem


def look_at(K: Float64, centre: Float64, size: float, roll: float = 0.0) -> VirtualCamera:
    """Return the camera turned to a fruit.

    Args:
        K: of the real camera (3, 3) [px].
        centre: estimated centroid of the fruit, (2,) [px].
        size: length of `REFERENCE_LENGTH` there [px of the picture]; less than 2 counts as 2.
        roll: turn of the look about its own optical axis [rad].
    """
    ray = np.array([(centre[0] - K[0, 2]) / K[0, 0], (centre[1] - K[1, 2]) / K[1, 1], 1.0])
    length = float(np.linalg.norm(ray))
    cosine, sine = np.cos(roll), np.sin(roll)
    R_roll = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    R = minimal_rotation((0.0, 0.0, 1.0), ray / length) @ R_roll
    # REFERENCE_LENGTH at distance D along the ray is size = K[0, 0] * REFERENCE_LENGTH * length / D wide.
    distance = K[0, 0] * REFERENCE_LENGTH * length / max(size, 2.0)
    return VirtualCamera(K, R, 0.5 * CLOSE_LOOK_SIZE * distance / (MARGIN * REFERENCE_LENGTH))
