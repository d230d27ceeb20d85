"""A detector of boxes that anyone trained, with poses from the close look or from the depth in each box."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.skills.perception.detection.box_model import BoxModel, ScoredBox, load_boxes
from pomona.skills.perception.detection.close_look import SIZE_OF_BOX
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.instances import Instance, instance_of
from pomona.skills.perception.detection.options import BoxModelFile
from pomona.skills.perception.detection.rigid_pose import cuboid_in_picture
from pomona.skills.perception.detection.sphere_in_box import FittedSphere, NoSphere, sphere_in_box
from pomona.skills.perception.detection.symmetry import upright_rotation

ACCEPTED = 0.4, 1.6  # least and greatest size relative to the CAD model, as Refine's defaults

SPHERE_OF_FRUIT = 1.05
"""Radius of the fitted sphere over half the mean of the cuboid's sides: median of 221 rendered apples at least 60 %
visible, depth noise 0.2 %."""

SIZE_ERROR = 0.05  # relative deviation of the sphere's radius, over the ratio that is seen (apples: 0.045)
ACROSS_ERROR = 2e-3  # deviation of its centre across the line of sight [m], likewise (apples: 2 mm)
ANY_STEM = 1.0  # standard deviation of the rotation [rad]: depth in a box shows no stem


class BoxDetector:
    """Boxes of an ONNX model, posed.

    Args:
        model: finds the boxes; its scores are the instances' scores.
        close_look: looks closely at each box; None takes the pose from depth.
        dimensions: of the fruit's CAD model [m].
    """

    def __init__(self, model: BoxModel, close_look: CompactDetector | None, dimensions: Float64) -> None:
        self._model, self._close_look, self._dimensions = model, close_look, dimensions

    @classmethod
    def load(
        cls, file: BoxModelFile, fruit: str, weights: Path | None, dimensions: tuple[float, float, float]
    ) -> BoxDetector:
        """Load a model of boxes, and for `pose_from: close_look` the fruit's weights.

        Raises:
            BadWeights: one of the files cannot be used.
            MissingPackage: PyTorch wrote the weights, and the extra `torch` is not installed.
        """
        model = load_boxes(file.model, fruit, file.working_width)
        close_look = None
        if file.pose == "close_look":
            assert weights is not None
            close_look = CompactDetector.load(weights)
        return cls(model, close_look, np.array(dimensions))

    def find_instances(self, colour: UInt8, K: Float64, depth: Float32 | None) -> list[Instance]:
        """Return all fruit of a frame, by falling score.

        Args:
            colour: (h, w, 3) uint8 RGB.
            K: camera matrix (3, 3) [px].
            depth: (h, w) [m], registered to the colour; None without a depth camera.

        Raises BadFrame: the picture has another shape or type; BadWeights: the model's outputs have another form.
        """
        boxes = self._model.find(colour)
        if self._close_look is None:
            return [self._by_depth(found, K, depth) for found in boxes]
        spots = [(b.box[:2] + 0.5 * b.box[2:] - 0.5, SIZE_OF_BOX * float(b.box[2:].max())) for b in boxes]
        looks = self._close_look.look_closely(colour, K, spots)
        return [
            instance_of(replace(fruit, score=found.score, box=found.box), K, self._dimensions)
            for fruit, found in zip(looks, boxes, strict=True)
        ]

    def _by_depth(self, found: ScoredBox, K: Float64, depth: Float32 | None) -> Instance:
        radius = 0.5 * SPHERE_OF_FRUIT * float(self._dimensions.mean())
        try:
            if depth is None:
                raise NoSphere("the frame has no depth, which pose_from: depth needs")
            sphere = sphere_in_box(depth, K, found.box, (ACCEPTED[0] * radius, ACCEPTED[1] * radius))
        except NoSphere as problem:
            return Instance(self._flat(found.box), found.score, float("nan"), None, None, str(problem), found.box)
        T, covariance = _posed(sphere, radius)
        keypoints = cuboid_in_picture(T, self._dimensions, K)
        return Instance(keypoints, found.score, sphere.seen, T, covariance, box=found.box)

    @staticmethod
    def _flat(box: Float64) -> Float64:
        """Return keypoints (9, 2) of a fruit without a pose: the box's corners, twice, and its middle."""
        corners = box[:2] + np.array([(1, 0), (0, 0), (0, 1), (1, 1)]) * box[2:]
        return np.concatenate([corners, corners, [box[:2] + 0.5 * box[2:]]])


def _posed(sphere: FittedSphere, radius: float) -> tuple[Float64, Float64]:
    """Return pose (4, 4) of the CAD-sized model that looks as large as the sphere, and its covariance (6, 6)."""
    T = np.eye(4)
    T[:3, 3] = sphere.centre * (radius / sphere.radius)
    T[:3, :3] = upright_rotation(T[:3, 3])
    p = T[:3, 3]
    seen = max(sphere.seen, 0.1)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * ANY_STEM**2
    covariance[3:, 3:] = np.eye(3) * (ACROSS_ERROR / seen * radius / sphere.radius) ** 2
    covariance[3:, 3:] += np.outer(p, p) * (SIZE_ERROR / seen) ** 2
    return T, covariance
