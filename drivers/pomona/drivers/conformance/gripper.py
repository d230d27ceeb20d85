"""Claims of parallel grippers, judged by the true opening and the true force of the fingers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import product
from typing import Protocol

from pomona.drivers.conformance.bench import STEP, Bench
from pomona.drivers.conformance.claims import Claims, Finding
from pomona.drivers.errors import DeviceError, MotionRefused
from pomona.drivers.gripper_supervisor import GripperMotion
from pomona.drivers.interfaces import GripperLimits, MotionState
from pomona.executive.cell.device import FaultSwitch
from pomona.executive.clock import Clock

WAYS = ("close", "open", "stream")
SPEED = 0.025
STREAM = 0.02  # of the moves and of the streamed speeds of these claims [m/s]
STANDS = 0.1  # fingers that stay for this long have come to rest [s]
STILL = 1e-3  # fingers at rest stay within this [m]
NEAR = 1.5e-3  # a width is right within this [m]
REST = 0.35  # fingers rest within this time after a stop that was delivered [s]
NOTICED = 0.3  # a motion that nobody ordered is noticed within this time [s]
TIGHT = 1.1  # share of a bound of the force that may be pressed with


class Hand(Protocol):
    """The fingers as they truly are: of an emulated gripper, of a simulation, or of a gauge between real ones."""

    width: float
    """Opening [m]; what is written pushes the fingers there, without any command."""
    obstacle: float
    """Width of an elastic object between them [m]; 0: none. What is written puts it there."""

    @property
    def force(self) -> float:
        """Force of one finger on the object [N]."""


class GripperBench(Bench):
    """A gripper's driver and its fingers."""

    def __init__(
        self,
        device: object,
        clock: Clock,
        hand: Hand,
        *switches: FaultSwitch,
        offset: float = 0.0,
        foreign: Callable[[], None] | None = None,
        without: tuple[str, ...] = (),
    ) -> None:
        """
        Args:
            hand: its opening is that of the jaws; with `offset` [m] it is that between the pads.
            foreign: another client of the device opens the fingers by some millimetres.
            switches, without: see the base.
        """
        super().__init__(device, clock, *switches, without=without)
        self.hand = hand
        self.offset = offset
        self.foreign = foreign
        self.renew: float | None = None  # a skill streams this speed [m/s]
        self.move: GripperMotion | None = None  # that `begin` has begun
        self.each_step.append(self._renew)

    @property
    def limits(self) -> GripperLimits:
        """Limits that the driver tells."""
        limits: GripperLimits = self.device.limits
        return limits

    @property
    def width(self) -> float:
        """True opening between the pads [m]."""
        return self.hand.width + self.offset

    @property
    def middle(self) -> float:
        """Opening in the middle of the stroke [m]."""
        return 0.5 * (self.limits.width_min + self.limits.width_max)

    def put(self, width: float) -> None:
        """Put an object between the pads [m]; 0 takes it away."""
        self.hand.obstacle = width - self.offset if width else 0.0

    def push(self, way: float) -> None:
        """Push the fingers by a way of the opening [m]."""
        self.hand.width += way

    def to(self, width: float, speed: float = 0.1, force: float | None = None) -> GripperMotion:
        """Move, and wait for the end."""
        move: GripperMotion = self.device.move(width, speed, force)
        self.serve(6.0, lambda: move.settled)
        return move

    def begin(self, way: str) -> None:
        """Let the fingers be on their way from the middle of the stroke."""
        require(self.to(self.middle).state is MotionState.DONE, "a move to the middle is not done")
        if way == "stream":
            self.renew = -STREAM
        else:
            limits = self.limits
            end = limits.width_min + 2e-3 if way == "close" else limits.width_max - 2e-3
            self.move = self.device.move(end, SPEED)
        self.serve(0.2)
        require(abs(self.width - self.middle) > STILL, f"fingers told to {way} do not move")

    def has_told(self) -> bool:
        """Return whether it reports a problem, or the move that has begun has failed."""
        failed = self.move is not None and self.move.state is MotionState.FAILED
        return failed or bool(self.problem())

    def grip(self, force: float | None = None, press: float = 4e-3) -> GripperMotion:
        """Close on an object; return the move that it has blocked."""
        require(self.to(self.middle).state is MotionState.DONE, "a move to the middle is not done")
        self.put(self.middle - press)
        move = self.to(self.limits.width_min + STILL, force=force)
        said = f"a move that an object blocks is {move.state.name}"
        require(move.state is MotionState.FAILED, said)
        self.serve(0.3)
        return move

    def rest(self, words: str, within: float = REST) -> None:
        """Raise Finding: the fingers do not rest within a time [s], or move again in the second after it."""
        rested = self.width
        since = self.now
        end = since + within
        while self.now < since + STANDS:
            self.serve(STEP)
            if abs(self.width - rested) > 0.2 * STILL:
                require(self.now < end + STANDS, f"{words} {went(rested, self.width)}")
                rested = self.width
                since = self.now
        end = self.now + 1.0
        while self.now < end:
            self.serve(STEP)
            moved = abs(self.width - rested)
            require(moved < STILL, f"{words} at rest, {went(rested, self.width)}")

    def _renew(self) -> None:
        if self.renew is not None:
            with suppress(DeviceError):
                self.device.set_speed(self.renew)


Opened = Callable[[], GripperBench]
GRIPPER: Claims[GripperBench] = Claims("gripper")


def gripper_claims(**benches: Opened) -> Callable[..., None]:
    """Return a test for pytest of every claim, for each bench by its name."""
    return GRIPPER.tests(**benches)


def require(kept: bool, words: str) -> None:
    """Raise Finding with these words, unless something is kept."""
    if not kept:
        raise Finding(words)


def went(before: float, after: float) -> str:
    """Describe a motion of the opening."""
    how = "opened" if after > before else "closed"
    return f"the fingers {how} from {1e3 * before:.1f} to {1e3 * after:.1f} mm"


def harmed(
    opened: Opened, ways: tuple[str, ...] = WAYS, lasts: tuple[float, ...] = (0.15,)
) -> Iterator[tuple[GripperBench, str, str, float]]:
    """Yield new benches whose fingers move, with each way, each harm, and how long it lasts [s].

    Of two lengths a stream takes both. A move is the same command either way, so that each way takes one, in turn.
    """
    for i, harm in enumerate(("", *opened().harms)):
        turns = [(way, lasts[(i + k) % len(lasts)]) for k, way in enumerate(("close", "open"))]
        for way, seconds in (*turns, *product(("stream",), lasts)):
            if way in ways:
                bench = opened()
                bench.begin(way)
                yield bench, way, harm, seconds


def words_of(way: str, harm: str) -> str:
    """Describe how fingers moved, and what happened to them."""
    return f"told to {way}, then '{harm}':" if harm else f"told to {way}:"


# ------------------------------------------------------------------------------- claims that no driver can declare away


@GRIPPER.essential
def a_stop_is_delivered(opened: Opened) -> None:
    """A stop ends each motion, also one that comes while the device does not answer."""
    for bench, way, harm, late in harmed(opened, lasts=(0.05, 0.6)):
        bench.harm(harm, late)
        bench.device.safe_stop("test")
        bench.renew = None
        bench.serve(0.1)
        bench.heal()
        bench.rest(f"{words_of(way, harm)} after a stop", 0.1 + REST)


@GRIPPER.essential
def a_problem_stops_the_fingers(opened: Opened) -> None:
    """A problem that a driver reports ends each motion, and nothing goes on when the problem has passed."""
    for bench, way, harm, seconds in harmed(opened, lasts=(0.15, 0.4)):
        bench.harm(harm, seconds)
        bench.heal()
        bench.serve(0.02)
        if not bench.problem():
            continue
        bench.renew = None
        bench.rest(f"{words_of(way, harm)} after '{bench.problem()}'", 0.75)
        require(bool(bench.problem()), f"{words_of(way, harm)} the problem went by itself")


@GRIPPER.essential
def the_end_of_a_driver_stops_the_fingers(opened: Opened) -> None:
    """Closing a driver ends each motion."""
    for way in WAYS:
        bench = opened()
        bench.begin(way)
        bench.renew = None
        before = bench.width
        bench.device.close()
        bench.stand_still(1.0)
        way_on = abs(bench.width - before)
        require(way_on < SPEED * 0.2 + STILL, f"told to {way}: {went(before, bench.width)}")


@GRIPPER.essential
def settled_is_measured(opened: Opened) -> None:
    """Fingers that are settled rest, and those that rest are settled."""
    for bench, way, harm, seconds in harmed(opened, ("close", "open")):
        widths: list[float] = []

        def note(bench: GripperBench = bench, widths: list[float] = widths) -> None:
            if bench.device.settled():
                widths.append(bench.width)

        bench.each_step.append(note)
        bench.harm(harm, seconds)
        bench.device.safe_stop("test")
        bench.serve(0.15)
        bench.heal()
        bench.serve(1.5)
        require(bool(widths), f"{words_of(way, harm)} at rest it is never settled")
        span = max(widths) - min(widths)
        moved = f"while it said that it was settled, {went(widths[0], widths[-1])}"
        require(span < 2.0 * STILL, f"{words_of(way, harm)} {moved}")


@GRIPPER.essential
def an_unordered_motion_is_noticed(opened: Opened) -> None:
    """A motion of resting fingers that nobody ordered is reported."""
    for way, moves in product((-6e-3, 6e-3), (False, True)):
        bench = opened()
        bench.serve(0.5)
        if moves:
            bench.to(bench.middle)
            bench.serve(0.5)
        else:
            bench.push(bench.middle - bench.width)
            bench.serve(0.5)
            require(bool(bench.problem()), "pushed to the middle of their stroke")
            bench.device.acknowledge()
        require(not bench.problem(), "acknowledged, it still has a problem")
        bench.push(way)
        bench.serve(NOTICED)
        require(bool(bench.problem()), f"the fingers were pushed by {1e3 * way:+.0f} mm")


@GRIPPER.essential
def the_force_is_bounded(opened: Opened) -> None:
    """What fingers meet, they press with the largest force of their limits at most."""
    for streams in (False, True):
        bench = opened()
        most = 0.0
        bound = bench.limits.force_max

        def feel(bench: GripperBench = bench) -> None:
            nonlocal most
            most = max(most, bench.hand.force)

        bench.each_step.append(feel)
        if streams:
            bench.to(bench.middle)
            bench.put(bench.middle - 4e-3)
            bench.renew = -STREAM
            bench.serve(2.0)
        else:
            bench.grip()
        how = "a streamed speed" if streams else "a move"
        require(most <= TIGHT * bound, f"{how} pressed with {most:.1f} N of at most {bound:.1f} N")


# ------------------------------------------------------------------------------------------------------- other claims


@GRIPPER.claim
def a_force_is_obeyed(opened: Opened) -> None:
    """The force of a move bounds that of each finger."""
    limits = opened().limits
    least = max(limits.force_min, 0.2 * limits.force_max)
    for force in {least, 0.5 * (least + limits.force_max), limits.force_max}:
        bench = opened()
        bench.grip(force)
        pressed = bench.hand.force
        right = limits.force_min * 0.95 <= pressed <= TIGHT * force and pressed > 0.5 * force
        require(right, f"told {force:.1f} N, a finger pressed with {pressed:.1f} N")


@GRIPPER.claim
def a_smaller_force_is_refused(opened: Opened) -> None:
    """A force below the least one is refused, and nothing moves."""
    bench = opened()
    before = bench.width
    for force in (0.5 * bench.limits.force_min, 0.0, -1.0, math.nan):
        try:
            bench.device.move(bench.middle, SPEED, force)
        except MotionRefused:
            continue
        raise Finding(f"a move with {force:g} N was taken")
    bench.serve(0.3)
    require(abs(bench.width - before) < STILL, went(before, bench.width))


@GRIPPER.claim
def a_stop_keeps_the_grip(opened: Opened) -> None:
    """A stop keeps a held object held, also one after the device did not answer."""
    for harm in ("", *opened().harms):
        bench = opened()
        bench.grip()
        bench.harm(harm, 0.1 if harm else 0.0)
        bench.heal()
        held = bench.hand.force
        before = bench.width
        bench.device.safe_stop("test")
        bench.serve(1.0)
        require(bench.width < before + STILL, f"'{harm}': {went(before, bench.width)}")
        kept = f"'{harm}': of {held:.1f} N there are {bench.hand.force:.1f} N"
        require(bench.hand.force > 0.85 * held, kept)


@GRIPPER.claim
def a_lost_object_is_told(opened: Opened) -> None:
    """An object that is no longer between fingers that held it is said to be gone."""
    bench = opened()
    bench.grip()
    before = bench.width
    bench.put(0.0)
    bench.serve(1.0)
    if abs(bench.width - before) >= 4.0 * STILL:
        require("gone" in bench.problem(), f"it says '{bench.problem()}'")


@GRIPPER.claim
def a_stop_latches(opened: Opened) -> None:
    """After a stop no move starts and nothing opens, until it is acknowledged."""
    bench = opened()
    bench.begin("close")
    bench.device.safe_stop("test")
    bench.serve(REST)
    before = bench.width
    bench.renew = 0.05
    bench.serve(0.5)
    require(bench.width < before + STILL, went(before, bench.width))
    bench.renew = None
    bench.serve(0.3)
    with suppress(MotionRefused):
        bench.device.move(bench.middle, SPEED)
        raise Finding("it took a move")
    bench.device.acknowledge()
    bench.rest("acknowledged,", 0.0)
    require(bench.to(bench.middle).state is MotionState.DONE, "a move after that is not done")


@GRIPPER.claim
def nothing_resumes(opened: Opened) -> None:
    """After a problem nothing moves until it is acknowledged, and then everything does."""
    for bench, way, harm, seconds in harmed(opened, ("close",), (0.6,)):
        bench.harm(harm, seconds)
        bench.heal()
        bench.serve(1.5)
        if bench.problem():
            with suppress(MotionRefused):
                bench.device.move(bench.middle, SPEED)
                raise Finding(f"{words_of(way, harm)} it took a move")
            with suppress(DeviceError):
                bench.device.acknowledge()
            bench.serve(0.5)
            bench.rest(f"{words_of(way, harm)} acknowledged,", 0.0)
        said = bench.problem()
        require(not said, f"{words_of(way, harm)} acknowledged, it still says '{said}'")
        state = bench.to(bench.middle).state
        require(state is MotionState.DONE, f"{words_of(way, harm)} a move is {state.name}")


@GRIPPER.claim
def a_lasting_harm_is_noticed(opened: Opened) -> None:
    """A device that does not do or tell what it should is noticed, and a state is never nonsense."""
    for bench, way, harm, _ in harmed(opened):
        if not harm or harm == "half":
            continue
        bench.harm(harm, 0.1)
        bench.serve(2.9 if bench.move else 0.9, bench.has_told)
        with suppress(DeviceError):
            require(math.isfinite(bench.device.state().width), f"'{harm}': its width is no number")
        if bench.has_told():
            continue
        bench.renew = None
        state = bench.to(bench.middle).state
        there = abs(bench.width - bench.middle) < NEAR
        told = there if state is MotionState.DONE else True
        require(told, f"{words_of(way, harm)} nothing is reported")


@GRIPPER.claim
def a_width_is_true(opened: Opened) -> None:
    """A move that is done has the fingers at its width, and the driver tells their true width."""
    for share in (0.1, 0.5, 0.9):
        bench = opened()
        limits = bench.limits
        width = limits.width_min + share * (limits.width_max - limits.width_min)
        state = bench.to(width).state
        there = f"told {1e3 * width:.1f} mm, it is {state.name} at {1e3 * bench.width:.1f} mm"
        require(state is MotionState.DONE and abs(bench.width - width) < NEAR, there)
        told = bench.device.state().width
        words = f"it tells {1e3 * told:.1f} mm, and they are open by {1e3 * bench.width:.1f} mm"
        require(abs(told - bench.width) < NEAR, words)
        require(not bench.problem(), f"it says '{bench.problem()}'")


@GRIPPER.claim
def a_speed_is_true(opened: Opened) -> None:
    """Moves and streams have their speed, and a stream ends when it is not renewed."""
    bench = opened()
    bench.begin("close")
    before = bench.width
    bench.serve(0.3)
    moved = before - bench.width
    require(abs(moved - SPEED * 0.3) < NEAR, f"a move went {1e3 * moved:.1f} mm in 0.3 s")
    bench.device.safe_stop("test")
    bench.serve(REST)
    bench.device.acknowledge()
    bench.begin("stream")
    before = bench.width
    bench.serve(0.3)
    moved = before - bench.width
    require(abs(moved - STREAM * 0.3) < NEAR, f"a stream went {1e3 * moved:.1f} mm in 0.3 s")
    bench.renew = None
    before = bench.width
    bench.serve(0.5)
    require(before - bench.width < STREAM * 0.2 + STILL, went(before, bench.width))
    bench.rest("not renewed,", 0.0)
    require(not bench.problem(), f"it says '{bench.problem()}'")


@GRIPPER.claim
def a_stream_ends_with_its_process(opened: Opened) -> None:
    """A stream ends while the driver's process stands still."""
    bench = opened()
    bench.begin("stream")
    bench.renew = None
    before = bench.width
    bench.stand_still(1.0)
    bench.serve(0.5)
    require(before - bench.width < STREAM * 0.2 + STILL, went(before, bench.width))


@GRIPPER.claim
def a_move_ends_with_its_wire(opened: Opened) -> None:
    """A move ends when no byte passes any more, although its end is far."""
    bench = opened()
    harm = next((kind for kind in ("dead", "lost") if kind in bench.harms), None)
    if harm is None:
        return  # it has no wire
    bench.begin("close")
    before = bench.width
    bench.harm(harm, 2.0)
    way = before - bench.width
    require(way < SPEED * 0.35 + STILL, f"without a byte {went(before, bench.width)}")


@GRIPPER.claim
def a_pause_suspends(opened: Opened) -> None:
    """A paused move rests, and goes on to its width."""
    bench = opened()
    bench.begin("close")
    move = bench.move
    assert move is not None
    bench.device.pause()
    bench.rest("paused,")
    bench.device.resume()
    bench.serve(5.0, lambda: move.settled)
    there = f"resumed, the move is {move.state.name} at {1e3 * bench.width:.1f} mm"
    require(move.state is MotionState.DONE and abs(bench.width - move.width) < NEAR, there)


@GRIPPER.claim
def another_client_is_noticed(opened: Opened) -> None:
    """Another client that moves the fingers is noticed or overruled."""
    for way in ("rest", "close", "open"):
        bench = opened()
        if bench.foreign is None:
            return
        if way == "rest":
            bench.move = bench.to(bench.middle)
        else:
            bench.begin(way)
        move = bench.move
        assert move is not None
        bench.foreign()
        bench.serve(3.0)
        told = bench.problem() or move.state is MotionState.FAILED
        off = f"told {1e3 * move.width:.1f} mm, they are at {1e3 * bench.width:.1f} mm"
        require(bool(told) or abs(bench.width - move.width) < 2.0 * STILL, off)
