"""Augmentation of pictures; geometry is the caller's, with that of the labels."""

from __future__ import annotations

import cv2
import numpy as np

from pomona.executive.values.arrays import UInt8


def change_look(picture: UInt8, rng: np.random.Generator) -> UInt8:
    """Light, curves, colours, blur, noise, and the processing of cameras, (h, w, 3) uint8."""
    if rng.random() < 0.12:
        picture = _dapple(picture, rng)
    # Per-channel curves as one look-up: cast, gain, gamma, contrast.
    levels = np.linspace(0.0, 1.0, 256)[:, None]
    cast = np.exp(rng.normal(0.0, 0.06, 3)) * np.exp(rng.normal(0.0, 0.18))
    curve = np.clip(levels * cast, 0.0, 1.0) ** np.exp(rng.normal(0.0, 0.22)) + rng.normal(
        0.0, 0.03
    )
    if rng.random() < 0.25:
        inside = np.clip(curve, 0.0, 1.0)
        curve = curve + rng.uniform(0.0, 0.9) * (inside * inside * (3.0 - 2.0 * inside) - inside)
    curve8 = (np.clip(curve, 0.0, 1.0) * 255.0).astype(np.uint8)[None].transpose(1, 0, 2)
    picture = cv2.LUT(picture, np.ascontiguousarray(curve8.reshape(1, 256, 3)))
    if rng.random() < 0.3:
        mix = np.eye(3) + rng.normal(0.0, 0.10, (3, 3))
        mix /= mix.sum(axis=1, keepdims=True)
        picture = cv2.transform(picture, mix)
    draw = rng.random()
    if draw < 0.24:
        grey = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
        colours = 0.0 if draw < 0.04 else rng.uniform(0.5, 1.7)
        picture = np.asarray(cv2.addWeighted(picture, colours, grey, 1.0 - colours, 0.0), np.uint8)
    if rng.random() < 0.2:
        picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 1.3))
    if rng.random() < 0.3:
        h, w = picture.shape[:2]
        noise = rng.integers(-128, 128, size=(h, w, 1), dtype=np.int16) // int(rng.integers(6, 40))
        picture = np.clip(picture + noise, 0, 255).astype(np.uint8)
    if rng.random() < 0.2:  # sharpened, with halos along edges
        amount = rng.uniform(0.3, 1.5)
        blurred = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.7, 1.6))
        picture = np.asarray(
            cv2.addWeighted(picture, 1.0 + amount, blurred, -amount, 0.0), np.uint8
        )
    if rng.random() < 0.12:
        _, packed = cv2.imencode(
            ".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 86))]
        )
        picture = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
    return picture


def _dapple(picture: UInt8, rng: np.random.Generator) -> UInt8:
    """Blotches of shade, as leaves throw them."""
    h, w = picture.shape[:2]
    cells = int(rng.integers(4, 14))
    field = cv2.resize(
        rng.normal(size=(cells, cells)).astype(np.float32), (w, h), interpolation=cv2.INTER_CUBIC
    )
    lit = 1.0 / (1.0 + np.exp(-rng.uniform(2.0, 12.0) * (field - rng.normal(0.0, 0.5))))
    darkest = rng.uniform(0.25, 0.8)
    return np.asarray(picture * (darkest + (1.0 - darkest) * lit)[..., None], np.uint8)


def cover(
    picture: UInt8, rng: np.random.Generator, chance: float, size: tuple[float, float]
) -> UInt8:
    """Put rectangles of one colour over the picture (h, w, 3), sized as parts of its height."""
    picture = np.ascontiguousarray(picture)
    h, w = picture.shape[:2]
    while rng.random() < chance:
        extent = rng.uniform(*size, 2) * h
        u = rng.uniform(-0.1, 1.0) * w
        v = rng.uniform(-0.1, 1.0) * h
        colour = rng.integers(0, 256, 3).tolist()
        cv2.rectangle(
            picture, (int(u), int(v)), (int(u + extent[0]), int(v + extent[1])), colour, -1
        )
        chance *= 0.7
    return picture
