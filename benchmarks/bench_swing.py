"""A hand that follows a fruit that swings: prediction by a fitted sine, the arm's limits judged before it moves.

    python -m benchmarks.bench_swing [--count 10] [--seed 1000]

Kinematics only, nothing is grasped. A fruit swings by ± 40 mm about a place before the arm; a camera sees it at 30 Hz,
45 to 65 ms late, with the errors of a look (`track_filter`: 0.1 mm at random and a bias that walks). After `LOOKS`
seconds a sine is fitted, and the whole swing is judged: where it takes more than the joints' limits, nothing moves.
Then the mock arm is streamed to, as in a pick from the belt, and the fit goes on with each frame.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pomona.applications.conveyor.catch import BESIDE
from pomona.applications.conveyor.hand_stream import HALF_TICK, WATCHDOG
from pomona.applications.conveyor.intercepting import SHARE, aim_of
from pomona.applications.conveyor.track_filter import BIAS, BIAS_TIME, SIGMA
from pomona.drivers import ArmLimits, BadTrajectory
from pomona.executive import Float64
from pomona.skills.motion import RobotModel, nearest_solution
from pomona.tools.campaign.statistics import wilson
from pomona.tools.mock import MockArm, MockClock
from pomona.tools.mock.arm import ROBOT, SIA5F_LIMITS

TICK, LOOKS, RUN_UP, FOLLOWS = 0.02, 2.5, 1.5, 3.0
"""Times of a tick, of the first looks, of the hand until it swings with the fruit, and of the following [s]."""
FREQUENCIES = np.arange(0.3, 2.51, 0.05)
"""Frequencies that a fit begins with [Hz]."""
SWING, AHEAD = 0.040, 0.3
"""Half of a swing's width [m], and the time ahead of a prediction that is measured [s]."""
PLACE = (np.array([-0.15, -0.65, 0.10]), np.array([0.15, -0.50, 0.35]))
"""Where fruit hangs: bounds in the base frame [m]."""
OUTWARD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Orientation of a hand that points away from the arm, level."""
WAYS = {"across": (1.0, 0.0, 0.0), "to and fro": (0.0, 1.0, 0.0), "up and down": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """A place that swings.

    Attributes:
        middle, cosine, sine: shape (3,) [m]; omega: angular frequency [rad/s].
    """

    middle: Float64
    cosine: Float64
    sine: Float64
    omega: float

    def at(self, t: float) -> Float64:
        """Return the place at a time [s], shape (3,) [m]."""
        place: Float64 = (
            self.middle + np.cos(self.omega * t) * self.cosine + np.sin(self.omega * t) * self.sine
        )
        return place


def fit_swing(times: Float64, places: Float64) -> Swing:
    """Return the sine that fits places best, by least squares, all axes with one frequency.

    Args:
        times: shape (n,) [s]; places: shape (n, 3) [m].

    Raises ValueError: fewer than eight places.
    """
    if len(times) < 8:
        raise ValueError(f"a swing needs eight places, there are {len(times)}")
    middle = float(np.mean(times))

    def solved(omega: float) -> tuple[Float64, float]:
        angle = omega * (times - middle)
        columns = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
        found, *_ = np.linalg.lstsq(columns, places, rcond=None)
        return found, float(((columns @ found - places) ** 2).sum())

    omegas = 2.0 * np.pi * FREQUENCIES
    best = float(omegas[int(np.argmin([solved(omega)[1] for omega in omegas]))])
    step = float(omegas[1] - omegas[0])
    while step > 1e-4:  # the sum of squares is smooth around its least value
        best = min((best - step, best, best + step), key=lambda omega: solved(omega)[1])
        step *= 0.6
    (level, cosine, sine), _ = solved(best)
    c, s = np.cos(best * middle), np.sin(best * middle)
    return Swing(level, c * cosine - s * sine, s * cosine + c * sine, best)


def share_of_limits(
    robot: RobotModel, limits: ArmLimits, swing: Swing, R_base_tcp: Float64, near: Float64
) -> float:
    """Return the largest share of a joint's speed or acceleration that a hand in a swing needs; inf out of reach.

    Args:
        R_base_tcp: orientation of the hand, shape (3, 3).
        near: joints near the swing's middle, shape (dof,) [rad].
    """
    times, way = np.linspace(0.0, 2.0 * np.pi / swing.omega, 41), [near]
    for t in times:
        if (q := nearest_solution(robot, pose_at(swing.at(float(t)), R_base_tcp), way[-1])) is None:
            return float("inf")
        way.append(q)
    qd = np.gradient(np.array(way[1:]), times, axis=0)
    qdd = np.gradient(qd, times, axis=0)
    return float(
        max((np.abs(qd) / limits.velocity).max(), (np.abs(qdd[1:-1]) / limits.acceleration).max())
    )


def pose_at(p: Float64, R: Float64) -> Float64:
    """Return a transform of a place, shape (3,) [m], and an orientation, shape (3, 3); shape (4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


@dataclass(slots=True)
class Followed:
    """One case: errors of the prediction `AHEAD` and of the hand [m], or the share of the limits that refused it."""

    share: float
    predicted: float = np.nan
    beside: float = np.nan
    stopped: str = ""

    @property
    def outcome(self) -> str:
        """followed, BEHIND, or OUT_OF_REACH, with which nothing has moved."""
        if self.share > SHARE:
            return "OUT_OF_REACH"
        return "followed" if self.beside <= BESIDE and not self.stopped else "BEHIND"


class Looks:
    """A camera's places of a swinging fruit."""

    def __init__(self, truth: Callable[[float], Float64], rng: np.random.Generator) -> None:
        self._truth, self._rng = truth, rng
        self._bias = rng.normal(0.0, BIAS, 3)
        self._coming: deque[tuple[float, float, Float64]] = deque()
        self.seen: deque[tuple[float, Float64]] = deque()
        self._next = 0.0

    def step(self, now: float) -> bool:
        """Expose and deliver frames until now [s]; return True if one has come."""
        while self._next <= now:
            t, keeps = self._next, float(np.exp(-1.0 / 30.0 / BIAS_TIME))
            self._bias = keeps * self._bias + self._rng.normal(
                0.0, BIAS * np.sqrt(1.0 - keeps**2), 3
            )
            place = self._truth(t) + self._bias + self._rng.normal(0.0, SIGMA, 3)
            self._coming.append((t + float(self._rng.uniform(0.045, 0.065)), t, place))
            self._next += 1.0 / 30.0
        came = False
        while self._coming and self._coming[0][0] <= now:
            self.seen.append(self._coming.popleft()[1:])
            came = True
        while self.seen and now - self.seen[0][0] > LOOKS:
            self.seen.popleft()
        return came

    def fit(self) -> Swing:
        """Return the swing of the last looks."""
        return fit_swing(np.array([t for t, _ in self.seen]), np.array([p for _, p in self.seen]))


def follow(frequency: float, way: str, seed: int) -> Followed:
    """Follow one fruit that swings at a frequency [Hz]."""
    rng = np.random.default_rng([seed, 54])
    robot, R, phase = RobotModel.load(ROBOT), OUTWARD, rng.uniform(0.0, 2.0 * np.pi)
    amplitude, middle = SWING * np.array(WAYS[way]), rng.uniform(*PLACE)
    truth = Swing(
        middle, np.cos(phase) * amplitude, np.sin(phase) * amplitude, 2.0 * np.pi * frequency
    ).at
    watch = np.array(
        [-0.821, 0.305, -1.229, -0.411, 0.249, -0.841, 1.854]
    )  # of trees/cells/conveyor.yaml
    q = nearest_solution(robot, pose_at(middle, R), watch)
    if q is None:
        return Followed(float("inf"))
    clock, looks = MockClock(), Looks(truth, rng)
    arm = MockArm(clock, q)
    for _ in range(round(LOOKS / TICK)):
        clock.advance(TICK)
        looks.step(clock.now())
    swing = looks.fit()
    share = share_of_limits(robot, SIA5F_LIMITS, swing, R, q)
    if share > SHARE:
        return Followed(share)
    stream, began, predicted, beside = (
        arm.stream(WATCHDOG),
        clock.now(),
        list[float](),
        list[float](),
    )

    def pose(t: float) -> Float64:
        u = min(max((t - began) / RUN_UP, 0.0), 1.0)
        return pose_at(
            middle + (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5) * (swing.at(t) - middle), R
        )

    while (now := clock.now()) < began + RUN_UP + FOLLOWS:
        if looks.step(now):
            swing = looks.fit()
            predicted.append(float(np.linalg.norm(swing.at(now + AHEAD) - truth(now + AHEAD))))
        ahead = now + stream.delay + HALF_TICK
        aimed = aim_of(robot, pose, ahead, q)
        try:
            if aimed is None:
                raise BadTrajectory("the arm does not reach the swing", 0)
            stream.aim(*aimed, ahead)
        except BadTrajectory as bad:
            return Followed(share, stopped=str(bad))
        q = aimed[0]
        if now > began + RUN_UP:
            beside.append(float(np.linalg.norm(robot.tcp(arm.q)[:3, 3] - truth(now))))
        clock.advance(TICK)
    return Followed(share, float(np.percentile(predicted, 95)), max(beside))


def main() -> None:
    """Print a line for each frequency and direction."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--count", type=int, default=10, help="fruit of each frequency and direction"
    )
    parser.add_argument("--seed", type=int, default=1000)
    said = parser.parse_args()
    for frequency in (0.5, 1.0, 1.5):
        for way in WAYS:
            cases = [follow(frequency, way, said.seed + i) for i in range(said.count)]
            ends = [case.outcome for case in cases]
            went = [case for case in cases if case.outcome != "OUT_OF_REACH"]
            low, high = wilson(ends.count("followed"), len(went)) if went else (0.0, 1.0)
            most = [
                1e3 * max((getattr(case, of) for case in went), default=np.nan)
                for of in ("predicted", "beside")
            ]
            print(
                f"{frequency} Hz {way:12} followed {ends.count('followed')} of {len(went)} ({low:.0%} to {high:.0%}), "
                f"refused {len(cases) - len(went)}; prediction {most[0]:.1f} mm, hand {most[1]:.1f} mm at most; "
                f"share of the limits {np.median([case.share for case in cases]):.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
