"""Colours of fruit, per vertex, linear RGB."""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float32, Float64
from pomona.skills.perception.fruit import FruitModel
from pomona.tools.training.shapes import ShadedMesh

_SKINS = np.array(
    [
        [(0.42, 0.015, 0.02), (0.55, 0.06, 0.03)],  # red
        [(0.20, 0.008, 0.015), (0.36, 0.02, 0.02)],  # dark red
        [(0.50, 0.05, 0.03), (0.68, 0.50, 0.12)],  # red on yellow
        [(0.28, 0.42, 0.05), (0.42, 0.55, 0.10)],  # green
        [(0.66, 0.52, 0.10), (0.62, 0.58, 0.18)],  # yellow
        [(0.60, 0.16, 0.10), (0.62, 0.60, 0.22)],  # pink on pale green
        [(0.42, 0.06, 0.03), (0.34, 0.44, 0.07)],  # red on green
    ]
)


def skins(fruit: FruitModel) -> Float64:
    """Pairs of blush and ground colour, linear RGB (n, 2, 3): an apple's many, or shades of another fruit's own."""
    if fruit.name == "apple":
        return _SKINS
    own = np.asarray(fruit.colour) ** 2.2
    return np.array(
        [
            [own, own * 1.2],
            [own * (0.8, 1.0, 0.7), own * (1.1, 1.0, 1.0)],
            [own * (0.5, 0.9, 0.6), own],
        ]
    )


def skin_paint(
    shape: ShadedMesh, skins: Float64, style: Float64, rng: np.random.Generator
) -> Float32:
    """Linear RGB per vertex (n, 3): ground colour, blush on the sunny side, streaks along meridians, russet hollows."""
    skin = skins[
        int(style[0] * len(skins)) if rng.random() < 0.7 else int(rng.integers(len(skins)))
    ]
    skin = skin * np.exp(rng.normal(0.0, 0.18, (2, 3))) * np.exp(rng.normal(0.0, 0.15))
    x, y, z = shape.vertices.T
    angle = np.arctan2(z, x)
    height = y / (np.abs(y).max() + 1e-9)
    wobble = np.zeros_like(angle)
    for _ in range(4):
        wobble += rng.normal(0.0, 0.35) * np.cos(
            rng.integers(1, 5) * angle + rng.uniform(0, 6.28) + rng.normal() * height * 2
        )
    streak_table = rng.normal(0.0, 1.0, 40)
    streaks = streak_table[
        np.round((angle / (2 * np.pi) + 0.5) * 40).astype(int) % 40
    ] * rng.uniform(0.0, 0.7)
    blush = 1.0 / (1.0 + np.exp(-(rng.normal(0.8, 1.2) + rng.uniform(0.5, 2.0) * wobble + streaks)))
    colour = skin[0] * blush[:, None] + skin[1] * (1.0 - blush[:, None])
    inner = np.clip(1.0 - np.hypot(x, z) / (0.30 * np.abs(x).max()), 0.0, 1.0)[:, None]
    hollow = np.where(y[:, None] < 0, [0.36, 0.34, 0.10], [0.20, 0.15, 0.07]) * rng.uniform(
        0.5, 1.2
    )
    hollow_strength = rng.uniform(0.0, 1.0)
    colour = colour * (1.0 - hollow_strength * inner) + hollow * hollow_strength * inner
    tip = ((y > 0) & (np.hypot(x, z) < 0.09 * np.abs(x).max()))[:, None]
    colour = np.where(tip, np.array([0.06, 0.045, 0.03]) * rng.uniform(0.3, 2.0), colour)
    return colour.astype(np.float32)


def plain_paint(shape: ShadedMesh, style: Float64, rng: np.random.Generator) -> Float32:
    """One colour all over, as simulators paint fruit: linear RGB per vertex (n, 3)."""
    skin = (
        _SKINS[int(style[1] * len(_SKINS))][0] if rng.random() < 0.8 else rng.uniform(0.02, 0.8, 3)
    )
    skin = skin * np.exp(rng.normal(0.0, 0.3, 3))
    return np.broadcast_to(skin.astype(np.float32), shape.vertices.shape)
