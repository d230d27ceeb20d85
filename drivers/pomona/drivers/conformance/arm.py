"""Claims of arms that follow paths, judged by where the joints truly are, and when."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from itertools import product
from unittest import mock

import numpy as np

from pomona.drivers.conformance.bench import STEP, Bench
from pomona.drivers.conformance.claims import Claims, Finding
from pomona.drivers.conformance.gripper import require
from pomona.drivers.errors import DeviceError, MotionRefused
from pomona.drivers.interfaces import ArmLimits, Motion, MotionState, Trajectory
from pomona.executive.cell.device import FaultSwitch
from pomona.executive.clock import Clock
from pomona.executive.values.arrays import Float64

LONG = 1.2  # motions of these claims take this time at least [s]
SHARE = 0.8  # of the limits that they need
INTO = 0.2  # time after its begin at which a motion is disturbed [s]
SHORT = 0.1  # share of its way that a stopped motion has left
STILL = 1e-3  # joints at rest stay within this [rad]
STANDS = 0.1  # joints that stay for this long have come to rest [s]
REST = 1.0  # they rest within this time after a stop that was delivered [s]
NEAR = 3e-3  # joints so near to a place are there [rad]
BESIDE = 0.02  # an arm stays within this distance of its path, whatever happens [rad]
STRAYS = 5e-3  # an unordered motion of this size is noticed [rad]
NOTICED = 0.1  # within this time after it [s]
GRID = 0.01  # times at which speeds and accelerations are judged [s]
COARSE = 0.03  # the same beside a controller whose cycles are not this computer's [s]
LATE = (0.02, 0.05)  # by which a wire is late [s]
UNLOCKED = 8.0  # within this time an arm can be acknowledged [s]: a protective stop takes five
FREED = 20.0  # acceleration of joints that come free, towards their set-point [rad/s²]
TREMOR = 1e-5  # of joints that something holds [rad]
LIES: Mapping[str, Callable[[Float64], Callable[[Float64], Float64]]] = {
    "nan": lambda _now: lambda q: q * np.nan,
    "frozen": lambda now: lambda _q: now,
    "one-frozen": lambda now: lambda q: np.concatenate([now[:1], q[1:]]),
    "odd": lambda _now: lambda q: q + 0.6 * (np.arange(q.size) == 1),
    "exchanged": lambda _now: lambda q: np.concatenate([q[1::-1], q[2:]]),
}
"""What joints report instead of the truth; each begins with where they are at that time."""


class Body:
    """The joints as they truly are: driven by a controller, held or pushed by the world.

    Attributes:
        q, qd: true joints [rad] and their speeds [rad/s], (dof,).
        pushed: by which something pushes them away from where they are driven, (dof,) [rad].
        is_held: something holds them. Those that come free go to where they are driven.
        says: what is reported of the true joints.
        track: times [s] and joints at these times.
    """

    def __init__(
        self, clock: Clock, q: Float64, aimed: Callable[[], Float64] | None = None
    ) -> None:
        """
        Args:
            q: at the beginning.
            aimed: returns where the joints are driven now. None: `drive` tells it.
        """
        self.q, self.qd = q.copy(), np.zeros_like(q)
        self.pushed = np.zeros_like(q)
        self.is_held = False
        self.says: Callable[[Float64], Float64] = lambda q: q
        self.track: list[tuple[float, Float64]] = []
        self._clock = clock
        self._freed = (
            math.inf
        )  # speed of joints that have come free, while they are not where they are driven [rad/s]
        self._set_point, self._speed = q.copy(), np.zeros_like(q)
        self._aimed: Callable[[], Float64] = aimed or (lambda: self._set_point)

    def measured(self) -> tuple[Float64, Float64]:
        """Return the true joints and their speeds, (dof,) each, as the controller behind them knows them."""
        return self.q.copy(), self.qd.copy()

    def drive(self, q: Float64, qd: Float64) -> None:
        """Take the controller's set-point of now."""
        self._set_point, self._speed = q.copy(), qd.copy()

    def told(self, _q: Float64 | None = None) -> Float64:
        """Return the joints that are reported, shape (dof,)."""
        return self.says(self.q.copy())

    def advance(self, _now: float = 0.0) -> None:
        """Let the joints move for a step of the clock."""
        now = self._clock.now()
        if self.is_held:
            self.qd = np.zeros_like(self.q)
            self.q = self.q + TREMOR * math.sin(len(self.track))
            self._freed = 0.0
        elif math.isinf(self._freed):
            self.q, self.qd = self._aimed() + self.pushed, self._speed
        else:
            passed = now - self.track[-1][0]
            way = self._aimed() + self.pushed - self.q
            self._freed += FREED * passed
            self.qd = np.clip(way / passed, -self._freed, self._freed)
            self.q = self.q + self.qd * passed
            if np.abs(way).max() <= self._freed * passed:
                self._freed = math.inf
        self.track.append((now, self.q))


class Lies(FaultSwitch):
    """What joints report instead of the truth."""

    known_faults = tuple(LIES)

    def __init__(self, body: Body) -> None:
        super().__init__()
        self._body = body

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        self._body.says = LIES[kind](self._body.q.copy())

    def clear_fault(self) -> None:
        super().clear_fault()
        self._body.says = lambda q: q


class ArmBench(Bench):
    """An arm's driver and its joints."""

    def __init__(
        self,
        device: object,
        clock: Clock,
        body: Body,
        *,
        way: Float64 | None = None,
        switches: Mapping[str, FaultSwitch] | None = None,
        without: tuple[str, ...] = (),
        rough: float = 3.0,
        foreign: Callable[[], None] | None = None,
        pace: Callable[[float], None] | None = None,
        late: Mapping[str, Callable[[float], None]] | None = None,
        step_clocks: Callable[[float, float], None] | None = None,
    ) -> None:
        """
        Args:
            way: free motion from where the joints are, (dof,) [rad]; 0.5 to 0.2 rad towards the middle of each by default.
            switches: by which the arm can be harmed, by the name of the wire; "" for the controller's own.
            without: harms that no driver could notice.
            rough: jerk of the motions, as a multiple of the limits: of cubics between points that are far apart.
            foreign: another client gives a set-point.
            pace: sets the rate of the controller's own time, 1 at the beginning.
            late: set by how much later each wire brings what the controller says [s].
            step_clocks: steps the clocks of this computer and of the controller [s], where one depends on the other.
        """
        super().__init__(device, clock)
        named = [*(switches or {}).items(), ("", Lies(body))]
        self.harms = {
            kind: switch
            for name, switch in named
            for fault in switch.known_faults
            if (kind := f"{name} {fault}".strip()) not in without
        }
        self.body = body
        self.rough = rough
        self.foreign = foreign
        self.pace = pace
        self.late = late or {}
        self.step_clocks = step_clocks
        middle = 0.5 * (self.limits.lower + self.limits.upper)
        each = np.linspace(0.5, 0.2, body.q.size)
        self.way = np.copysign(each, middle - body.q) if way is None else way
        self.start = body.q.copy()

    @property
    def limits(self) -> ArmLimits:
        """Limits that the driver tells."""
        limits: ArmLimits = self.device.limits
        return limits

    def harm(self, kind: str, seconds: float) -> None:
        if kind:
            self.harms[kind].inject_fault(kind.rpartition(" ")[2])
        self.serve(seconds)

    def path(self, share: float = 1.0) -> Trajectory:
        """Return a motion from where the arm is, along its way or back, or along a share of it."""
        self.start = self.body.q.copy()
        self.way = -self.way
        way = -share * self.way
        limits = self.limits
        needs = (
            (15.0 / 8.0 / limits.velocity, 1.0),
            (10.0 / math.sqrt(3.0) / limits.acceleration, 2.0),
            (60.0 / limits.jerk, 3.0),
        )
        each = [(np.abs(way) * need / SHARE).max() ** (1.0 / power) for need, power in needs]
        duration = max(share * LONG, *each)
        x = np.linspace(0.0, 1.0, 201)[:, None]
        return Trajectory(
            x[:, 0] * duration,
            self.start + way * x**3 * (10.0 - 15.0 * x + 6.0 * x**2),
            way * 30.0 * (x * (1.0 - x)) ** 2 / duration,
            way * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / duration**2,
        )

    def follow(self, share: float = 1.0) -> Motion:
        """Begin a motion along its way or back, or along a share of it."""
        motion: Motion = self.device.follow(self.path(share))
        return motion

    def begin(self, phase: str = "motion") -> Motion:
        """Return a motion on its way, resting in a pause, or braking for a stop."""
        motion = self.follow()
        self.serve(1.0, lambda: self.went(self.start) > NEAR)
        require(self.went(self.start) > NEAR, f"a motion is {motion.state.name}, and nothing moves")
        self.serve(INTO)
        if phase == "pause":
            self.device.pause()
            self.serve(2.0, self.device.settled)
        elif phase == "stop":
            self.device.safe_stop("test")
            self.serve(0.01)
        return motion

    def finish(self, motion: Motion) -> None:
        """Wait for the end of a motion."""
        self.serve(6.0, lambda: motion.settled)

    def acknowledge(self) -> None:
        """Acknowledge a problem until there is none."""
        end = self.now + UNLOCKED
        while self.problem() and self.now < end:
            with suppress(DeviceError):
                self.device.acknowledge()
            self.serve(0.3)

    def went(self, q: Float64) -> float:
        """Return the largest way of a joint from a place [rad]."""
        return float(np.abs(self.body.q - q).max())

    def rest(self, words: str, within: float = REST, stays: float = 0.6) -> None:
        """Raise Finding: the joints do not rest within a time [s], move again after it, or have left their path."""
        rested = self.body.q
        since = self.now
        end = since + within
        while self.now < since + STANDS:
            self.serve(STEP)
            if self.went(rested) > 0.2 * STILL:
                require(self.now < end + STANDS, f"{words} the arm still moves after {within:g} s")
                rested = self.body.q
                since = self.now
        end = self.now + stays
        while self.now < end:
            self.serve(STEP)
            moved = self.went(rested)
            require(moved < STILL, f"{words} at rest, a joint moved by {moved:.4f} rad")
        way = -self.way
        done = float(np.clip(((rested - self.start) @ way) / (way @ way), 0.0, 1.0))
        beside = self.went(self.start + done * way)
        require(beside < BESIDE, f"{words} it rests {beside:.3f} rad beside its path")

    def keeps_limits(
        self, words: str, since: float, *, brakes: bool = True, step: float = GRID
    ) -> None:
        """Raise Finding: since a time [s] a joint was too fast, or speeded up too much.

        Args:
            brakes: braking keeps the limits, too, and the jerk does. A controller's own stop may be harder.
            step: between the times at which joints are compared [s].
        """
        times, joints = zip(*[one for one in self.body.track if one[0] >= since], strict=True)
        grid = np.arange(times[0], times[-1], step)
        q = np.array([np.interp(grid, times, each) for each in np.array(joints).T]).T
        qd = np.diff(q, axis=0) / step
        qdd = np.diff(qd, axis=0) / step
        faster = np.diff(np.abs(qd), axis=0) / step
        bounds = [
            ("velocity", np.abs(qd), 1.02 * self.limits.velocity),
            ("acceleration", np.abs(qdd) if brakes else faster, 1.1 * self.limits.acceleration),
        ]
        if brakes:
            jerk = np.abs(np.diff(qdd, axis=0)) / step
            bounds.append(("jerk", jerk, self.rough * self.limits.jerk))
        for name, rates, limit in bounds:
            most = float((rates / limit).max())
            require(most <= 1.0, f"{words} a joint has {most:.2g} times its largest {name}")


Opened = Callable[[], ArmBench]
ARM: Claims[ArmBench] = Claims("arm")


def arm_claims(**benches: Opened) -> Callable[..., None]:
    """Return a test for pytest of every claim, for each bench by its name."""
    return ARM.tests(**benches)


def disturbed(opened: Opened, ways: tuple[str, ...]) -> Iterator[tuple[ArmBench, str, str]]:
    """Yield new benches whose controller's time or wires differ, with each way, and words for the difference."""
    bench = opened()
    rates = (0.7, 0.5) if bench.pace else ()
    for words, rate, wire, late in [
        ("", 1.0, "", 0.0),
        *((f"its controller at {rate:.0%} of our time:", rate, "", 0.0) for rate in rates),
        *(
            (f"the wire '{wire}' {late:g} s late:", 1.0, wire, late)
            for wire, late in product(bench.late, LATE)
        ),
    ]:
        for way in ways:
            bench = opened()
            if bench.pace:
                bench.pace(rate)
            if wire:
                bench.late[wire](late)
            bench.serve(0.3)
            bench.acknowledge()  # a wire that becomes late was silent
            yield bench, way, words


# ------------------------------------------------------------------------------- claims that no driver can declare away


@ARM.essential
def a_stop_is_delivered(opened: Opened) -> None:
    """A stop ends each motion, also one that comes while the controller does not answer."""
    for harm in ("", *opened().harms):
        bench = opened()
        bench.begin()
        bench.harm(harm, 0.05)
        bench.device.safe_stop("test")
        bench.serve(0.1)
        bench.heal()
        bench.rest(f"'{harm}', then a stop:")
        left = bench.went(bench.start - bench.way) / np.abs(bench.way).max()
        require(left > SHORT, f"'{harm}', then a stop: it went on to {1.0 - left:.0%} of its way")
    for phase in ("pause", "stop"):
        bench = opened()
        bench.begin(phase)
        bench.device.resume()
        bench.serve(0.1)
        bench.device.safe_stop("test")
        bench.rest(f"a stop after a {phase}:")


@ARM.essential
def a_problem_stops_the_arm(opened: Opened) -> None:
    """A problem that a driver reports ends each motion, and nothing goes on when it has passed or is acknowledged."""
    for harm in opened().harms:
        bench = opened()
        motion = bench.begin()
        bench.harm(harm, 0.5)
        bench.heal()
        words = f"'{harm}' for 0.5 s:"
        bench.finish(motion)
        require(motion.settled, f"{words} the motion does not end")
        bench.rest(words, stays=0.3)
        if motion.state is MotionState.DONE and not bench.problem():
            continue
        told = bench.problem() or motion.problem
        require(bool(told), f"{words} the motion is {motion.state.name}, and nothing is reported")
        if bench.problem():
            with suppress(MotionRefused):
                bench.follow()
                raise Finding(f"{words} it took a motion")
        bench.acknowledge()
        said = bench.problem()
        require(not said, f"{words} acknowledged, it still says '{said}'")
        bench.rest(f"{words} acknowledged,", 0.0, 0.3)
        motion = bench.follow(SHORT)
        bench.finish(motion)
        state = motion.state
        require(state is MotionState.DONE, f"{words} acknowledged, a motion is {state.name}")


@ARM.essential
def the_end_of_a_driver_stops_the_arm(opened: Opened) -> None:
    """Closing a driver ends each motion, and the arm stays on its path."""
    bench = opened()
    bench.begin()
    bench.device.close()
    bench.step = lambda: bench.stand_still(STEP)  # type: ignore[method-assign]
    bench.rest("closed,")


@ARM.essential
def settled_is_measured(opened: Opened) -> None:
    """An arm that is settled rests, and one that rests is settled; a motion that goes on then keeps the limits."""
    for bench, way, words in disturbed(opened, ("pause", "resume", "stop")):
        since = bench.now
        motion = bench.follow()
        bench.serve(0.4)
        if way == "stop":
            bench.device.safe_stop("test")
        else:
            bench.device.pause()
        bench.serve(4.0, bench.device.settled)
        rested = bench.body.q
        words = f"{words} {way}:"
        require(bench.device.settled(), f"{words} at rest it is never settled")
        if way == "resume":
            bench.device.resume()
            bench.finish(motion)
            require(motion.settled, f"{words} gone on, it does not end")
        else:
            bench.serve(0.5)
            moved = bench.went(rested)
            require(moved < 2.0 * STILL, f"{words} settled, a joint moved by {moved:.4f} rad")
        bench.keeps_limits(words, since, brakes=False, step=COARSE)


@ARM.essential
def an_unordered_motion_is_noticed(opened: Opened) -> None:
    """A motion of a resting arm that nobody ordered is reported at once, as what it is."""
    for rate, has_moved in product((math.inf, 1.0, 0.05), (False, True)):
        bench = opened()
        bench.serve(0.3)
        if has_moved:
            bench.finish(bench.follow())
            bench.serve(0.2)
        require(not bench.problem(), f"at rest it says '{bench.problem()}'")
        began = bench.now
        since = math.inf
        while bench.now < began + 1.0 and not bench.problem():
            moved = min(8.0 * STRAYS, rate * max(bench.now - began, STEP))
            bench.body.pushed = moved * np.eye(len(bench.way))[1]
            since = min(since, bench.now) if moved > STRAYS else math.inf
            bench.serve(STEP)
        late = bench.now - since
        words = f"pushed at {rate:g} rad/s: it says '{bench.problem()}' after {late:.3f} s"
        told = "without a command" in bench.problem()
        require(told and late <= NOTICED + STEP, words)


# ------------------------------------------------------------------------------------------------------- other claims


@ARM.claim
def the_limits_hold(opened: Opened) -> None:
    """Motions, pauses, new speeds and stops keep the limits, and a motion that is done is at its end."""
    for wait in (0.0, 0.005, 0.05):
        bench = opened()
        since = bench.now
        motion = bench.begin("pause")
        goal = bench.start - bench.way
        bench.serve(wait)
        bench.device.resume()
        bench.serve(0.1)
        bench.device.go_at(0.4)
        bench.serve(0.3)
        bench.device.go_at(1.0)
        bench.finish(motion)
        words = f"paused for {wait:g} s, slower, quicker:"
        told = f"{words} it is {motion.state.name}, {bench.went(goal):.4f} rad from its end"
        require(motion.state is MotionState.DONE and bench.went(goal) < NEAR, told)
        off = float(np.abs(bench.device.state().q - bench.body.q).max())
        require(off < NEAR, f"it tells joints {off:.4f} rad from where they are")
        bench.begin("stop")
        bench.rest("stopped,")
        bench.keeps_limits(f"{words} stopped:", since)
        require(not bench.problem(), f"{words} it says '{bench.problem()}'")


@ARM.claim
def a_gap_ends_without_a_jump(opened: Opened) -> None:
    """An arm or a wire that was disturbed for a moment speeds up within the limits, if it goes on at all."""
    for harm, lasts in product(opened().harms, (0.1, 0.3)):
        bench = opened()
        motion = bench.begin()
        since = bench.now
        bench.harm(harm, lasts)
        bench.heal()
        bench.finish(motion)
        bench.keeps_limits(f"'{harm}' for {lasts:g} s:", since, brakes=False)


@ARM.claim
def another_time_is_followed(opened: Opened) -> None:
    """With a controller that is slower than this computer, or late to tell, motions keep limits and end as they say."""
    for bench, _, words in disturbed(opened, ("",)):
        since = bench.now
        motion = bench.follow()
        goal = bench.start - bench.way
        bench.finish(motion)
        bench.rest(words)
        bench.keeps_limits(words, since, brakes=False, step=COARSE)
        told = bench.problem() or motion.problem
        there = motion.state is MotionState.DONE and bench.went(goal) < NEAR
        off = f"{words} it is {motion.state.name}, {bench.went(goal):.4f} rad from its end"
        require(there or bool(told), off)


@ARM.claim
def false_joints_move_it_nowhere(opened: Opened) -> None:
    """An arm whose joints report what is not true comes to rest on its path, in each phase of a motion."""
    for phase, lie in product(("pause", "stop"), LIES):
        bench = opened()
        motion = bench.begin(phase)
        since = bench.now
        bench.harm(lie, 0.3)
        if phase == "pause":
            bench.device.resume()
        bench.finish(motion)
        words = f"'{lie}' in a {phase}:"
        require(motion.settled, f"{words} the motion does not end")
        bench.rest(words)
        bench.keeps_limits(words, since, brakes=False)
        told = bench.problem() or motion.problem
        require(bool(told) or phase == "stop", f"{words} nothing is reported")


@ARM.claim
def a_stop_latches(opened: Opened) -> None:
    """After a stop no motion starts or goes on, until it is acknowledged."""
    bench = opened()
    bench.begin("stop")
    bench.device.resume()
    bench.rest("stopped,")
    with suppress(MotionRefused):
        bench.follow()
        raise Finding("it took a motion")
    bench.device.acknowledge()
    bench.rest("acknowledged,", 0.0)
    motion = bench.follow()
    bench.finish(motion)
    require(motion.state is MotionState.DONE, f"a motion after that is {motion.state.name}")


@ARM.claim
def another_program_is_named(opened: Opened) -> None:
    """Another program that gives set-points in a motion is noticed and named."""
    bench = opened()
    if bench.foreign is None:
        return
    bench.begin()
    for _ in range(5):
        bench.foreign()
        bench.serve(0.02)
    bench.serve(2.0 * NOTICED)
    require("another program" in bench.problem(), f"it says '{bench.problem()}'")


@ARM.claim
def a_freed_arm_stays(opened: Opened) -> None:
    """An arm that something holds in a motion stays there when it comes free, without an acknowledgement."""
    bench = opened()
    motion = bench.begin()
    bench.body.is_held = True
    bench.serve(3.0)
    told = bench.problem() or motion.problem
    require(bool(told), "held, it reports nothing")
    rested = bench.body.q
    bench.body.is_held = False
    bench.serve(1.0)
    moved = bench.went(rested)
    require(moved < BESIDE, f"freed, a joint moved by {moved:.3f} rad after '{told}'")


@ARM.claim
def a_clock_may_step(opened: Opened) -> None:
    """A step of this computer's clock moves the arm nowhere but along its motion, within the limits."""
    step_a_clock(opened, both=False)


@ARM.claim
def both_clocks_may_step(opened: Opened) -> None:
    """A step of the clocks of computer and controller moves the arm nowhere but along its motion, within the limits."""
    if opened().step_clocks is not None:
        step_a_clock(opened, both=True)


def step_a_clock(opened: Opened, *, both: bool) -> None:
    """Judge an arm in a step of the clock of this computer, and of the controller's."""
    for phase, seconds in product(("motion", "pause"), (0.5, -0.5, 60.0)):
        bench = opened()
        motion = bench.begin(phase)
        since = bench.now
        clock = time.time
        with mock.patch.object(time, "time", lambda now=clock, by=seconds: now() + by):
            if bench.step_clocks is not None:
                bench.step_clocks(seconds, seconds if both else 0.0)
            bench.serve(0.05)
            bench.device.resume()
            bench.finish(motion)
        words = f"stepped by {seconds:g} s in a {phase}:"
        bench.rest(words)
        bench.keeps_limits(words, since, brakes=False)
        told = bench.problem() or motion.problem
        require(motion.state is MotionState.DONE or bool(told), f"{words} it is not done")


@ARM.claim
def a_process_that_stood_still_starts_nothing(opened: Opened) -> None:
    """While the driver's process stands still the arm comes to rest on its path, and it stays there."""
    for phase, seconds in product(("motion", "pause", "stop"), (0.5, 3.0)):
        bench = opened()
        if not bench.device.outlives:
            return  # its time is the process's
        motion = bench.begin(phase)
        bench.stand_still(seconds)
        rested = bench.body.q
        bench.serve(0.5)
        moved = bench.went(rested)
        words = f"{seconds:g} s in a {phase}:"
        require(moved < STILL, f"{words} then a joint moved by {moved:.3f} rad")
        bench.device.resume()
        bench.finish(motion)
        bench.rest(words)
