"""Fruit found in a picture: as the compact detector gives it, and with keypoints, pose and covariance."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.close_look import SIZE_OF_BOX, keypoint_size, label_rotation
from pomona.skills.perception.fruit import FruitModel


class CuboidConvention(StrEnum):
    """Vertex orders met in DOPE checkpoints and annotations.

    CAMERA: axes x right, y down, z forward; the order of DOPE's current `cuboid.py`. Pomona's own.
    ROBOT: axes x forward, y left, z up of the mesh, the older exports; DOPE's axes are then (-y, -z, +x).
    """

    CAMERA = "camera"
    ROBOT = "robot"


_SIGNS = np.array(
    [
        (+1, -1, +1),
        (-1, -1, +1),
        (-1, +1, +1),
        (+1, +1, +1),
        (+1, -1, -1),
        (-1, -1, -1),
        (-1, +1, -1),
        (+1, +1, -1),
        (0, 0, 0),
    ],
    dtype=np.float64,
)

R_MESH_DOPE = {
    CuboidConvention.CAMERA: np.eye(3),
    CuboidConvention.ROBOT: np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
}
"""Rotation from DOPE's axes to the mesh's axes, per convention."""


def cuboid_keypoints(
    dimensions: ArrayLike, convention: CuboidConvention = CuboidConvention.CAMERA
) -> NDArray[np.float64]:
    """Return corners 0..7 and the centre 8 of a cuboid in the mesh's frame, (9, 3), in the unit of `dimensions`.

    Args:
        dimensions: extents along the mesh's own x, y, z.
        convention: which axes the vertex order refers to.
    """
    rotation = R_MESH_DOPE[convention]
    keypoints: NDArray[np.float64] = (_SIGNS @ rotation.T) * (
        0.5 * np.asarray(dimensions, np.float64)
    )
    return keypoints


@dataclass(frozen=True, slots=True, eq=False)
class FoundFruit:
    """One fruit in a picture."""

    p_camera: (
        Float64  # centre of a CAD-sized fruit of the same appearance, in the camera frame, (3,) [m]
    )
    stem: Float64  # stem axis in the camera frame, unit vector (3,)
    centre: Float64  # the centre in the picture [px]
    size: float  # length of `REFERENCE_LENGTH` of a CAD-sized fruit in the picture [px]
    # mean errors of centre [px], of the logarithm of size, and of the axis [rad] that the network expects, (3,)
    spreads: Float64
    score: float  # estimated ratio of fruit among such detections, 0..1, by the weights' score
    visibility: float  # part of its silhouette that is seen, 0..1, as the network estimates it
    # around its visible part, x, y, w, h (4,) [px], inside the picture; None with weights without boxes
    box: Float64 | None = None

    def outline(self, width: int, height: int) -> Float64:
        """The box, or that of a whole fruit of its size where there is none: x, y, w, h (4,) [px], in the picture."""
        if self.box is not None:
            return self.box
        side = self.size / SIZE_OF_BOX
        return inside(np.array([*(self.centre + 0.5 - 0.5 * side), side, side]), width, height)


class Finder(Protocol):
    """Finds fruit in pictures, such as `CompactDetector`."""

    def find(self, colour: UInt8, K: Float64) -> list[FoundFruit]:
        """Return all fruit in a picture (h, w, 3) uint8 RGB, with camera matrix K (3, 3) [px], by falling score.

        Raises BadFrame: another shape or type.
        """


def inside(box: Float64, width: int, height: int) -> Float64:
    """Return the part of a box x, y, w, h (4,) [px] that lies in the picture, written alike."""
    limits = np.array([width, height], np.float64)
    low = np.clip(box[:2], 0.0, limits)
    return np.concatenate([low, np.clip(box[:2] + box[2:], 0.0, limits) - low])


SCALES = np.array([0.97, 1.25, 1.99])
"""Deviations of centre [px], log size and axis [rad] (a direction each) where the network expects an error of 1, for a
fruit that is seen whole."""

POWERS = np.array([1.0, 1.0, 1.43])
"""The deviation grows with this power of the error that the network expects: an axis with a large expected error may be
reversed, so its true error is larger than expected, and that of a certain axis smaller."""

HIDDEN = np.array([2.8, 2.8, 0.0])
"""A fruit of which the part h is hidden has deviations exp(h · this) as large: the network underestimates the errors of
hidden fruit, and takes nearly hidden fruit for half visible. Scales and powers: quantile regressions to 90 % ellipsoids
over 958 apples and 634 lemons in rendered frames of seed 778001, these the least with which the ellipsoids also hold
90 % of those less than two fifths visible. On other seeds 0.90 to 0.96 of the places lie inside (bench_detect)."""

LEAST_ROTATION = 1e-3  # least standard deviation of the axis [rad]


def pose_of(found: FoundFruit) -> Float64:
    """T_camera_object (4, 4) of a CAD-sized fruit: its place as it was seen, its rotation by the swing rule."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = label_rotation(found.stem, found.p_camera), found.p_camera
    return T


def cuboid_in_picture(T_camera_object: Float64, dimensions: Float64, K: Float64) -> Float64:
    """Return keypoints of a cuboid, (9, 2) [px].

    Args:
        T_camera_object: its pose (4, 4) [m].
        dimensions: its sides [m].
        K: camera matrix (3, 3) [px].
    """
    points = cuboid_keypoints(dimensions) @ T_camera_object[:3, :3].T + T_camera_object[:3, 3]
    # A fruit nearer than its own cuboid is deep has no picture; keep the corners before the camera.
    depth = np.maximum(points[:, 2:], 0.1 * T_camera_object[2, 3])
    keypoints: Float64 = points[:, :2] / depth * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2])
    return keypoints


def pose_covariance(found: FoundFruit, K: Float64) -> Float64:
    """Return covariance of (rotation vector, translation) in the camera frame, (6, 6) [rad, m].

    The errors that the network expects of centre, size and axis are carried over to the pose: the centre's across the
    line of sight, the size's along it, the axis's to a turn about any axis. The turn about the stem, which a fruit does
    not show, is the swing rule's.
    """
    p = found.p_camera
    z = float(found.p_camera[2])
    centre, size, axis = SCALES * found.spreads**POWERS * np.exp(HIDDEN * (1.0 - found.visibility))
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * max(axis, LEAST_ROTATION) ** 2
    covariance[3:, 3:] = np.diag([(z * centre / K[0, 0]) ** 2, (z * centre / K[1, 1]) ** 2, 0.0])
    covariance[3:, 3:] += np.outer(p, p) * size**2
    return covariance


POLICIES = (
    "nearest",
    "largest",
    "most_visible",
    "surest",
)  # how a target is chosen among instances


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """One fruit of a frame."""

    keypoints: Float64  # (9, 2) [px]
    score: float  # estimated ratio of fruit among such detections, 0..1
    visibility: (
        float  # part of its silhouette that is seen, 0..1, as estimated; NaN without an estimate
    )
    # pose of the CAD-sized model; None when the keypoints of DOPE's full network gave none
    T_camera_object: Float64 | None
    covariance: (
        Float64 | None
    )  # of (rotation vector, translation) in the camera frame, (6, 6); None without a pose
    problem: str = ""  # why there is no pose; empty otherwise
    # around its visible part, x, y, w, h (4,) [px]; None with weights without boxes
    box: Float64 | None = None

    @property
    def size(self) -> float:
        """Apparent size: mean distance of the corners from the centroid [px]."""
        return keypoint_size(self.keypoints)


def find_instances(
    detector: Finder, colour: NDArray[np.uint8], K: Float64, fruit: FruitModel
) -> list[Instance]:
    """Detect all fruit in a picture with their poses, by falling score.

    Args:
        detector: ready to run.
        colour: (h, w, 3) uint8 RGB.
        K: camera matrix (3, 3) [px].
        fruit: the model whose cuboid is drawn as keypoints.

    Raises BadFrame: the picture has another shape or type.
    """
    return [instance_of(found, K, fruit.dimensions) for found in detector.find(colour, K)]


def instance_of(found: FoundFruit, K: Float64, dimensions: Float64) -> Instance:
    """One detection with the pose of its close look; `dimensions` (3,) [m] are those of the drawn cuboid."""
    T_camera_object = pose_of(found)
    keypoints = cuboid_in_picture(T_camera_object, dimensions, K)
    covariance = pose_covariance(found, K)
    return Instance(
        keypoints, found.score, found.visibility, T_camera_object, covariance, box=found.box
    )


def rank(instances: list[Instance], policy: str) -> list[int]:
    """Return indices of the instances in the order in which the policy wants them as target.

    Args:
        instances: with poses.
        policy: nearest (to the camera), largest (in the picture), most_visible, or surest (highest score).
    """
    order = range(len(instances))
    if policy == "nearest":
        return sorted(order, key=lambda i: (_distance(instances[i]), i))
    if policy == "surest":
        return sorted(order, key=lambda i: (-instances[i].score, i))
    if policy == "largest":
        return sorted(order, key=lambda i: (-instances[i].size, i))
    # Estimates of visibility within a few percent are equal; then the surer one is better.
    return sorted(order, key=lambda i: (-round(instances[i].visibility, 1), -instances[i].score, i))


def _distance(instance: Instance) -> float:
    return (
        float("inf")
        if instance.T_camera_object is None
        else float(np.linalg.norm(instance.T_camera_object[:3, 3]))
    )
