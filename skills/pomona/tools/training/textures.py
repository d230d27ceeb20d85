"""Backgrounds and table tops out of noise, reproducible by index."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from pomona.executive.values.arrays import Float32


@lru_cache(maxsize=1)
def grain() -> Float32:
    """Smooth noise with zero mean and unit deviation, tileable in period 256, shape (256, 256)."""
    noise = np.random.default_rng(3).normal(size=(256, 256)).astype(np.float32)
    tiled = cv2.GaussianBlur(np.tile(noise, (3, 3)), (0, 0), 1.2)[256:512, 256:512]
    return np.ascontiguousarray(tiled / tiled.std())


@lru_cache(maxsize=1)
def sensor_noise() -> Float32:
    """White noise of unit deviation to cut pieces from, shape (1024, 1400)."""
    return np.random.default_rng(5).normal(size=(1024, 1400)).astype(np.float32)


def clouds(rng: np.random.Generator, height: int, width: int, octaves: tuple[int, ...]) -> Float32:
    """Noise summed over octaves (cells across the picture), about unit deviation, (h, w)."""
    total = np.zeros((height, width), np.float32)
    for cells in octaves:
        small = rng.normal(size=(max(2, cells * height // width), max(2, cells))).astype(np.float32)
        total += cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)
    return total / np.float32(np.sqrt(len(octaves)))


@lru_cache(maxsize=160)
def background(index: int, height: int, width: int) -> Float32:
    """Background `index`, linear RGB about 0..1, (h, w, 3): walls, gradients, noise, or foliage."""
    rng = np.random.default_rng((17, index))
    kind = index % 4
    if kind == 3:
        return foliage(rng, height, width)
    base = (
        rng.uniform(0.03, 0.9, 3)
        if kind == 0
        else rng.uniform(0.02, 0.7, 3) * rng.uniform(0.3, 1.0)
    )
    picture = np.empty((height, width, 3), np.float32)
    shared = clouds(rng, height, width, (3, 7)) * rng.uniform(0.0, 0.35)
    for c in range(3):
        own = clouds(rng, height, width, (4, 12, 40, 120)) * (0.30 if kind == 1 else 0.04)
        picture[..., c] = base[c] * np.exp(shared + own)
    if kind == 2:
        for _ in range(rng.integers(5, 60)):
            corner = rng.integers(0, (width, height))
            size = rng.integers(5, max(6, width // 3), 2)
            colour = rng.uniform(0.02, 0.8, 3).tolist()
            if rng.random() < 0.5:
                cv2.rectangle(picture, corner.tolist(), (corner + size).tolist(), colour, -1)
            else:
                cv2.ellipse(
                    picture,
                    (corner.tolist(), (size // 2).tolist(), rng.uniform(0, 180)),
                    colour,
                    -1,
                )
    return np.clip(picture, 0.0, 1.5)


def foliage(rng: np.random.Generator, height: int, width: int) -> Float32:
    """Leaves, twigs, gaps of bright sky and dark depth, as stand behind fruit in an orchard: linear RGB (h, w, 3)."""
    picture = np.empty((height, width, 3), np.float32)
    sky = rng.random() < 0.4
    picture[:] = (
        rng.uniform(0.4, 1.2) * np.array([0.8, 0.9, 1.0])
        if sky
        else rng.uniform(0.01, 0.08) * np.array([0.8, 1, 0.6])
    )
    hue = rng.uniform(0.0, 1.0)
    for layer in range(3):
        brightness = (0.25, 0.6, 1.0)[layer]
        for _ in range(int(rng.integers(60, 160))):
            centre = rng.uniform(-20, (width + 20, height + 20))
            length = rng.uniform(0.02, 0.13) * width
            angle = rng.uniform(0.0, 2 * np.pi)
            green = np.array(
                [
                    0.10 + 0.20 * hue * rng.random(),
                    0.16 + 0.2 * rng.random(),
                    0.03 + 0.06 * rng.random(),
                ]
            )
            if rng.random() < 0.08:
                green = np.array([0.35, 0.25, 0.08]) * rng.uniform(0.4, 1.2)
            t = np.linspace(0.0, 1.0, 7)
            half = rng.uniform(0.14, 0.3) * np.sin(np.pi * t**0.8)
            along = np.array([np.cos(angle), np.sin(angle)])
            across = np.array([-along[1], along[0]])
            for side, tone in ((1.0, rng.uniform(0.6, 1.0)), (-1.0, rng.uniform(0.8, 1.3))):
                edge = centre + length * (t[:, None] * along + side * half[:, None] * across)
                outline = np.vstack([edge, [centre + length * along, centre]])
                cv2.fillPoly(
                    picture,
                    [np.round(outline * 8).astype(np.int32)],
                    (green * brightness * tone).tolist(),
                    cv2.LINE_AA,
                    3,
                )
        for _ in range(int(rng.integers(0, 5))):
            ends = np.round(rng.uniform(0, (width, height), (2, 2))).astype(int)
            brown = (np.array([0.16, 0.11, 0.08]) * brightness * rng.uniform(0.5, 1.6)).tolist()
            cv2.line(
                picture,
                ends[0].tolist(),
                ends[1].tolist(),
                brown,
                int(rng.integers(2, 12)),
                cv2.LINE_AA,
            )
    light = np.exp(0.5 * clouds(rng, height, width, (5, 11)))[..., None]
    picture *= light
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.3, 2.5)), np.float32)


@lru_cache(maxsize=96)
def table_top(index: int) -> Float32:
    """Table texture `index`, linear RGB, (256, 256, 3)."""
    rng = np.random.default_rng((19, index))
    size = 256
    kind = index % 6
    base = rng.uniform(0.04, 0.85) * (np.ones(3) + rng.uniform(-0.25, 0.25, 3))
    if kind == 5:
        base = rng.uniform(0.03, 0.7, 3)
    texture = np.broadcast_to(base, (size, size, 3)).astype(np.float32).copy()
    if kind == 1:  # wood: noise drawn out along one direction
        lines = cv2.resize(
            rng.normal(size=(64, 4)).astype(np.float32), (size, size), interpolation=cv2.INTER_CUBIC
        )
        warm = np.array([0.55, 0.33, 0.16]) * rng.uniform(0.4, 1.4)
        texture = (
            warm * np.exp(0.22 * lines + 0.05 * clouds(rng, size, size, (9, 120)))[..., None]
        ).astype(np.float32)
    elif kind == 2:  # cloth
        ramp = np.arange(size) * 2 * np.pi / rng.choice([4, 8, 16])
        texture *= (1.0 + 0.12 * np.sin(ramp)[None, :, None]) * (
            1.0 + 0.12 * np.sin(ramp)[:, None, None]
        )
        texture *= np.exp(0.1 * clouds(rng, size, size, (5, 90)))[..., None]
    elif kind == 3:  # checkers
        cell = int(rng.choice([16, 32, 64]))
        odd = (np.add.outer(np.arange(size) // cell, np.arange(size) // cell) % 2).astype(bool)
        texture[odd] = rng.uniform(0.03, 0.8, 3)
    elif kind == 4:  # speckles and stains
        for c in range(3):
            texture[..., c] *= np.exp(0.3 * clouds(rng, size, size, (6, 30, 128)))
    return np.clip(texture, 0.005, 1.2)
