"""All fruit of a frame with their poses, and which of them is the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.close_look import keypoint_size
from pomona.skills.perception.detection.found_fruit import Finder, FoundFruit
from pomona.skills.perception.detection.rigid_pose import cuboid_in_picture, pose_covariance, pose_of
from pomona.skills.perception.fruit import FruitModel

POLICIES = ("nearest", "largest", "most_visible", "surest", "index")  # how a target is chosen among instances


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """One fruit of a frame."""

    keypoints: Float64  # (9, 2) [px]
    score: float  # estimated ratio of fruit among such detections, 0..1
    visibility: float  # part of its silhouette that is seen, 0..1, as estimated; NaN without an estimate
    # pose of the CAD-sized model; None when the keypoints of DOPE's full network gave none
    T_camera_object: Float64 | None
    covariance: Float64 | None  # of (rotation vector, translation) in the camera frame, (6, 6); None without a pose
    problem: str = ""  # why there is no pose; empty otherwise
    box: Float64 | None = None  # around its visible part, x, y, w, h (4,) [px]; None with weights without boxes

    @property
    def size(self) -> float:
        """Apparent size: mean distance of the corners from the centroid [px]."""
        return keypoint_size(self.keypoints)


def find_instances(detector: Finder, colour: NDArray[np.uint8], K: Float64, fruit: FruitModel) -> list[Instance]:
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
    return Instance(keypoints, found.score, found.visibility, T_camera_object, covariance, box=found.box)


def rank(instances: list[Instance], policy: str, index: int = 0) -> list[int]:
    """Return indices of the instances in the order in which the policy wants them as target.

    Args:
        instances: with poses.
        policy: nearest (to the camera), largest (in the picture), most_visible, surest (highest score), or index (by
            falling score).
        index: which one for the policy "index"; the list is empty when there are not so many.
    """
    order = range(len(instances))
    if policy == "index":
        return [index] if 0 <= index < len(instances) else []
    if policy == "nearest":
        return sorted(order, key=lambda i: (_distance(instances[i]), i))
    if policy == "surest":
        return sorted(order, key=lambda i: (-instances[i].score, i))
    if policy == "largest":
        return sorted(order, key=lambda i: (-instances[i].size, i))
    # Estimates of visibility within a few percent are equal; then the surer one is better.
    return sorted(order, key=lambda i: (-round(instances[i].visibility, 1), -instances[i].score, i))


def _distance(instance: Instance) -> float:
    return float("inf") if instance.T_camera_object is None else float(np.linalg.norm(instance.T_camera_object[:3, 3]))
