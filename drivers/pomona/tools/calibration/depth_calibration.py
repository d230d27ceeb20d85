"""Error model of a camera's depth, learnt from balls of known size in recorded frames.

A ball gives two distances. Its outline in the picture, with its known size, gives the true one. A sphere of that size,
fitted to the points that the camera measured on it, gives the measured one. Over several balls the two differ by

    measured = offset + (1 + scale) · true,   and outlines that were drawn `outline_growth` pixels too wide,

each with the manufacturer's figure as a prior. The scatter of the points about the sphere is the sensor's noise.
Insufficient data are refused: too few balls, balls that leave the prior as wide as it was, and balls that contradict
each other, where a correction learnt from the others makes the next one worse.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pomona.drivers.depth_model import SENSORS, DepthModel
from pomona.drivers.errors import DriverError
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.executive.values.plain_text import NoTableError, read_table

NAMES = ("name", "fruit_id", "id")  # columns of which one names the ball
LEAST_BALLS = 3  # with fewer than this nothing can be held out

# lower bounds of deviations of offset [m] and scale, without a measurement
LEAST_OFFSET = 5e-3
LEAST_SCALE = 1e-3
DOUBT = 3.0  # limit of the learnt offset and scale, as a multiple of the prior's standard deviation
AROUND = 15  # depth may lie so far beside the picture [px]
LEAST_POINTS = 100  # a ball of fewer points has no sphere


class UnusableDepth(DriverError):
    """Frames or a table from which no depth model can be learnt, with the reason and the remedy."""


@dataclass(frozen=True, slots=True)
class Ball:
    """A ball of known size in a frame: its name, its diameter [m], and the box x, y, w, h around it [px]."""

    frame: str
    name: str
    box: tuple[float, float, float, float]
    diameter: float


@dataclass(frozen=True, slots=True)
class Seen:
    """Measurements of one ball."""

    ball: Ball  # the measured ball
    true: float  # distance of its centre along the camera's axis, from its outline [m]
    per_pixel: float  # by how much `true` would be more if the outline were a pixel narrower [m]
    deviation: float  # standard deviation of `true`, from where the box was drawn [m]
    measured: float  # the same distance from depth [m]
    scatter: float  # standard deviation of the points along the axis about the sphere [m]


@dataclass(frozen=True, slots=True)
class DepthCalibration:
    """A learnt model with its quality."""

    sensor: str  # name of the sensor that was the prior
    model: DepthModel  # the sensor's model with the learnt values
    outline_growth: (
        float  # outline_growth, outline_growth_deviation: excess width of drawn outlines [px]
    )
    outline_growth_deviation: float
    # before, after: root mean square of measured against true distance of balls that were held out, as the sensor was
    # and as it was learnt from the other balls [m]
    before: float
    after: float
    seen: tuple[Seen, ...]  # measurements of each ball

    def __str__(self) -> str:
        m = self.model
        lines = [
            f"offset {1e3 * m.offset:+.1f} ± {1e3 * m.offset_deviation:.1f} mm, scale {100 * m.scale:+.2f} ± "
            f"{100 * m.scale_deviation:.2f} %, outlines {self.outline_growth:+.1f} ± "
            f"{self.outline_growth_deviation:.1f} px too wide",
            f"noise {1e3 * m.growth:.2f} mm at 1 m, growing with the square of the distance",
            f"balls held out lie {1e3 * self.after:.1f} mm off, before {1e3 * self.before:.1f} mm",
        ]
        return "\n".join(lines)

    def save(self, path: Path) -> None:
        """Write a depth model file, with details of the calibration as comments."""
        m = self.model
        notes = "".join(f"# {line}\n" for line in str(self).splitlines())
        path.write_text(
            f"{notes}sensor: {self.sensor}\ndisparity: 0 px\nfloor: 0 mm\ngrowth: {1e3 * m.growth:.4f} mm\n"
            f"offset: {1e3 * m.offset:.3f} mm\noffset_deviation: {1e3 * m.offset_deviation:.3f} mm\n"
            f"scale: {m.scale:.6f}\nscale_deviation: {m.scale_deviation:.6f}\n",
            encoding="utf-8",
        )


def read_balls(path: Path, diameter: str = "diameter_mm", only: str = "") -> list[Ball]:
    """Read balls from a table (CSV) with the columns frame, x, y, w, h, one with the diameter in mm, and a name or id.

    `diameter` is the name of its column; only rows whose names begin with `only` are used.

    Raises UnusableDepth: a column is missing, or a number is none; the text has the line.
    """
    needed = f"a table of balls has frame, name, x, y, w, h and {diameter}"
    try:
        rows = read_table(path, ("frame", "x", "y", "w", "h", diameter))
    except NoTableError as error:
        raise UnusableDepth(f"{path}:1: {error}: {needed}") from error
    if rows and not any(column in rows[0][1] for column in NAMES):
        raise UnusableDepth(f"{path}:1: has no column name: {needed}")
    found = []
    for line, row in rows:
        name = next((row[column] for column in NAMES if row.get(column)), "")
        if not name.startswith(only):
            continue
        try:
            x, y, w, h, size = (float(row[key]) for key in ("x", "y", "w", "h", diameter))
        except (TypeError, ValueError):
            raise UnusableDepth(
                f"{path}:{line}: x, y, w, h and {diameter} must be numbers"
            ) from None
        if not (
            np.isfinite([x, y, w, h, size]).all() and min(w, h) >= 8.0 and 1.0 <= size <= 2000.0
        ):
            raise UnusableDepth(
                f"{path}:{line}: a box of 8 pixels or more and a diameter in mm are needed"
            )
        found.append(Ball(row["frame"], name, (x, y, w, h), 1e-3 * size))
    if not found:
        raise UnusableDepth(
            f"{path}: holds no ball" + (f" with a name that begins with '{only}'" if only else "")
        )
    return found


def look_at_ball(ball: Ball, depth: NDArray[np.float32], intrinsics: Intrinsics) -> Seen:
    """Measure a ball in a depth image, shape (h, w) [m].

    Raises UnusableDepth: the box lies outside the image, or has too little depth.
    """
    x, y, w, h = ball.box
    if x < 0 or y < 0 or x + w > intrinsics.width or y + h > intrinsics.height:
        raise UnusableDepth(f"{ball.name} in {ball.frame}: its box lies outside the image")
    # A ball off the axis is drawn out away from the middle of the picture: sqrt(1 + x²) wide, sqrt(1 + y²) high.
    tan = np.array(
        [
            (x + 0.5 * w - 0.5 - intrinsics.cx) / intrinsics.fx,
            (y + 0.5 * h - 0.5 - intrinsics.cy) / intrinsics.fy,
        ]
    )
    across = ball.diameter * np.array([intrinsics.fx, intrinsics.fy]) * np.sqrt(1.0 + tan**2)
    each = across / np.array([w, h])
    true = math.hypot(
        float(each.mean()), 0.5 * ball.diameter
    )  # the visible part of a ball lies within its tangent cone
    per_pixel = float((each / [w, h]).mean())
    # standard deviation of either drawn side of a box [px]
    deviation = float(np.sqrt(np.sum((each / [w, h]) ** 2)) * math.sqrt(2.0) * 0.5 / 2.0)
    points = _points_of(ball, depth, intrinsics)
    centre = _centre_of_sphere(points, 0.5 * ball.diameter, ball)
    rays = points - centre
    radial = np.linalg.norm(rays, axis=1) - 0.5 * ball.diameter
    facing = np.abs(rays[:, 2]) / np.linalg.norm(rays, axis=1)
    middle = facing > 0.7
    # A wrong scale bends the residuals of the sphere: the noise is the rest after subtracting a smooth surface.
    u, v = (rays[middle, :2] / ball.diameter).T
    smooth = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    local = radial[middle] / facing[middle]
    local = local - smooth @ np.linalg.lstsq(smooth, local, rcond=None)[0]
    scatter = 1.4826 * float(np.median(np.abs(local)))
    return Seen(ball, true, per_pixel, deviation, float(centre[2]), scatter)


def _points_of(ball: Ball, depth: NDArray[np.float32], intrinsics: Intrinsics) -> Float64:
    """Return the points of the connected surface in and beside a ball's box, shape (n, 3) [m]."""
    x, y, w, h = (round(value) for value in ball.box)
    top = max(y - AROUND, 0)
    left = max(x - AROUND, 0)
    part = depth[top : y + h + AROUND, left : x + w + AROUND].astype(np.float64)
    core = part[y - top + h // 4 : y - top + 3 * h // 4, x - left + w // 4 : x - left + 3 * w // 4]
    core = core[core > 0.0]
    nothing = UnusableDepth(
        f"{ball.name} in {ball.frame}: too little depth was measured on it; look from nearer"
    )
    if len(core) < LEAST_POINTS // 4:
        raise nothing
    near = (part > 0.0) & (np.abs(part - np.median(core)) < 0.5 * ball.diameter)
    labels, _ = ndimage.label(near)
    inside = labels[y - top : y - top + h, x - left : x - left + w]
    largest = int(np.argmax(np.bincount(inside[inside > 0], minlength=2))) if inside.any() else 0
    # width of a ball's margin that is left out: its points are mixed with the background [px]
    surface = (
        ndimage.binary_erosion(labels == largest, iterations=2) if largest else np.zeros_like(near)
    )
    rows, columns = np.nonzero(surface)
    if len(rows) < LEAST_POINTS:
        raise nothing
    z = part[rows, columns]
    u = (columns + left - intrinsics.cx) / intrinsics.fx
    v = (rows + top - intrinsics.cy) / intrinsics.fy
    return np.column_stack([u * z, v * z, z])


def _centre_of_sphere(points: Float64, radius: float, ball: Ball) -> Float64:
    """Centre (3,) [m] of the sphere of a known radius through most of the points: Gauss-Newton, Tukey's weights."""
    mean = points.mean(axis=0)
    centre = mean * (1.0 + 0.6 * radius / np.linalg.norm(mean))
    for _ in range(50):
        away = points - centre
        distance = np.linalg.norm(away, axis=1)
        residual = distance - radius
        band = max(4.685 * 1.4826 * float(np.median(np.abs(residual))), 1e-4)
        weight = np.where(np.abs(residual) < band, (1.0 - (residual / band) ** 2) ** 2, 0.0)
        J = away / distance[:, np.newaxis]
        step = np.linalg.lstsq((J.T * weight) @ J, (J.T * weight) @ residual, rcond=None)[0]
        centre = centre + step
        if np.abs(step).max() < 1e-7:
            break
    if not np.isfinite(centre).all() or np.linalg.norm(centre - mean) > 2.0 * radius:
        raise UnusableDepth(
            f"{ball.name} in {ball.frame}: its points lie on no sphere of {2e3 * radius:.0f} mm"
        )
    return np.asarray(centre, dtype=np.float64)


def calibrate_balls(
    balls: Sequence[Ball],
    depths: Mapping[str, NDArray[np.float32]],
    intrinsics: Intrinsics,
    sensor: str,
) -> DepthCalibration:
    """Learn a sensor's depth model from balls of known size; the known `sensor` gives the prior.

    `depths` are depth images by the frames' labels, shape (h, w) [m].

    Raises UnusableDepth: the balls are insufficient.
    """
    unknown = sorted({ball.frame for ball in balls} - set(depths))
    if unknown:
        raise UnusableDepth(f"there is no frame '{unknown[0]}', which the table of balls names")
    seen = [look_at_ball(ball, depths[ball.frame], intrinsics) for ball in balls]
    names = sorted({ball.name for ball in balls})
    if len(seen) < LEAST_BALLS or len(names) < 2:
        raise UnusableDepth(
            f"{len(seen)} looks at {len(names)} ball(s) cannot separate bias from chance: "
            f"show {LEAST_BALLS} or more of at least two balls, at different distances"
        )
    prior = SENSORS[sensor]
    solution, covariance = _solve(seen, prior)
    held = [(s, _solve([o for o in seen if o.ball.name != s.ball.name], prior)[0]) for s in seen]
    before = _rms([s.measured - s.true for s in seen])
    after = _rms([_left_over(s, theta) for s, theta in held])
    middle = float(np.median([s.true for s in seen]))
    row = np.array([1.0, middle])
    known_before = math.sqrt(float(np.sum((_known_before(prior) * row) ** 2)))
    known = math.sqrt(row @ covariance[:2, :2] @ row)
    if (
        known > 0.8 * known_before
    ):  # upper bound of the ratio of the learnt uncertainty to the prior's
        raise UnusableDepth(
            f"these balls give the depth at {middle:.2f} m to ± {1e3 * known:.1f} mm, and "
            f"± {1e3 * known_before:.1f} mm was known before: show more or larger balls, "
            "in boxes that are drawn with care"
        )
    if after >= before:
        raise UnusableDepth(
            f"the balls contradict each other: as the others would correct it the next one is {1e3 * after:.1f} mm "
            f"off, uncorrected {1e3 * before:.1f} mm; check the diameters and the boxes"
        )
    growth = float(np.sqrt(np.mean([(s.scatter / s.true**2) ** 2 for s in seen])))
    model = replace(
        prior,
        disparity=0.0,
        floor=0.0,
        growth=growth,
        offset=float(solution[0]),
        offset_deviation=float(np.sqrt(covariance[0, 0])),
        scale=float(solution[1]),
        scale_deviation=float(np.sqrt(covariance[1, 1])),
    )
    return DepthCalibration(
        sensor,
        model,
        float(solution[2]),
        float(np.sqrt(covariance[2, 2])),
        before,
        after,
        tuple(seen),
    )


def _solve(seen: Sequence[Seen], prior: DepthModel) -> tuple[Float64, Float64]:
    """(offset, scale, outline growth) and their covariance, (3,) and (3, 3): least squares beside the prior."""
    # standard deviation of the outlines' excess width, before any ball is measured [px]
    known = np.array([*(DOUBT * _known_before(prior)), 1.0])
    start = np.array([prior.offset, prior.scale, 0.0])
    rows = np.array([[1.0, s.true, s.per_pixel] for s in seen])
    deviation = np.array([s.deviation for s in seen])
    H = np.diag(known**-2.0) + (rows.T / deviation**2) @ rows
    b = start / known**2 + (rows.T / deviation**2) @ np.array([s.measured - s.true for s in seen])
    solution = np.linalg.solve(H, b)
    residual = np.array([_left_over(s, solution) for s in seen]) / deviation
    spread = max(1.0, float(residual @ residual) / max(len(seen) - 1, 1))
    return solution, np.linalg.inv(H) * spread


def _known_before(prior: DepthModel) -> Float64:
    """Return the standard deviations of offset [m] and scale, (2,), as the sensor's maker lets expect them."""
    return np.array(
        [max(prior.offset_deviation, LEAST_OFFSET), max(prior.scale_deviation, LEAST_SCALE)]
    )


def _left_over(seen: Seen, solution: Float64) -> float:
    """Return the difference between a ball's corrected distance and its true one [m]."""
    return float(seen.measured - seen.true - solution @ [1.0, seen.true, seen.per_pixel])


def _rms(errors: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))
