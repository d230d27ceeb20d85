"""Things that may be taken for an apple: tomatoes, oranges, peaches, balls, cans, posts and pots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float32, Float64
from pomona.tools.training import shapes
from pomona.tools.training.shapes import ShadedMesh


@dataclass(frozen=True, slots=True, eq=False)
class Lookalike:
    """A thing to be put into a scene."""

    shape: ShadedMesh  # mesh of about unit size
    scale: Float64  # factors to metres, (3,)
    paint: Float32  # linear RGB per vertex, (n, 3)
    grain_frequency: float  # of the surface's mottling [1/m]
    material: tuple[
        float, float, float
    ]  # strength and sharpness of highlights, and strength of the mottling
    upright: bool = False  # it stands as it is modelled; else it lies in any orientation


def draw_lookalike(rng: np.random.Generator) -> Lookalike:
    """One of the kinds, its size, colours and gloss, all from `rng`."""
    kinds = (_tomato, _orange, _peach, _ball, _can, _post, _pot)
    return kinds[rng.choice(len(kinds), p=(0.2, 0.16, 0.16, 0.2, 0.1, 0.08, 0.1))](rng)


def _spread(colour: tuple[float, float, float], rng: np.random.Generator) -> Float64:
    """Return a colour's relatives."""
    spread: Float64 = (
        np.array(colour) * np.exp(rng.normal(0.0, 0.15, 3)) * np.exp(rng.normal(0.0, 0.2))
    )
    return spread


def _mixed(one: Float64, other: Float64, share: Float64) -> Float32:
    return np.asarray(one * share[:, None] + other * (1.0 - share[:, None]), np.float32)


def _angles(shape: ShadedMesh) -> tuple[Float64, Float64]:
    """About the y axis [rad], and away from its upper end (-y) [rad], of each vertex."""
    x, y, z = shape.vertices.astype(np.float64).T
    return np.arctan2(z, x), np.arctan2(np.hypot(x, z), -y)


def _tomato(rng: np.random.Generator) -> Lookalike:
    """Smooth and flat, often ribbed, with a green star of sepals in place of a hollow."""
    shape = shapes.swollen_ball(int(rng.integers(3, 9)), rng.uniform(0.0, 0.05))
    angle, polar = _angles(shape)
    skin = _spread(
        ((0.55, 0.03, 0.015), (0.6, 0.12, 0.02), (0.62, 0.42, 0.03), (0.3, 0.36, 0.06))[
            rng.choice(4, p=(0.62, 0.2, 0.08, 0.1))
        ],
        rng,
    )
    star = (polar < rng.uniform(0.25, 0.6) * (0.4 + 0.6 * np.abs(np.cos(2.5 * angle)))).astype(
        np.float64
    )
    if rng.random() < 0.25:
        star[:] = 0.0
    size = rng.uniform(0.022, 0.05)
    scale = size * np.array([1.0, rng.uniform(0.68, 0.95), 1.0])
    gloss = (rng.uniform(0.2, 0.6), 10.0 ** rng.uniform(1.2, 2.2), rng.uniform(0.0, 0.04))
    return Lookalike(
        shape, scale, _mixed(_spread((0.06, 0.18, 0.03), rng), skin, star), 900.0, gloss
    )


def _orange(rng: np.random.Generator) -> Lookalike:
    """Return a ball with pores and a small navel."""
    shape = shapes.ball()
    _, polar = _angles(shape)
    skin = _spread(
        ((0.72, 0.25, 0.02), (0.75, 0.35, 0.03), (0.7, 0.5, 0.05))[
            rng.choice(3, p=(0.6, 0.25, 0.15))
        ],
        rng,
    )
    navel = (polar < rng.uniform(0.05, 0.2)).astype(np.float64)
    scale = rng.uniform(0.024, 0.05) * np.array([1.0, rng.uniform(0.9, 1.08), 1.0])
    gloss = (rng.uniform(0.05, 0.35), 10.0 ** rng.uniform(0.8, 1.6), rng.uniform(0.1, 0.3))
    return Lookalike(
        shape,
        scale,
        _mixed(_spread((0.2, 0.22, 0.06), rng), skin, navel),
        rng.uniform(800, 3000),
        gloss,
    )


def _peach(rng: np.random.Generator) -> Lookalike:
    """Matt, red on yellow, with a seam from end to end."""
    shape = shapes.seamed_ball(rng.uniform(0.04, 0.12))
    x, y, z = shape.vertices.astype(np.float64).T
    sun = rng.normal(size=3)
    blush = 1.0 / (
        1.0
        + np.exp(
            -rng.uniform(2.0, 6.0) * ((np.stack([x, y, z], 1) @ sun) / np.linalg.norm(sun) + 0.1)
        )
    )
    paint = _mixed(_spread((0.5, 0.07, 0.04), rng), _spread((0.75, 0.42, 0.12), rng), blush)
    scale = rng.uniform(0.024, 0.046) * np.array([1.0, rng.uniform(0.9, 1.1), 1.0])
    return Lookalike(
        shape,
        scale,
        paint,
        rng.uniform(300, 1500),
        (rng.uniform(0.0, 0.08), 8.0, rng.uniform(0.0, 0.12)),
    )


def _ball(rng: np.random.Generator) -> Lookalike:
    """Of one colour, white not seldom, or of two halves or bands; from a table-tennis ball to a handball."""
    shape = shapes.ball()
    first = np.full(3, rng.uniform(0.5, 0.9)) if rng.random() < 0.3 else rng.uniform(0.02, 0.85, 3)
    paint = np.broadcast_to(first.astype(np.float32), shape.vertices.shape)
    if rng.random() < 0.35:
        bands = (
            np.sin(rng.uniform(1.0, 6.0) * shape.vertices.astype(np.float64) @ rng.normal(size=3))
            > 0.0
        )
        paint = _mixed(rng.uniform(0.02, 0.85, 3), first, bands.astype(np.float64))
    gloss = (rng.uniform(0.0, 0.6), 10.0 ** rng.uniform(0.7, 2.2), rng.uniform(0.0, 0.2))
    return Lookalike(
        shape, np.full(3, np.exp(rng.uniform(np.log(0.018), np.log(0.09)))), paint, 900.0, gloss
    )


def _can(rng: np.random.Generator) -> Lookalike:
    """Return a cylinder with bright ends and a printed side."""
    shape = shapes.cylinder()
    y = shape.vertices[:, 1].astype(np.float64)
    print_ = np.where(np.sin(rng.uniform(0.0, 6.0) + rng.uniform(1.0, 9.0) * y) > 0.0, 1.0, 0.0)
    side = _mixed(rng.uniform(0.02, 0.8, 3), rng.uniform(0.02, 0.8, 3), print_)
    metal = np.full(3, rng.uniform(0.3, 0.7))
    paint = np.where((np.abs(y) > 0.95)[:, None], metal, side).astype(np.float32)
    radius = rng.uniform(0.022, 0.05)
    scale = radius * np.array([1.0, rng.uniform(0.5, 2.2), 1.0])
    return Lookalike(
        shape, scale, paint, 500.0, (rng.uniform(0.1, 0.6), 40.0, 0.02), rng.random() < 0.5
    )


def _post(rng: np.random.Generator) -> Lookalike:
    """Return a stake, a pipe or a trunk."""
    shape = shapes.cylinder()
    colour = _spread(
        ((0.14, 0.1, 0.07), (0.4, 0.4, 0.42), (0.5, 0.45, 0.38))[int(rng.integers(3))], rng
    )
    paint = np.broadcast_to(colour.astype(np.float32), shape.vertices.shape)
    scale = np.array([1.0, rng.uniform(5.0, 12.0), 1.0]) * rng.uniform(0.01, 0.045)
    return Lookalike(
        shape,
        scale,
        paint,
        rng.uniform(200, 900),
        (0.05, 10.0, rng.uniform(0.1, 0.35)),
        rng.random() < 0.7,
    )


def _pot(rng: np.random.Generator) -> Lookalike:
    """Return a turned vessel: a bottle, a pot, a handle."""
    shape = shapes.turned_body(rng)
    paint = np.broadcast_to(rng.uniform(0.02, 0.8, 3).astype(np.float32), shape.vertices.shape)
    gloss = (rng.uniform(0.0, 0.6), 10.0 ** rng.uniform(0.7, 2.2), rng.uniform(0.0, 0.15))
    return Lookalike(
        shape, np.full(3, rng.uniform(0.015, 0.05)), paint, 700.0, gloss, rng.random() < 0.5
    )
