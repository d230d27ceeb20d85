"""The motion of a hand that picks a fruit from a running belt: reach it and match its speed, descend, rise with it.

Everything is relative to the fruit, whose place is a function of time that may be corrected while the hand moves. In
the fruit's frame the hand comes along a polynomial of fifth order that begins with the fruit's own velocity reversed
and ends at rest above it; another one leads down. A pick is planned to its end before anything moves: all joints of the
way, of the time of closing and of the lift lie within their limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pomona.drivers import ArmLimits
from pomona.executive import Float64
from pomona.skills.motion import RobotModel, nearest_solution

Place = Callable[[float], tuple[Float64, Float64]]
"""Where a fruit is at a time [s], and its velocity: base frame, shape (3,) each [m], [m/s]."""

# height over the grasp at which the hand has matched the fruit's speed along the belt [m]
ABOVE = 0.08
SINKING = 1.875  # speed there, in heights per time of the descent: half the acceleration of one from rest to rest
REACHES = tuple(
    float(reach) for reach in np.arange(0.45, 1.55, 0.1)
)  # times of the reach that are tried [s]
DESCENTS = (
    0.3,
    0.4,
)  # times of the descent that are tried [s]: 80 mm in 0.3 s take 2.6 m/s² and 0.5 m/s
FAST = 0.35  # speed of a belt from which a pick must be shorter, to end within the reach [m/s]
CLOSING = 0.85
QUICK = 0.7
"""Time at the fruit for which reach is kept [s], and on a fast belt: closing took 0.7 s (median) to 0.9 s in 200 picks,
of which 0.15 s are now before the arrival; so it ended 0.49 to 0.67 s after the arrival in 16."""
LIFTS = 2.0  # largest acceleration of a lift [m/s²], as of a fruit that is carried
BRAKES = ((0.10, 0.5), (0.05, 0.3), (0.0, 0.2))
"""Times of the lift with the belt's speed, and then until the hand has no speed along the belt [s]: as usual, as
planned on a fast belt, and where the reach ends."""
# postures of the way that are checked, and a few more at the fruit and during the lift
SAMPLES = 24
SHARE = 0.8
"""Share of the joints' limits of speed and acceleration that a plan may use; the rest follows corrections. With 0.9 and
16 postures the hand fell 40 mm behind on its way at 0.3 m/s, with 0.8 and 24 13 mm."""
# step of a joint between two postures beyond which the arm would change its branch [rad]
JUMP = 0.6
PATIENT = 0.75  # a reach that takes longer waits, while a quicker one will do later [s]
# step along the belt and largest distance at which reach is looked for [m]
COARSE = 0.02
FARTHEST = 1.0
ELLIPSE = 2.146  # radius of a plane's 90 % ellipse in standard deviations


@dataclass(frozen=True, slots=True, eq=False)
class InterceptPlan:
    """A planned pick: the hand's pose at any time, for a place of the fruit.

    Attributes:
        t0: when the hand sets off; reach, descent: times until it is over the fruit, and from there down [s].
        grip: where the TCP is in the fruit's frame of motion when it grips, shape (3,) [m].
        way: coefficients of the reach, shape (6, 3); turn: of the share of the turn, and drop of the height, (6,).
        R_base_start: orientation of the hand at t0, shape (3, 3); axis: rotation vector to the grasp, shape (3,) [rad].
        R_base_grasp: orientation at the grasp, shape (3, 3).
        share: largest share of a joint's speed or acceleration limit on the way.
        times, postures: of the planned way until the hand rests after the lift, shape (n,) [s] and (n, dof) [rad].
    """

    t0: float
    reach: float
    descent: float
    grip: Float64
    way: Float64
    turn: Float64
    drop: Float64
    R_base_start: Float64
    axis: Float64
    R_base_grasp: Float64
    share: float = 0.0
    times: Float64 = field(default_factory=lambda: np.empty(0))
    postures: Float64 = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def arrival(self) -> float:
        """When the hand is around the fruit [s]."""
        return self.t0 + self.reach + self.descent

    def pose(self, t: float, place: Place) -> Float64:
        """T_base_tcp at a time, shape (4, 4)."""
        import cv2  # takes a moment; a run has it since its cell was connected

        s = max(t - self.t0, 0.0)
        T = np.eye(4)
        if s < self.reach:
            turned, _ = cv2.Rodrigues(float(_value(self.turn, s)) * self.axis)
            T[:3, :3], beside = self.R_base_start @ turned, _value(self.way, s)
        else:
            height = float(_value(self.drop, min(s - self.reach, self.descent)))
            T[:3, :3], beside = self.R_base_grasp, np.array([0.0, 0.0, height])
        T[:3, 3] = place(t)[0] + self.grip + beside
        return T


@dataclass(frozen=True, slots=True, eq=False)
class Rise:
    """A rise from a moving pose to rest: it goes up at once, and slows down along the belt a moment later.

    Attributes:
        t0: its begin [s]; T_base_start: the hand's pose then; velocity: shape (3,) [m/s]; height: of the rise [m].
        brakes: one of `BRAKES`.
    """

    t0: float
    T_base_start: Float64
    velocity: Float64
    height: float
    brakes: tuple[float, float] = BRAKES[0]

    @property
    def end(self) -> float:
        """When the hand rests [s]."""
        return self.t0 + max(self._lift, sum(self.brakes))

    @property
    def _lift(self) -> float:
        """Time of the lift [s], a polynomial of fifth order from rest to rest."""
        return math.sqrt(5.774 * self.height / LIFTS)

    def pose(self, t: float) -> Float64:
        """T_base_tcp at a time, shape (4, 4)."""
        s = max(t - self.t0, 0.0)
        T = self.T_base_start.copy()
        u = min(s / self._lift, 1.0)
        ride, brake = self.brakes
        slowing = min(max(s - ride, 0.0), brake)
        ridden = min(s, ride) + slowing - slowing**2 / (2.0 * brake)
        T[:3, 3] += self.velocity * np.array([1.0, 1.0, 0.0]) * ridden
        T[2, 3] += self.height * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)
        return T


@dataclass(frozen=True, slots=True)
class NoPick:
    """Why no pick can be planned now: `code` is empty while it may be possible later; `late`: it never will be."""

    code: str
    reason: str
    late: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ReadyHand:
    """The arm before a pick.

    Attributes:
        robot: model within its inner limits; limits: of the arm; q: joints, shape (dof,) [rad].
        lift: height of the lift [m].
        free: says which part of the robot would touch what on a way, shape (n, dof); empty if it is free.
    """

    robot: RobotModel
    limits: ArmLimits
    q: Float64
    lift: float
    free: Callable[[Float64], str]


def plan_pick(
    hand: ReadyHand, now: float, place: Place, grip: Float64, yaws: Sequence[float], along: Float64
) -> InterceptPlan | NoPick:
    """Plan the quickest pick that is possible.

    Args:
        now: when the hand would set off [s].
        place: of the fruit; the plan takes it to keep the velocity that it has now.
        grip: of the TCP relative to it, shape (3,) [m].
        yaws: angles of the tool's x axis to the belt's direction, in the order in which they are tried [rad].
        along: the belt's direction in the base frame, shape (3,).
    """
    T_base_tcp = hand.robot.tcp(hand.q)
    short = False
    near = False
    steady = _steady(*place(now), now)
    found: NoPick = NoPick("", "the fruit is not near enough yet")
    for reach in REACHES:
        if short and reach > PATIENT:
            break  # a quicker motion will do later
        reached = False
        for descent in DESCENTS:
            for yaw in yaws:
                pick = _pick(T_base_tcp, now, steady, grip, plumb(along, yaw), reach, descent)
                planned = _planned(hand, pick, steady)
                if planned is None:
                    continue
                reached = True
                if planned.share > SHARE:
                    words = f"it takes {planned.share / SHARE:.2f} times what the joints may do"
                    found = (
                        found
                        if found.code
                        else NoPick("", f"the fruit cannot be reached yet: {words}")
                    )
                    continue
                if blocked := hand.free(planned.postures):
                    found = NoPick("OUT_OF_REACH", blocked)
                    continue
                return planned
        short = short or not reached
        near = near or (reached and reach == REACHES[0])
    if (
        near and not found.code
    ):  # the fruit is in reach, and a later start leaves less time to the same place
        return NoPick(
            "OUT_OF_REACH", f"the fruit is too far on: {found.reason.partition(': ')[2]}", late=True
        )
    return found


def grip_yaws(
    vertices: Float64, R_base_fruit: Float64, along: Float64
) -> tuple[tuple[float, ...], float]:
    """Return angles of the tool's x axis to the belt for a narrow grip, least turn first, and the width there [m].

    Args:
        vertices: of the fruit, in its own frame, shape (n, 3) [m].
    """
    points = vertices @ R_base_fruit.T
    angles = np.radians(np.arange(-90.0, 91.0, 15.0))
    widths = np.array([np.ptp(points @ plumb(along, yaw)[:, 1]) for yaw in angles])
    good = angles[widths <= widths.min() + 4e-3]
    ordered = sorted((float(yaw) for yaw in good), key=abs)
    return tuple(ordered[:3]), float(widths[angles == ordered[0]][0])


def ellipse_radius(covariance: Float64) -> float:
    """Return the larger half-axis of the level 90 % ellipse of a place, its covariance (3, 3) [m²], in metres."""
    return ELLIPSE * float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2]).max()))


def reachable(
    hand: ReadyHand, p_base: Float64, R_base_grasp: Float64, along: Float64
) -> tuple[float, float]:
    """Return how far the hand can grip along the belt before and behind a place, without another branch [m]."""
    T_base_tcp = np.eye(4)
    T_base_tcp[:3, :3] = R_base_grasp
    hand_along = float((hand.robot.tcp(hand.q)[:3, 3] - p_base) @ along)
    T_base_tcp[:3, 3] = p_base + hand_along * along
    ends = []
    for way in (-1.0, 1.0):
        q = nearest_solution(hand.robot, T_base_tcp, hand.q)
        at = hand_along
        while q is not None and abs(at - hand_along) < FARTHEST:
            T = T_base_tcp.copy()
            T[:3, 3] = p_base + (at + way * COARSE) * along
            ahead = nearest_solution(hand.robot, T, q)
            if ahead is None or np.abs(ahead - q).max() > JUMP:
                break
            q = ahead
            at = at + way * COARSE
        ends.append(at)
    return ends[0], ends[1]


def aim_of(
    robot: RobotModel, pose: Callable[[float], Float64], t: float, near: Float64
) -> tuple[Float64, Float64] | None:
    """Return joints and their velocity for a moving pose at a time, shape (dof,) [rad], [rad/s]; None out of reach."""
    step = 0.01
    q = nearest_solution(robot, pose(t), near)
    later = None if q is None else nearest_solution(robot, pose(t + step), q)
    if q is None or later is None or np.abs(q - near).max() > JUMP:
        return None
    return q, (later - q) / step


def is_fast(velocity: Float64) -> bool:
    """Return True for a belt whose picks must be shorter; velocity of its load, shape (3,) [m/s]."""
    return bool(np.linalg.norm(velocity) > FAST)


def _steady(p: Float64, v: Float64, now: float) -> Place:
    """Where a fruit of a steady velocity is: a filter's prediction costs 0.1 ms, and a plan asks 2 000 times."""
    return lambda t: (p + (t - now) * v, v)


def _pick(
    T_base_tcp: Float64,
    now: float,
    place: Place,
    grip: Float64,
    R_base_grasp: Float64,
    reach: float,
    descent: float,
) -> InterceptPlan:
    import cv2

    p, v = place(now)
    axis, _ = cv2.Rodrigues(T_base_tcp[:3, :3].T @ R_base_grasp)
    sinks = np.array([-SINKING * ABOVE / descent])
    up = np.array([0.0, 0.0, ABOVE])
    down = np.array([0.0, 0.0, sinks[0]])
    way = _quintic(T_base_tcp[:3, 3] - p - grip, -v, up, down, reach)
    turn = _quintic(np.zeros(1), np.zeros(1), np.ones(1), np.zeros(1), reach)[:, 0]
    drop = _quintic(np.array([ABOVE]), sinks, np.zeros(1), np.zeros(1), descent)[:, 0]
    return InterceptPlan(
        now,
        reach,
        descent,
        grip,
        way,
        turn,
        drop,
        T_base_tcp[:3, :3].copy(),
        axis[:, 0],
        R_base_grasp,
    )


def _planned(hand: ReadyHand, pick: InterceptPlan, place: Place) -> InterceptPlan | None:
    """Return a pick with its postures from start to rest, and its share of the limits; None out of reach."""
    fast = is_fast(place(pick.t0)[1])
    closed = pick.arrival + (QUICK if fast else CLOSING)
    rise = Rise(closed, pick.pose(closed, place), place(closed)[1], hand.lift, BRAKES[fast])

    def way() -> Iterator[tuple[float, Float64]]:
        for t in np.linspace(pick.t0, pick.arrival, SAMPLES + 1):
            yield float(t), pick.pose(float(t), place)
        for t in np.linspace(pick.arrival, closed, 5)[1:]:
            yield float(t), pick.pose(float(t), place)
        for t in np.linspace(closed, rise.end, 7)[1:]:
            yield float(t), rise.pose(float(t))

    q = hand.q
    times = []
    postures = []
    for t, T in way():
        solved = nearest_solution(hand.robot, T, q)
        if solved is None or np.abs(solved - q).max() > JUMP:
            return None
        q = solved
        times.append(t)
        postures.append(q)
    found = np.array(postures)
    t_all = np.array(times)
    qd = np.gradient(found, t_all, axis=0)
    qdd = np.gradient(qd, t_all, axis=0)
    shares = np.abs(qd) / hand.limits.velocity, np.abs(qdd) / hand.limits.acceleration
    return replace(pick, share=float(np.max(shares)), times=t_all, postures=found)


def plumb(along: Float64, yaw: float) -> Float64:
    """Return the orientation of a hand that points down, its x axis turned from the belt's direction, shape (3, 3)."""
    c = np.cos(yaw)
    s = np.sin(yaw)
    x = np.array([c * along[0] - s * along[1], s * along[0] + c * along[1], 0.0])
    x /= np.linalg.norm(x)
    z = np.array([0.0, 0.0, -1.0])
    return np.stack([x, np.cross(z, x), z], axis=1)


def _quintic(p0: Float64, v0: Float64, p1: Float64, v1: Float64, duration: float) -> Float64:
    """Return coefficients of a polynomial between places and velocities, without acceleration at its ends, (6, n)."""
    T = duration
    ends = np.array(
        [
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 2.0, 0.0, 0.0, 0.0],
            [1.0, T, T**2, T**3, T**4, T**5],
            [0.0, 1.0, 2.0 * T, 3.0 * T**2, 4.0 * T**3, 5.0 * T**4],
            [0.0, 0.0, 2.0, 6.0 * T, 12.0 * T**2, 20.0 * T**3],
        ]
    )
    none = np.zeros_like(p0)
    coefficients: Float64 = np.linalg.solve(ends, np.array([p0, v0, none, p1, v1, none]))
    return coefficients


def _value(coefficients: Float64, t: float) -> Float64:
    value: Float64 = np.power(t, np.arange(6)) @ coefficients
    return value


def in_the_way(
    p_others: Sequence[tuple[Float64, float]], p_fruit: Float64, R_base_grasp: Float64, width: float
) -> float:
    """Return the overlap of a finger with a neighbour on the belt [m]; negative is free.

    Args:
        p_others: their places in the base frame, shape (3,), and their largest radii [m].
        width: opening of the fingers [m].
    """
    along = FINGER[0]
    across = width / 2.0 + FINGER[1]
    worst = -np.inf
    for p, radius in p_others:
        x, y, _ = R_base_grasp.T @ (p - p_fruit)
        worst = max(
            worst, radius - float(np.hypot(max(abs(x) - along, 0.0), max(abs(y) - across, 0.0)))
        )
    return float(worst)


FINGER = (0.016, 0.025)
"""Half-width of a finger along the belt, and how far it stands out beyond its pad [m]: trees/robots/sia5f_wsg32.xml."""
