"""A detector of boxes that anyone trained, with poses from the close look or from the depth in each box."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.skills.perception.detection.close_look import (
    SIZE_OF_BOX,
    check_picture,
    upright_rotation,
)
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.detection import BoxModelFile
from pomona.skills.perception.detection.instances import (
    FoundFruit,
    Instance,
    cuboid_in_picture,
    instance_of,
)
from pomona.tools.box_detectors.box_model import BoxModel, ScoredBox, load_boxes

LEAST_POINTS = 40  # pixels with depth in a box, below which no sphere is fitted: a box of 7 × 7 px
MOST_POINTS = 2500  # pixels that are fitted; more of a box add no accuracy, since errors of neighbours are alike
CORE = 0.5  # part of the box's sides, about its middle, whose median depth stands for the fruit's front
BAND = 4e-3  # distance from the sphere within which depth agrees [m], as the default of Refine's `inlier_band`

LEAST_AGREEING = 0.5  # least ratio of agreeing pixels within a radius of the front: a fruit's shape
# standard deviation of the logarithm of the radius about half the box's longer side
RADIUS_PRIOR = 0.15
POINT_ERROR = 2e-3  # standard deviation of a point against the sphere [m]: apples are no spheres
INDEPENDENT = 30.0  # points that count as independent: an apple's dents and bulges move neighbouring points together

ITERATIONS = 12


@dataclass(frozen=True, slots=True, eq=False)
class FittedSphere:
    """A sphere in the camera frame."""

    centre: Float64  # (3,) [m]
    radius: float  # [m]
    agreeing: float  # ratio of the points within a radius of the front that lie within `BAND` of the sphere
    seen: (
        float  # area of the agreeing pixels over that of the whole sphere in the picture, at most 1
    )


class NoSphere(ValueError):
    """The depth in a box is no fruit's; the text has the measured and the expected value."""


def sphere_in_box(
    depth: Float32, K: Float64, box: Float64, radii: tuple[float, float]
) -> FittedSphere:
    """Fit a sphere to the depth in a box.

    Args:
        depth: (h, w) [m], 0 or NaN without measurement.
        K: camera matrix (3, 3) [px].
        box: x, y, w, h (4,) [px].
        radii: least and greatest radius of the fruit [m].

    Raises NoSphere: too few pixels with depth, or a surface of another shape or size.
    """
    points, pixel, each = _points(depth, K, box)
    if len(points) < LEAST_POINTS:
        raise NoSphere(
            f"depth at {len(points)} pixels of the box, expected at least {LEAST_POINTS}"
        )
    middle = box[:2] + 0.5 * box[2:] - 0.5
    core = (np.abs(pixel - middle) <= 0.5 * CORE * box[2:]).all(axis=1)
    front = float(np.median(points[core if core.any() else slice(None), 2]))
    # Half the longer side spans the radius at the centre's depth, which is a radius behind the front.
    slope = 0.5 * float(box[2:].max()) / float(K[0, 0])
    expected = slope * front / max(1.0 - slope, 0.1)
    near = points[np.abs(points[:, 2] - front) <= expected]
    ray = np.array([(middle[0] - K[0, 2]) / K[0, 0], (middle[1] - K[1, 2]) / K[1, 1], 1.0])
    centre, radius = _fit(near, ray * (front + expected), expected)
    distance = np.abs(np.linalg.norm(near - centre, axis=1) - radius)
    agreeing = float((distance <= BAND).mean())
    if agreeing < LEAST_AGREEING:
        raise NoSphere(
            f"{100 * agreeing:.0f} % of the depth in the box is a sphere's, expected {100 * LEAST_AGREEING:.0f} %"
        )
    if not radii[0] <= radius <= radii[1]:
        limits = " to ".join(f"{2e3 * value:.0f}" for value in radii)
        raise NoSphere(f"a sphere {2e3 * radius:.0f} mm wide in the box, expected {limits} mm")
    whole = np.pi * (radius / centre[2]) ** 2 * K[0, 0] * K[1, 1]
    share = each * float((distance <= BAND).sum()) / whole
    return FittedSphere(centre, radius, agreeing, min(1.0, share))


def _points(depth: Float32, K: Float64, box: Float64) -> tuple[Float64, Float64, float]:
    """Points (n, 3) [m] in a box and their pixels (n, 2), evenly thinned to `MOST_POINTS`; and pixels per point."""
    height, width = depth.shape
    left, top = np.maximum(0, np.ceil(box[:2] - 1e-9)).astype(int)
    right, bottom = np.minimum([width, height], np.floor(box[:2] + box[2:] + 1e-9)).astype(int)
    v, u = np.mgrid[top : max(top, bottom), left : max(left, right)]
    z = np.asarray(depth[top : max(top, bottom), left : max(left, right)], np.float64)
    measured = np.isfinite(z) & (z > 0.0)
    u = u[measured]
    v = v[measured]
    z = z[measured]
    each = max(1, -(-len(z) // MOST_POINTS))
    u = u[::each]
    v = v[::each]
    z = z[::each]
    points = np.column_stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z])
    return points, np.column_stack([u, v]).astype(np.float64), float(each)


def _fit(points: Float64, centre: Float64, expected: float) -> tuple[Float64, float]:
    """Return centre and radius by Gauss-Newton on distances, with Cauchy's weights and the prior of the radius."""
    radius = expected
    for _ in range(ITERATIONS):
        away = points - centre
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-6)
        error = distance - radius
        weight = 1.0 / (1.0 + (error / POINT_ERROR) ** 2) / POINT_ERROR**2
        weight *= INDEPENDENT / len(points)
        jacobian = np.column_stack([-away / distance[:, None], np.full(len(points), -radius)])
        information = jacobian.T @ (weight[:, None] * jacobian)
        gradient = jacobian.T @ (weight * error)
        information[3, 3] += 1.0 / RADIUS_PRIOR**2
        gradient[3] += np.log(radius / expected) / RADIUS_PRIOR**2
        step = np.linalg.solve(information + 1e-3 * np.eye(4), gradient)
        centre = centre - step[:3]
        radius *= float(np.exp(np.clip(-step[3], -0.3, 0.3)))
    return centre, radius


ACCEPTED = 0.4, 1.6  # least and greatest size relative to the CAD model, as Refine's defaults

SPHERE_OF_FRUIT = 1.05
"""Radius of the fitted sphere over half the mean of the cuboid's sides: median of 221 rendered apples at least 60 %
visible, depth noise 0.2 %."""

# relative deviation of the sphere's radius, over the ratio that is seen (apples: 0.045)
SIZE_ERROR = 0.05
ACROSS_ERROR = 2e-3  # deviation of its centre across the line of sight [m], likewise (apples: 2 mm)
ANY_STEM = 1.0  # standard deviation of the rotation [rad]: depth in a box shows no stem


class BoxDetector:
    """Boxes of an ONNX model, posed.

    Args:
        model: finds the boxes; its scores are the instances' scores.
        close_look: looks closely at each box; None takes the pose from depth.
        dimensions: of the fruit's CAD model [m].
    """

    def __init__(
        self, model: BoxModel, close_look: CompactDetector | None, dimensions: Float64
    ) -> None:
        self._model = model
        self._close_look = close_look
        self._dimensions = dimensions

    @classmethod
    def load(
        cls,
        file: BoxModelFile,
        fruit: str,
        weights: Path | None,
        dimensions: tuple[float, float, float],
    ) -> BoxDetector:
        """Load a model of boxes, and for `pose_from: close_look` the fruit's weights.

        Raises BadWeights: one of the files cannot be used.
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
        spots = [
            (b.box[:2] + 0.5 * b.box[2:] - 0.5, SIZE_OF_BOX * float(b.box[2:].max())) for b in boxes
        ]
        looks = look_closely(self._close_look, colour, K, spots)
        return [
            instance_of(replace(fruit, score=found.score, box=found.box), K, self._dimensions)
            for fruit, found in zip(looks, boxes, strict=True)
        ]

    def _by_depth(self, found: ScoredBox, K: Float64, depth: Float32 | None) -> Instance:
        radius = 0.5 * SPHERE_OF_FRUIT * float(self._dimensions.mean())
        try:
            if depth is None:
                raise NoSphere("the frame has no depth, which pose_from: depth needs")
            sphere = sphere_in_box(
                depth, K, found.box, (ACCEPTED[0] * radius, ACCEPTED[1] * radius)
            )
        except NoSphere as problem:
            return Instance(
                self._flat(found.box),
                found.score,
                float("nan"),
                None,
                None,
                str(problem),
                found.box,
            )
        T, covariance = _posed(sphere, radius)
        keypoints = cuboid_in_picture(T, self._dimensions, K)
        return Instance(keypoints, found.score, sphere.seen, T, covariance, box=found.box)

    @staticmethod
    def _flat(box: Float64) -> Float64:
        """Return keypoints (9, 2) of a fruit without a pose: the box's corners, twice, and its middle."""
        corners = box[:2] + np.array([(1, 0), (0, 0), (0, 1), (1, 1)]) * box[2:]
        return np.concatenate([corners, corners, [box[:2] + 0.5 * box[2:]]])


def look_closely(
    detector: CompactDetector, colour: UInt8, K: Float64, spots: list[tuple[Float64, float]]
) -> list[FoundFruit]:
    """Return fruit at centres and sizes [px], as yet without score: every spot gets all looks. Raises BadFrame."""
    check_picture(colour)
    options = detector.options
    found: list[FoundFruit] = []
    for number in range(options.looks if spots else 0):
        found, _ = detector.look(colour, K, spots, options.mirrored and number == options.looks - 1)
        spots = [(fruit.centre, fruit.size) for fruit in found]
    return found


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
