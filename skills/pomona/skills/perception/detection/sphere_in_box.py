"""A fruit as a sphere: centre and radius from the depth in the box around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float32, Float64

LEAST_POINTS = 40  # pixels with depth in a box, below which no sphere is fitted: a box of 7 × 7 px
MOST_POINTS = 2500  # pixels that are fitted; more of a box add no accuracy, since errors of neighbours are alike
CORE = 0.5  # part of the box's sides, about its middle, whose median depth stands for the fruit's front
BAND = 4e-3  # distance from the sphere within which depth agrees [m], as the default of Refine's `inlier_band`

LEAST_AGREEING = 0.5  # least ratio of agreeing pixels within a radius of the front: a fruit's shape
RADIUS_PRIOR = 0.15  # standard deviation of the logarithm of the radius about half the box's longer side
POINT_ERROR = 2e-3  # standard deviation of a point against the sphere [m]: apples are no spheres
INDEPENDENT = 30.0  # points that count as independent: an apple's dents and bulges move neighbouring points together

ITERATIONS = 12


@dataclass(frozen=True, slots=True, eq=False)
class FittedSphere:
    """A sphere in the camera frame."""

    centre: Float64  # (3,) [m]
    radius: float  # [m]
    agreeing: float  # ratio of the points within a radius of the front that lie within `BAND` of the sphere
    seen: float  # area of the agreeing pixels over that of the whole sphere in the picture, at most 1


class NoSphere(ValueError):
    """The depth in a box is no fruit's; the text has the measured and the expected value."""


def sphere_in_box(depth: Float32, K: Float64, box: Float64, radii: tuple[float, float]) -> FittedSphere:
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
        raise NoSphere(f"depth at {len(points)} pixels of the box, expected at least {LEAST_POINTS}")
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
    u, v, z = u[measured], v[measured], z[measured]
    each = max(1, -(-len(z) // MOST_POINTS))
    u, v, z = u[::each], v[::each], z[::each]
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
