"""A camera's processing of light: exposure, noise, blur and compression."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32
from pomona.skills.perception.synthetic import textures


def photograph(picture: Float32, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Linear RGB (h, w, 3) as a camera gives it: exposure, lens blur, gamma, shot and read noise, quantisation."""
    h, w = picture.shape[:2]
    bright = float(np.percentile(picture[::8, ::8], 90.0)) + 1e-3
    exposure = rng.uniform(0.55, 1.35) / bright if rng.random() < 0.8 else rng.uniform(0.6, 1.5)
    picture = np.clip(picture * np.float32(exposure), 0.0, 1.6)
    if rng.random() < 0.85:
        picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.35, 1.1))
    if rng.random() < 0.08:
        length = int(rng.integers(2, 5))
        kernel = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
        angle = rng.uniform(0.0, np.pi)
        for s in np.linspace(-length, length, 6 * length):
            kernel[round(length + s * np.sin(angle)), round(length + s * np.cos(angle))] += 1.0
        picture = cv2.filter2D(picture, -1, kernel / kernel.sum())
    coded = (
        np.sqrt(np.clip(picture, 0.0, 1.0))
        if rng.random() < 0.75
        else np.clip(picture, 0.0, 1.0) ** rng.uniform(0.4, 1.0)
    )
    if rng.random() < 0.8:
        level = rng.uniform(0.002, 0.03) * rng.uniform(0.2, 1.0)
        noise = textures.sensor_noise()
        for c in range(3):
            y, x = rng.integers(0, noise.shape[0] - h), rng.integers(0, noise.shape[1] - w)
            coded[..., c] += np.float32(level) * noise[y : y + h, x : x + w]
    return (np.clip(coded, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
