"""Errors of the camera's pose, of its depth's scale and of the fingers' width, from the touches of many picks.

A camera that really sits at T_camera_true in its stated frame puts a fruit at p; it lies at p + t + ω × p + κ p. Then

    the first touch is at    side · axis · (t + ω × p + κ p) + g κ a / 2 + z / 2     outwards of the measured skin
    the felt width is        g κ a + z                                               more than the measured width a
    a finger lands at        n · (t + ω × p + κ p) + g κ a / 2      from the measured skin, along n from skin to finger

with t, ω the error of the pose, κ that of the depth's scale, z the difference between the fingers' zero and the
camera's bias in all sizes, which picks do not separate. A fruit of another size than measured moves both, which their
covariance has. Priors keep directions that no pick shows where they are.

A look at the table shows its height and its two tilts in the camera's frame, against the cell file's. They count once
for all picks, since an error of the table itself is the same in all of them: level fingers do not show these three.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.pick import Pick

ZERO = 0.2e-3
BIAS = 0.5e-3
"""Standard deviations of the fingers' zero and of the camera's bias in all sizes [m]: pads are set to zero where they
touch each other; the camera measured the fruit of one simulated cell 0.35 mm too narrow (median)."""

PRIOR = np.array(
    [0.02, 0.02, 0.02, *np.radians([2.0, 2.0, 2.0]), 0.02, float(np.hypot(ZERO, BIAS))]
)
"""Standard deviations of t [m], ω [rad], κ and z [m] before any pick: a cell that somebody set up by hand."""

TOUCH = 0.6e-3
WIDTH = 0.2e-3
SIZE = 0.4e-3
"""Standard deviations of a first touch, a felt width, and a fruit's measured size [m]: a probe with 80 simulated
picks left 0.5 to 0.7 mm per first touch and 0.48 % per width."""

LANDED = 5e-3
"""The same of a finger that lands on a fruit on the approach [m]: of fruit 24 mm aside, six landings showed ways that
were 4 to 6 mm short, since the skin is curved and the fruit gives way. The next picks correct the rest."""

TABLE_HEIGHT = 1e-3
TABLE_TILT = float(np.radians(0.15))
"""Standard deviations of the table's height and tilts in the cell file [m, rad]: measured with a rule and a level."""

SHOWN = 0.6
"""g: share of an error of the depth's scale that the measured size shows (probe: 0.61); the table holds the rest."""

# distance of a pick from the estimate, in standard deviations, beyond which it is left out
OUTLIER = 4.0
HUBER = 2.5  # distance from which a pick pulls no harder
SURE = 4.0  # picks that the deviations above are worth when the picks' own scatter is estimated
ROUNDS = 20  # of the iteration of weights


@dataclass(frozen=True, slots=True, eq=False)
class CameraErrors:
    """Errors of a calibration: t, ω, κ, z (see above) with their covariance."""

    error: Float64  # shape (8,) [m, rad, 1, m]
    covariance: Float64  # shape (8, 8)
    centre: Float64  # mean place of the picked fruit in the camera's frame, shape (3,) [m]
    scatter: float  # scatter of the picks over the assumed one; 1 where they agree
    used: tuple[Pick, ...]
    left_out: tuple[str, ...]  # names of outliers: pushed, slipped or leaning fruit
    picks: tuple[Pick, ...]  # all of them, in the order of time

    @property
    def std(self) -> Float64:
        """Standard deviations of the errors, shape (8,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def shift(self) -> tuple[Float64, Float64]:
        """Where fruit at the centre of the picks really lie from where the camera puts them.

        Returns the shift in the camera's frame, shape (3,) [m], and its covariance, shape (3, 3).
        """
        J = np.hstack([_displacement(self.centre), np.zeros((3, 1))])
        return J @ self.error, J @ self.covariance @ J.T


def estimate(picks: Sequence[Pick]) -> CameraErrors:
    """CameraErrors the errors from picks; outliers lose their weight, then are left out.

    Raises ValueError: there is no pick.
    """
    if not picks:
        raise ValueError("an estimate needs at least one pick")
    found = _fit(picks)
    far = [
        name
        for name, distance in zip((p.name for p in picks), found[3], strict=True)
        if distance > OUTLIER
    ]
    used = [pick for pick in picks if pick.name not in far]
    if far and used:
        found = _fit(used)
    error, covariance, scatter, _ = found
    used = used or list(picks)
    centre = np.mean([pick.place for pick in used], axis=0)
    return CameraErrors(
        error,
        covariance,
        centre,
        scatter,
        tuple(used),
        tuple(far if len(used) < len(picks) else ()),
        tuple(picks),
    )


def touch_left(pick: Pick, error: Float64) -> float:
    """Return the remainder of a pick's first touch after an error of the calibration [m]; NaN where it has none."""
    H, y, _ = _rows(pick)
    return float((y - H @ error)[0]) if pick.side else np.nan


def _fit(picks: Sequence[Pick]) -> tuple[Float64, Float64, float, Float64]:
    """Return error, covariance, scatter, and the distance of each pick in standard deviations."""
    systems = [whitened(pick) for pick in picks]
    H = np.vstack([H for H, _ in systems])
    y = np.concatenate([y for _, y in systems])
    counts = np.array([len(y) for _, y in systems])
    table, pull = shown_by_table(picks)
    of_pick = np.repeat(np.arange(len(systems)), counts)
    before = np.diag(PRIOR**-2.0) + table
    error: Float64 = np.zeros(8)
    scatter = 1.0
    weights: Float64 = np.ones(len(systems))
    distances: Float64 = np.zeros(len(systems))
    information = before
    for _ in range(ROUNDS):
        weighted = H.T * np.repeat(weights / scatter**2, counts)
        information = before + weighted @ H
        error = np.linalg.solve(information, weighted @ y + pull)
        squares = np.bincount(of_pick, (y - H @ error) ** 2, minlength=len(systems))
        learnt = 8.0 - float(np.trace(before @ np.linalg.inv(information)))
        free = max(float(weights @ counts) - learnt, 0.0)
        scatter = float(np.sqrt(max((SURE + float(weights @ squares)) / (SURE + free), 0.25)))
        distances = np.sqrt(squares / np.maximum(counts, 1)) / scatter
        weights = np.minimum(1.0, HUBER / np.maximum(distances, 1e-9))
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    return error, covariance, scatter, distances


def _displacement(p: Float64) -> Float64:
    """Derivative of a fruit's displacement at p by (t, ω, κ), shape (3, 7)."""
    x, y, z = p
    cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # ω × p = cross · ω
    return np.hstack([np.eye(3), cross, np.asarray(p).reshape(3, 1)])


def _rows(pick: Pick) -> tuple[Float64, Float64, Float64]:
    """Return the derivative by the error, the measurement, and its covariance: first touch, then width."""
    H = []
    y = []
    size = []
    width = np.array([0.0] * 6 + [SHOWN * pick.across, 1.0])
    noise = []
    if pick.landed:
        H = [np.append(pick.axis @ _displacement(pick.place), 0.0)]
        H[0][6] += 0.5 * SHOWN * pick.across
        y = [pick.first]
        size = [0.5 * SIZE]
        noise = [LANDED]
    elif pick.side:
        first = 0.5 * width
        first[:7] += pick.side * pick.axis @ _displacement(pick.place)
        H = [first]
        y = [pick.first]
        size = [0.5 * SIZE]
        noise = [TOUCH]
    if np.isfinite(pick.wider) and not pick.landed:
        H.append(width)
        y.append(pick.wider)
        size.append(SIZE)
        noise.append(WIDTH)
    return np.array(H).reshape(-1, 8), np.array(y), np.diag(np.square(noise)) + np.outer(size, size)


def shown_by_table(picks: Sequence[Pick]) -> tuple[Float64, Float64]:
    """Return the information on the error in looks at the table: a matrix, shape (8, 8), and its pull, (8,)."""
    information = np.zeros((8, 8))
    pull = np.zeros(8)
    looks = [pick for pick in picks if pick.table is not None]
    for pick in looks:
        assert pick.table is not None
        (n, d), (stated, offset) = ((plane[:3], plane[3]) for plane in pick.table)
        under = pick.place - (float(n @ pick.place) + d) * n  # the fruit's place on the seen table
        height = np.append(stated @ _displacement(under), 0.0) / TABLE_HEIGHT
        along = np.linalg.svd(n[None])[2][1:]  # two directions along the seen table
        tilts = np.array([np.append(stated @ _displacement(u), 0.0) for u in along]) / TABLE_TILT
        tilts[:, :3] = 0.0  # a direction is not moved
        H = np.vstack([height, tilts])
        y = -np.array(
            [(float(stated @ under) + offset) / TABLE_HEIGHT, *(along @ stated) / TABLE_TILT]
        )
        information += H.T @ H / len(looks)
        pull += H.T @ y / len(looks)
    return information, pull


def table_left(pick: Pick, error: Float64) -> float:
    """Return how far the table of a look stays off after an error, 0.15 m beside the view as well [m]; NaN without."""
    if pick.table is None:
        return np.nan
    (n, d), (stated, offset) = ((plane[:3], plane[3]) for plane in pick.table)
    middle = np.array([0.0, 0.0, -d / n[2]])
    along = np.linalg.svd(n[None])[2][1:]
    points = middle + 0.15 * np.vstack([np.zeros(3), along, -along])
    moved = [p + _displacement(p) @ error[:7] for p in points]
    return float(np.abs(np.array(moved) @ stated + offset).max())


def whitened(pick: Pick) -> tuple[Float64, Float64]:
    """Return a pick's derivative by the error, shape (n, 8), and its measurement, shape (n,), with unit covariance."""
    H, y, C = _rows(pick)
    L = np.linalg.cholesky(C)
    return np.linalg.solve(L, H), np.linalg.solve(L, y)
