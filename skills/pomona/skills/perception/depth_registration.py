"""Check of the registration of depth to colour: mirrored, turned, shifted or foreign depth gives wrong sizes.

Where depth changes, colour mostly does too, and along the same line. So the directions of both gradients (the
normalised gradient fields of Haber and Modersitzki, 2006) agree most for the correct registration. The score of a shift
is the difference of its mean agreement to that of all shifts, in their standard deviations.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import fft2, ifft2, irfft2, rfft2

from pomona.drivers.interfaces import Frame
from pomona.executive.values.arrays import Float32, Float64, UInt8

WIDTH = 320  # width at which it is looked for [px]: leaves and branches are still there
SMOOTH = 1.5  # standard deviation by which both are smoothed [px of `WIDTH`]

SURE = 8.0  # score of depth that belongs to colour: right frames have 9.8 (simulated) to 23 (orchard)


VARIANTS = {
    "is mirrored left to right": (slice(None), slice(None, None, -1)),
    "is mirrored top to bottom": (slice(None, None, -1), slice(None)),
    "is turned by 180°": (slice(None, None, -1), slice(None, None, -1)),
}

Complex = NDArray[np.complex64]


def misplaced_depth(frame: Frame) -> str:
    """Describe the misregistration of depth for the operator; empty if it is correct or unknown."""
    return depth_elsewhere(frame, or_nowhere=True)


def depth_elsewhere(frame: Frame, or_nowhere: bool = False) -> str:
    """Describe the misregistration of depth that fits better shifted, mirrored or turned; else empty.

    `or_nowhere` also reports depth that fits nowhere, as a view of few things does at times.
    """
    if frame.depth is None or not frame.depth.any():
        return ""
    colour, edges = _of_colour(frame.colour), _of_depth(frame.depth)
    here, elsewhere, shift = _scores(colour, edges)
    if here == elsewhere >= SURE:
        return ""
    found = [(elsewhere, _lies(shift, frame.depth.shape[1] / WIDTH))]
    for words, turned in VARIANTS.items():
        found.append((_scores(colour, _of_depth(np.ascontiguousarray(frame.depth[turned])))[1], words))
    score, words = max(found)
    if score >= SURE and here < 0.5 * score:
        return f"depth {words} against colour"
    # minimum ratio of the picture with depth edges for the conclusion that they match no colour edges
    telling = float(np.abs(edges).mean()) >= 0.02 and score > 0.0
    # Score below which the edges disagree everywhere: moved beyond the overlap, the orchard's depth scores 4.6 at most
    return "depth's edges lie nowhere on colour's" if or_nowhere and telling and max(here, score) < 5.0 else ""


def _lies(shift: tuple[int, int], scale: float) -> str:
    """Return words for depth that a shift (right, down) [px of `WIDTH`] would bring onto colour."""
    names = ("left" if shift[0] > 0 else "right"), ("up" if shift[1] > 0 else "down")
    ways = (f"{abs(pixels) * scale:.0f} px {name}" for pixels, name in zip(shift, names, strict=True) if pixels)
    return f"lies {' and '.join(ways)}"


def _size(shape: tuple[int, ...]) -> tuple[int, int]:
    return WIDTH, max(1, round(shape[0] * WIDTH / shape[1]))


def _of_colour(colour: UInt8) -> Complex:
    """Directions of the colour's gradient, of the channel that changes the most."""
    small = cv2.GaussianBlur(
        cv2.resize(colour, _size(colour.shape), interpolation=cv2.INTER_AREA).astype(np.float32), (0, 0), SMOOTH
    )
    x, y = (np.asarray(cv2.Sobel(small, cv2.CV_32F, *order)) / 8.0 for order in ((1, 0), (0, 1)))
    most = np.argmax(x**2 + y**2, axis=2)[..., np.newaxis]
    x, y = (np.take_along_axis(each, most, axis=2)[..., 0] for each in (x, y))
    return _directions(x, y, float(np.median(np.hypot(x, y))) + 1e-3)


def _of_depth(depth: Float32) -> Complex:
    """Return the directions of the gradient of inverse depth; missing depth counts as far away."""
    small = cv2.resize(depth, _size(depth.shape), interpolation=cv2.INTER_NEAREST)
    inverse = np.where(small > 0.0, 1.0 / np.maximum(small, 0.2), 0.0).astype(np.float32)
    smooth = cv2.GaussianBlur(inverse, (0, 0), SMOOTH)
    x, y = (np.asarray(cv2.Sobel(smooth, cv2.CV_32F, *order)) / 8.0 for order in ((1, 0), (0, 1)))
    return _directions(x, y, 0.03)  # change of inverse depth that counts half as an edge [1/m per pixel of `WIDTH`]


def _directions(x: NDArray[Any], y: NDArray[Any], faint: float) -> Complex:
    """Unit vectors of twice the angle, so that light to dark is as good as dark to light; shorter where it is faint."""
    doubled: Complex = ((x + 1j * y) ** 2 / (x**2 + y**2 + faint**2)).astype(np.complex64)
    return doubled


def _scores(colour: Complex, depth: Complex) -> tuple[float, float, tuple[int, int]]:
    """Return the score of depth without or with a small shift, the best score, and its shift (right, down) [px]."""
    height, width = colour.shape
    size = 2 * height, 2 * width
    agree = ifft2(fft2(colour, size) * np.conj(fft2(depth, size))).real
    ones = np.ones(colour.shape, np.float32)
    weight = irfft2(rfft2(ones, size) * np.conj(rfft2(np.abs(depth), size)), size)
    # of the depth's edges that a shift must leave in the picture
    there = weight > 0.6 * max(float(np.abs(depth).sum()), 1e-6)
    mean: Float64 = np.where(there, agree / np.sqrt(np.maximum(weight, 1.0)), -np.inf)
    spread = float(mean[there].std()) if there.any() else 0.0
    if spread < 1e-9:
        return 0.0, 0.0, (0, 0)
    score = (mean - np.median(mean[there])) / spread
    # Registered depth may lie so far beside colour: a share of the picture's width (12 of 1920 px in the orchard)
    beside = int(np.ceil(0.01 * width))
    near = float(np.roll(score, (beside, beside), (0, 1))[: 2 * beside + 1, : 2 * beside + 1].max())
    row, column = np.unravel_index(int(score.argmax()), score.shape)
    right, down = (int((at + half) % (2 * half) - half) for at, half in ((column, width), (row, height)))
    return near, float(score.max()), (right, down)
