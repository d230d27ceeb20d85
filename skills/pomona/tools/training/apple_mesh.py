"""The shape of an apple, made from a profile: the project's own CAD model and its random relatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

CAD_DIMENSIONS = (
    0.09756,
    0.08539,
    0.09590,
)  # cuboid (d_x, d_y, d_z) of the CAD apple [m]; d_y is the height

# Half of the outline, from the bottom of the stem cavity to that of the calyx basin: distance from the axis, height.
_OUTLINE = np.array(
    [
        (0.00, 0.60),
        (0.07, 0.66),
        (0.16, 0.82),
        (0.28, 0.95),
        (0.43, 1.00),
        (0.64, 0.93),
        (0.84, 0.71),
        (0.97, 0.36),
        (1.00, 0.06),
        (0.95, -0.32),
        (0.82, -0.66),
        (0.64, -0.90),
        (0.46, -1.00),
        (0.31, -0.98),
        (0.18, -0.90),
        (0.08, -0.84),
        (0.00, -0.82),
    ]
)


@dataclass(frozen=True, slots=True)
class AppleShape:
    """How one apple differs from a body of revolution and from the mean outline."""

    lobes: float = 0.02  # depth of the five lobes around the calyx, as a part of the radius
    lobe_phase: float = 0.3  # angle of the first lobe about the stem axis [rad]
    cavity: float = 1.0  # depth of the stem cavity relative to the CAD apple's
    basin: float = 1.0  # depth of the calyx basin relative to the CAD apple's
    belly: float = 0.0  # upward shift of the widest ring, in half heights
    # sideways shift of the top against the bottom, as a part of the radius (x, z)
    lean: tuple[float, float] = (0.0, 0.0)


CAD_SHAPE = AppleShape()


def apple_mesh(
    shape: AppleShape = CAD_SHAPE,
    dimensions: tuple[float, float, float] = CAD_DIMENSIONS,
    around: int = 64,
    rings: int = 40,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Build a watertight apple with its stem axis along -y, centred in its cuboid (d_x, d_y, d_z) [m].

    Returns vertices (2 + around * rings, 3) [m] and faces (2 * around * rings, 3), normals outwards.
    """
    radius, height = _outline(shape, rings + 2)
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    ring_radius = radius[1:-1, None]
    ring_height = height[1:-1, None]
    towards_calyx = np.clip(0.5 - 0.5 * ring_height, 0.0, 1.0)
    wave = np.cos(5.0 * (angle[None, :] - shape.lobe_phase))
    # Five knobs stand around the calyx; higher up they fade into a barely pentagonal section.
    lobed_radius = ring_radius * (1.0 + shape.lobes * wave * (0.35 + 0.65 * towards_calyx))
    lobed_height = ring_height - 1.6 * shape.lobes * wave * towards_calyx**2 * ring_radius
    x = lobed_radius * np.cos(angle) + shape.lean[0] * ring_height
    z = lobed_radius * np.sin(angle) + shape.lean[1] * ring_height
    y = -np.broadcast_to(lobed_height, x.shape)
    poles = np.array(
        [[shape.lean[0] * h, -h, shape.lean[1] * h] for h in (height[0], height[-1])],
    )
    vertices = np.vstack([poles[:1], np.stack([x, y, z], axis=-1).reshape(-1, 3), poles[1:]])
    return fit_to_cuboid(vertices, dimensions), revolution_faces(around, rings)


def stem_mesh(
    length: float = 0.024,
    radius: float = 0.0016,
    bend: float = 0.25,
    base_y: float = -0.0255,
    azimuth: float = 0.6,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Build the stem, a bent tube that rises along -y from `base_y`: vertices (n, 3) [m], faces (m, 3)."""
    around = 8
    rings = 7
    along = np.linspace(0.0, 1.0, rings)
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    thickness = radius * (1.0 - 0.25 * along + 0.5 * np.clip(along - 0.75, 0.0, None) * 4.0)
    shift = bend * length * along**2
    x = shift[:, None] * np.cos(azimuth) + thickness[:, None] * np.cos(angle)
    z = shift[:, None] * np.sin(azimuth) + thickness[:, None] * np.sin(angle)
    y = np.broadcast_to((base_y - length * along)[:, None], x.shape)
    body = np.stack([x, y, z], axis=-1)[::-1]
    top = body[0].mean(axis=0)
    bottom = body[-1].mean(axis=0)
    vertices = np.vstack([top[None], body.reshape(-1, 3), bottom[None]])
    return vertices, revolution_faces(around, rings)


def _outline(shape: AppleShape, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (radius, height) at equal arc lengths along the outline, from the stem's pole to the calyx's."""
    radius = _OUTLINE[:, 0]
    height = _OUTLINE[:, 1].copy()
    inner = np.clip(1.0 - radius / 0.43, 0.0, 1.0)
    smooth = inner * inner * (3.0 - 2.0 * inner)
    upper = height > 0.0
    lower = height < 0.0
    height = np.where(upper, height + (1.0 - shape.cavity) * 0.36 * smooth, height)
    height = np.where(lower, height - (1.0 - shape.basin) * 0.16 * smooth, height)
    height = height + shape.belly * (1.0 - height**2) * np.clip(radius * 1.5 - 0.3, 0.0, 1.0)
    chord = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(radius), np.diff(height)))])
    spline = CubicSpline(
        chord, np.stack([radius, height], axis=1), bc_type=((1, (1.0, 0.0)), (1, (-1.0, 0.0)))
    )
    fine = spline(np.linspace(0.0, chord[-1], 2000))
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    wanted = np.linspace(0.0, length[-1], count)
    sampled_radius = np.interp(wanted, length, fine[:, 0])
    sampled_height = np.interp(wanted, length, fine[:, 1])
    sampled_radius[[0, -1]] = 0.0
    return sampled_radius, sampled_height


def fit_to_cuboid(
    vertices: NDArray[np.float64], dimensions: tuple[float, float, float]
) -> NDArray[np.float64]:
    """Move and stretch vertices, (n, 3), so that they fill a cuboid (d_x, d_y, d_z) [m] about the origin."""
    low = vertices.min(axis=0)
    high = vertices.max(axis=0)
    fitted: NDArray[np.float64] = (vertices - 0.5 * (low + high)) * (
        np.asarray(dimensions) / (high - low)
    )
    return fitted


def revolution_faces(around: int, rings: int) -> NDArray[np.int32]:
    """Faces (n, 3) of pole, rings, pole; outwards when the ring angle runs from x to z and rings run along +y."""
    ring = 1 + np.arange(rings)[:, None] * around
    here = np.arange(around)
    following = (np.arange(around) + 1) % around
    a = ring[:-1] + here
    b = ring[:-1] + following
    c = ring[1:] + here
    d = ring[1:] + following
    last = 1 + rings * around
    faces = [
        np.stack([np.zeros(around, int), 1 + here, 1 + following], axis=-1),
        np.stack([a, c, b], axis=-1).reshape(-1, 3),
        np.stack([b, c, d], axis=-1).reshape(-1, 3),
        np.stack([np.full(around, last), ring[-1] + following, ring[-1] + here], axis=-1),
    ]
    return np.concatenate(faces).astype(np.int32)
