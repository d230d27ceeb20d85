"""Time for a path: joint polylines and smooth joint curves within velocity, acceleration and jerk limits.

A polyline is driven at constant speed along each segment and then averaged over two sliding windows of T1 and T2
seconds (a finite impulse response filter). The first average turns steps of velocity into ramps (bounded acceleration),
the second turns ramps into S-curves (bounded jerk). Straight segments stay straight; a corner is rounded where two
segments fall into one window, and stays sharp where the motion dwells at it for T1 + T2. All derivatives are second
differences of integrals of the piecewise linear input, so they are exact and their extremes are known exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.executive.values.arrays import Float64

PERIOD = 0.008  # spacing of a trajectory's samples [s]

_SPEED_SHARES = (1.4, 1.2, 1.0, 0.8, 0.62, 0.48, 0.36, 0.26, 0.18, 0.12, 0.07, 0.04)
_WHOLE = 1.0 - 1e-9
_FINE = 2.5e-4  # spacing along a curve of the speeds that are allowed there [m]
_STEP = 1e-3  # spacing of the knots with which a ramp of speed becomes piecewise linear [s]


@dataclass(frozen=True, slots=True, eq=False)
class _Filtered:
    """A piecewise linear motion (knots at `t`, values `p`, zero at first) averaged over windows `T1` and `T2`."""

    t: Float64
    p: Float64
    T1: float
    T2: float

    @property
    def duration(self) -> float:
        return float(self.t[-1]) + self.T1 + self.T2

    def at(self, t: Float64) -> tuple[Float64, Float64, Float64]:
        """Position, velocity and acceleration at times `t`, shapes (n, dof)."""
        h = np.diff(self.t)[:, None]
        v = np.diff(self.p, axis=0) / h
        zero = np.zeros_like(self.p[:1])
        P1 = np.concatenate([zero, np.cumsum(h * (self.p[:-1] + self.p[1:]) / 2.0, axis=0)])
        P2 = np.concatenate(
            [zero, np.cumsum(h * P1[:-1] + h**2 / 2.0 * self.p[:-1] + h**3 / 6.0 * v, axis=0)]
        )
        times = np.concatenate([t, t - self.T1, t - self.T2, t - self.T1 - self.T2])
        inside = np.clip(times, self.t[0], self.t[-1])
        k = np.clip(np.searchsorted(self.t, inside, side="right") - 1, 0, len(self.t) - 2)
        u = (inside - self.t[k])[:, None]
        beyond = np.maximum(times - self.t[-1], 0.0)[:, None]
        p = self.p[k] + u * v[k]
        p1 = P1[k] + u * self.p[k] + u**2 / 2.0 * v[k] + beyond * self.p[-1]
        p2 = P2[k] + u * P1[k] + u**2 / 2.0 * self.p[k] + u**3 / 6.0 * v[k]
        p2 = p2 + beyond * P1[-1] + beyond**2 / 2.0 * self.p[-1]
        return self._second_difference(p2), self._second_difference(p1), self._second_difference(p)

    def _second_difference(self, of: Float64) -> Float64:
        a, b, c, d = of.reshape(4, -1, self.p.shape[1])
        difference: Float64 = ((a - b) - (c - d)) / (self.T1 * self.T2)
        return difference

    def peaks(self) -> tuple[Float64, Float64, Float64]:
        """Return the largest |velocity|, |acceleration| and |jerk| of each joint, shape (dof,).

        Jerk is constant between knots and acceleration is linear, so both peak at knots; velocity peaks at a knot or
        where acceleration crosses zero.
        """
        t = np.unique(
            np.concatenate([self.t, self.t + self.T1, self.t + self.T2, self.t + self.T1 + self.T2])
        )
        t = t[np.concatenate([[True], np.diff(t) > 1e-9])]
        _, v, a = self.at(t)
        h = np.diff(t)[:, None]
        jerk = np.diff(a, axis=0) / h
        crosses = a[:-1] * a[1:] < 0.0
        rise = np.where(crosses, a[:-1] ** 2 / (2.0 * np.maximum(np.abs(jerk), 1e-12)), 0.0)
        between = np.abs(v[:-1] + np.sign(a[:-1]) * rise)
        velocity = np.maximum(np.abs(v).max(axis=0), between.max(axis=0))
        return velocity, np.abs(a).max(axis=0), np.abs(jerk).max(axis=0)


def time_polyline(
    waypoints: ArrayLike, limits: ArmLimits, dwells: ArrayLike | None = None, period: float = PERIOD
) -> Trajectory:
    """Return the quickest of a family of jerk-limited motions from rest to rest along a polyline with rounded corners.

    Args:
        waypoints: shape (n, dof) [rad]; repeated neighbours are dropped. Without a length the motion stands still.
        dwells: per waypoint, shape (n,), how sharp the corner stays: 0 rounds it, 1 comes to rest in it.
        period: spacing of the samples [s].
    """
    q = np.atleast_2d(np.asarray(waypoints, dtype=np.float64))
    stay = np.zeros(len(q)) if dwells is None else np.asarray(dwells, dtype=np.float64)
    keep = np.concatenate([[True], np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0) > 1e-9])
    q = q[keep]
    stay = stay[keep]
    if len(q) == 1:
        still = np.zeros((2, q.shape[1]))
        return Trajectory(np.array([0.0, period]), np.repeat(q, 2, axis=0), still, still)
    best = min(
        (_fit(q - q[0], limits, stay, share) for share in _SPEED_SHARES), key=lambda f: f.duration
    )
    return _sampled(best, q[0], q[-1], period)


def _sampled(motion: _Filtered, start: Float64, end: Float64, period: float) -> Trajectory:
    """Return a filtered motion from start to end, shape (dof,), as samples."""
    t = _sample_times(motion.duration, period)
    p, v, a = motion.at(t)
    v[[0, -1]] = 0.0
    p += start
    p[0], p[-1] = start, end
    return Trajectory(t, p, v, a)


def _fit(p: Float64, limits: ArmLimits, stay: Float64, share: float) -> _Filtered:
    """Return the filtered motion at a share of the velocity limits, scaled in time until all limits hold exactly."""
    steps = np.diff(p, axis=0)
    h = (np.abs(steps) / (share * limits.velocity)).max(axis=1)
    v = steps / h[:, None]
    jumps = np.abs(np.diff(np.vstack([np.zeros_like(v[:1]), v, np.zeros_like(v[:1])]), axis=0)).max(
        axis=0
    )
    T1 = float((jumps / limits.acceleration).max())
    T2 = float((jumps / (T1 * limits.jerk)).max())
    times = [0.0]
    values = [p[0]]
    stay = np.append(stay[:-1], 0.0)
    for duration, value, dwell in zip(h, p[1:], stay[1:], strict=True):
        times.append(times[-1] + duration)
        values.append(value)
        if dwell > 0.0:
            times.append(times[-1] + dwell * (T1 + T2))
            values.append(value)
    motion = _Filtered(np.array(times), np.array(values), T1, T2)
    velocity, acceleration, jerk = motion.peaks()
    stretch = (
        max(
            float((velocity / limits.velocity).max()),
            float((acceleration / limits.acceleration).max()) ** 0.5,
            float((jerk / limits.jerk).max()) ** (1.0 / 3.0),
        )
        / _WHOLE
    )
    return _Filtered(motion.t * stretch, motion.p, T1 * stretch, T2 * stretch)


def time_curve(
    points: ArrayLike,
    length: float,
    limits: ArmLimits,
    speed: float,
    acceleration: float,
    jerk: float,
    period: float = PERIOD,
    most: Float64 | None = None,
    deceleration: float | None = None,
) -> Trajectory:
    """Return a jerk-limited motion from rest to rest along a smooth joint curve, such as a straight line of the tool.

    Args:
        points: joints at equal steps along the curve, shape (n, dof) [rad], n >= 4.
        length: of the curve [m].
        limits: of the arm; where they bind, the whole motion is slowed down.
        speed, acceleration, jerk, period: along the curve [m/s, m/s², m/s³], and spacing of the samples [s].
        most: largest speeds at equal steps along the curve, shape (m,) [m/s]; None: `speed` everywhere.
        deceleration: along the curve [m/s²], with the jerk in its ratio to the acceleration; None: as the acceleration.
    """
    from scipy.interpolate import CubicSpline  # takes 0.3 s of the processor to load

    q = np.asarray(points, dtype=np.float64)
    if length < 1e-9:
        return time_polyline(q[:1], limits, period=period)
    curve = CubicSpline(
        np.linspace(0.0, length, len(q)), q, bc_type="natural" if len(q) < 4 else "not-a-knot"
    )
    along = ArmLimits(*(np.array([value]) for value in (0.0, length, speed, acceleration, jerk)))
    braking = acceleration if deceleration is None else deceleration
    profile = _profile(length, along, most, braking, period)
    first, second, third = (curve(profile.q[:, 0], order) for order in (1, 2, 3))
    s1 = profile.qd
    s2 = profile.qdd
    s3 = np.gradient(s2[:, 0], profile.t)[:, None]
    qd = first * s1
    qdd = second * s1**2 + first * s2
    qddd = third * s1**3 + 3.0 * second * s1 * s2 + first * s3
    # as a controller interpolates the samples
    jerk_between = np.diff(qdd, axis=0) / np.diff(profile.t)[:, None]
    stretch = max(
        1.0,
        float((np.abs(qd) / limits.velocity).max()),
        float((np.abs(qdd) / limits.acceleration).max()) ** 0.5,
        float((np.abs(qddd) / limits.jerk).max()) ** (1.0 / 3.0),
        float((np.abs(jerk_between) / limits.jerk).max()) ** (1.0 / 3.0),
    )
    if stretch > 1.0:
        slower = stretch * 1.02
        rates = speed / slower, acceleration / slower**2, jerk / slower**3
        return time_curve(q, length, limits, *rates, period, most, braking / slower**2)
    return Trajectory(profile.t, curve(profile.q[:, 0]), qd, qdd)


def _profile(
    length: float, limits: ArmLimits, most: Float64 | None, braking: float, period: float
) -> Trajectory:
    """Return the distance over time [m] along a curve of one dimension that brakes differently, or is slow in parts.

    Ramps of constant acceleration are averaged over a window, as in the module's text: the speed follows half a window
    later.
    """
    speed = float(limits.velocity[0])
    a = float(limits.acceleration[0])
    if most is None and braking == a:
        return time_polyline([[0.0], [length]], limits, period=period)
    window = a / float(limits.jerk[0])
    at = np.linspace(0.0, length, max(8, int(length / _FINE)) + 1)
    allowed = np.minimum(speed, [np.inf] * 2 if most is None else most)
    mean = 2.0 * a * braking / (a + braking)  # of two ramps with a cruise of a window between them
    top = min(speed, float(mean / 2.0 * (np.sqrt(window**2 + 4.0 * length / mean) - window)))
    squares = np.minimum(np.interp(at, np.linspace(0.0, length, len(allowed)), allowed), top) ** 2
    squares[[0, -1]] = 0.0
    for order, rate in ((range(1, len(at)), a), (range(len(at) - 2, -1, -1), braking)):
        for i in order:
            squares[i] = min(squares[i], squares[i - order.step] + 2.0 * rate * at[1])
    speeds = np.sqrt(squares)
    times = np.append(0.0, np.cumsum(2.0 * at[1] / (speeds[1:] + speeds[:-1])))
    t = np.append(np.arange(0.0, times[-1], _STEP), times[-1])
    v = np.interp(t, times, speeds)
    p = np.append(0.0, np.cumsum((v[1:] + v[:-1]) / 2.0 * np.diff(t)))
    motion = _Filtered(t, (p * length / p[-1])[:, None], _STEP, window)
    return _sampled(motion, np.zeros(1), np.array([length]), period)


def _sample_times(duration: float, period: float) -> Float64:
    """Equal steps of at most `period` that end exactly at `duration`."""
    return np.linspace(0.0, duration, max(2, int(np.ceil(duration / period)) + 1))
