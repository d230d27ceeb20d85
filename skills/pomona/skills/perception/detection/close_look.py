"""The pictures that networks take, and their outputs; the second look: a virtual camera turned to one fruit.

`label_rotation` gives one label among the equivalent poses of a fruit that is nearly symmetric about its stem axis.
The label must move smoothly with the view, or the network is asked to jump. "The front faces the camera" is
singular for a fruit seen from straight above. The swing rule is singular only for an upside-down fruit seen from
below: take the mean upright view, and turn it by the smallest rotation that brings its stem axis onto the seen one.

The virtual camera has the real one's place, is turned to the fruit and zoomed to its size; a plain crop would not do.
Away from the picture's middle a round fruit appears up to a fifth longer than wide; in the turned view it is round, and
its stem axis appears the same at every place in the picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pomona.executive.values.arrays import Float32, Float64
from pomona.skills.perception.detection.errors import BadFrame

Network = Callable[
    [Float32], Sequence[Float32]
]  # pictures (n, 3, h, w), RGB in 0..1 minus 0.5, to outputs
FINDER_STRIDE = 4  # input pixels per cell of the belief maps
CLOSE_LOOK_SIZE = 96  # side of the square picture of one fruit [px]

CENTRE = slice(0, 2)
SIZE = 2
AXIS = slice(3, 6)
SPREAD = slice(6, 9)
KIND = 9
SEEN = 10
"""Columns of the close look's output."""

CLOSE_LOOK_OUTPUTS = SEEN + 1

HEAT = 0
REACHES = slice(1, 5)
QUALITY = 5
"""Rows of the finder's maps: logit of the heat, log reaches left, up, right and down [cells], logit of the quality."""

FINDER_MULTIPLE = 32  # sides of the finder's input are multiples of this [px]: its coarsest features have this stride


LEAST_SIDE = 32  # pictures smaller than this on either side are refused [px]


def check_picture(colour: object) -> None:
    """Refuse a value that is no RGB picture.

    Raises BadFrame: not an array of shape (h, w, 3), uint8, at least 32 px on each side.
    """
    expected = f"(h, w, 3) uint8 RGB, at least {LEAST_SIDE} px on each side"
    if not isinstance(colour, np.ndarray):
        raise BadFrame(expected, f"a {type(colour).__name__}")
    if (
        colour.dtype != np.uint8
        or colour.ndim != 3
        or colour.shape[2] != 3
        or min(colour.shape[:2]) < LEAST_SIDE
    ):
        raise BadFrame(expected, f"{colour.shape} {colour.dtype}")


MEAN_ELEVATION = np.deg2rad(
    57.0
)  # mean elevation of the view [rad]; the label's singularity is opposite to it
STEM_AXIS = np.array([0.0, -1.0, 0.0])  # the stem axis in the object frame


def minimal_rotation(source: ArrayLike, target: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation by the smallest angle that maps unit vector `source` onto unit vector `target`, (3, 3)."""
    a = np.asarray(source, np.float64)
    b = np.asarray(target, np.float64)
    cosine = float(a @ b)
    if cosine < -1.0 + 1e-9:
        # Any half turn across the source will do: the axis is not determined here.
        across = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.9 else [0.0, 1.0, 0.0])
        across /= np.linalg.norm(across)
        half_turn: NDArray[np.float64] = 2.0 * np.outer(across, across) - np.eye(3)
        return half_turn
    # I + [v]x + [v]x² / (1 + c) with v = a x b, written out: this is called sixty times a picture.
    (p, q, r), (s, t, u) = a.tolist(), b.tolist()
    x = q * u - r * t
    y = r * s - p * u
    z = p * t - q * s
    k = 1.0 / (1.0 + cosine)
    return np.array(
        [
            [1.0 - k * (y * y + z * z), k * x * y - z, k * x * z + y],
            [k * x * y + z, 1.0 - k * (x * x + z * z), k * y * z - x],
            [k * x * z - y, k * y * z + x, 1.0 - k * (x * x + y * y)],
        ]
    )


def label_rotation(stem_camera: ArrayLike, centre_camera: ArrayLike) -> NDArray[np.float64]:
    """R_camera_object of the label by the swing rule, (3, 3).

    Args:
        stem_camera: direction of the stem axis in the camera frame, (3,).
        centre_camera: the fruit's centre in the camera frame, (3,) [m].
    """
    stem = np.asarray(stem_camera, np.float64) / np.linalg.norm(stem_camera)
    upright = upright_rotation(centre_camera)
    # Turned back into the ray's frame, so that the label is the same wherever in the picture the fruit lies.
    R_ray = _ray_rotation(centre_camera)
    swing = minimal_rotation(R_ray.T @ upright @ STEM_AXIS, R_ray.T @ stem)
    rotation: NDArray[np.float64] = R_ray @ swing @ R_ray.T @ upright
    return rotation


def upright_rotation(centre_camera: ArrayLike) -> NDArray[np.float64]:
    """R_camera_object (3, 3) of a fruit with its stem up, as a camera sees it at the mean elevation.

    Args:
        centre_camera: the fruit's centre in the camera frame, (3,) [m].
    """
    cosine = np.cos(MEAN_ELEVATION)
    sine = np.sin(MEAN_ELEVATION)
    R_mean = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    rotation: NDArray[np.float64] = _ray_rotation(centre_camera) @ R_mean
    return rotation


def _ray_rotation(centre_camera: ArrayLike) -> NDArray[np.float64]:
    ray = np.asarray(centre_camera, np.float64) / np.linalg.norm(centre_camera)
    return minimal_rotation((0.0, 0.0, 1.0), ray)


MARGIN = 1.15  # half side of the look over the corners' mean distance: the fruit fills two thirds
# length whose picture is a fruit's size [m]: mean distance of an apple's corners
REFERENCE_LENGTH = 0.0633
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
    cosine = np.cos(roll)
    sine = np.sin(roll)
    R_roll = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    R = minimal_rotation((0.0, 0.0, 1.0), ray / length) @ R_roll
    # REFERENCE_LENGTH at distance D along the ray is size = K[0, 0] * REFERENCE_LENGTH * length / D wide.
    distance = K[0, 0] * REFERENCE_LENGTH * length / max(size, 2.0)
    return VirtualCamera(K, R, 0.5 * CLOSE_LOOK_SIZE * distance / (MARGIN * REFERENCE_LENGTH))
