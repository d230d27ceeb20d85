"""Base of drivers for parallel grippers: latch, loss, moves, streamed speeds, supervision.

A problem fails the move and stays latched until an operator acknowledges it; nothing resumes by itself. While latched
the fingers may close and hold, but not open. A driver derives from `ParallelGripper` and implements these methods:

    def step(self) -> None:
        answer = self._wire.receive(0.004)
        if answer is not None:
            self._measured(self._clock.now(), answer.width, answer.speed)
        elif ...:                                  # no answer for too long
            self._lose(DeviceLost(self.name, "does not answer"))
        self._supervise()

    def _start_move(self, move: GripperMotion) -> None: ...     # command a width and a speed
    def _start_stream(self, speed: float) -> None: ...          # command a speed

and, as its gripper needs them, `_start_rest`, `_forget`, `_watch`, `_refusal`, `_leave`. `pomona new gripper NAME`
writes such a driver, with an emulated gripper at the other end of its wire.
"""

from __future__ import annotations

import contextlib
import math
import threading
from abc import ABC, abstractmethod

from pomona.drivers.errors import DeviceError, DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.gripper_supervisor import (
    GripperMotion,
    GripperSupervision,
    GripperSupervisor,
    allowed_speed,
    require_move,
)
from pomona.drivers.interfaces import Gripper, GripperLimits, GripperState, MotionState
from pomona.executive.cell.device import Device
from pomona.executive.cell.owner import Owner, Watchdog
from pomona.executive.clock import Clock

ARRIVED, BLOCKED = 1e-3, 0.3
"""Fingers this near to a width have arrived there [m]; at rest off it for this long they are blocked [s]. Fingers begin
to move later than their command, by 0.1 s at most (`GripperSupervision.lag`)."""


class ParallelGripper(Device, ABC):
    """A parallel gripper. One owner serves the wire and the motion; requests are posted to it.

    Attributes:
        limits: of moves and streamed speeds.
    """

    interfaces = (Gripper,)

    def __init__(
        self,
        name: str,
        clock: Clock,
        limits: GripperLimits,
        *,
        acceleration: float,
        watchdog: float,
        supervision: GripperSupervision | None = None,
    ) -> None:
        """
        Args:
            acceleration: with which moves begin and end [m/s²].
            watchdog: a streamed speed that is not renewed within this time becomes zero [s].
        """
        super().__init__(name)
        self.limits = limits
        self._clock, self._watchdog = clock, Watchdog(watchdog)
        self._lock = threading.Lock()  # of latched and problem
        self._owner = Owner(name, self.step, self._failed, clock)
        self._supervisor = GripperSupervisor(limits, acceleration, supervision)
        self._state: GripperState | None = None
        self._lost, self._lost_since_ack = True, False
        self._move: GripperMotion | None = None
        self._asked: GripperMotion | None = None  # the last requested one, before the owner gets it
        self._speed = 0.0  # streamed
        self._aim: float | None = None
        self._off_target_since = math.inf
        self._latched: str | None = None
        self._problem: DeviceError | None = None

    # ----------------------------------------------------------------------------- methods that a driver implements

    @abstractmethod
    def step(self) -> None:
        """Serve the gripper for a few milliseconds; its own thread calls this without end.

        It takes measurements (`_measured`), reports a loss (`_lose`), and ends with `_supervise`.
        """

    @abstractmethod
    def _start_move(self, move: GripperMotion) -> None:
        """Command a move."""

    @abstractmethod
    def _start_stream(self, speed: float) -> None:
        """Command a rate of the opening [m/s], until another command. Called with each renewal, and with 0 at the end.

        A gripper that cannot move at a commanded speed raises DeviceFault in `set_speed` instead.
        """

    def _start_rest(self) -> None:
        """Command the fingers to stand still; fingers that hold something keep holding it."""

    def _forget(self) -> None:
        """The gripper is lost: the last command is no longer known."""

    def _watch(self, state: GripperState) -> None:
        """Look at the present move in each step, and report its end; by default its measured rest ends it."""
        if self._move is not None:
            self._judge_move(state, self._move.width)

    def _refusal(self) -> str:
        """Return why the gripper itself takes no move now, as the rest of a sentence; empty when it does."""
        return ""

    def _leave(self) -> None:
        """Close the wire."""

    # ------------------------------------------------------------------------------- reports of the driver's step

    def connect(self) -> None:
        """Serve the wire until the first state has come; nothing moves.

        Raises DeviceError, OSError: none comes, or it is implausible.
        """
        self._supervisor.rest(self._clock.now())
        while self._state is None and self._problem is None:
            self.step()
        if self._problem is not None:
            raise self._problem

    def start(self) -> None:
        """Serve the gripper in a thread of its own from now on."""
        self._owner.start()

    def _measured(
        self, stamp: float, width: float, speed: float, motor_force: float | None = None
    ) -> None:
        """Take a measurement: its time [s], the opening [m], its rate [m/s], and the motor's force [N], if reported."""
        moving = self._move is not None and not self._move.settled
        state = GripperState(stamp, width, speed, moving, motor_force, aim=self._aim)
        wrong = self._supervisor.look(self._clock.now(), state)
        if wrong:
            self._fail(wrong)
            if not (math.isfinite(width) and math.isfinite(speed)):
                return  # NaN is no state
        self._lost, self._state = False, state
        if self._move is not None:
            self._move.measured = width

    def _supervise(self) -> None:
        """Compare measured with commanded motion, end a stream that was not renewed, and watch the move."""
        now = self._clock.now()
        move = self._move
        if self._lost:
            if move is not None and now > self._supervisor.rest_by:
                move.settled = True
            return
        state = self.state()
        wrong = self._supervisor.look(now, state)
        if wrong:
            self._fail(wrong)
        self._end_stale_stream(now)
        self._watch(state)
        if move is not None and move.ended and not self._lost and self._rests():
            move.settled = True

    def _end_stale_stream(self, now: float) -> None:
        if self._watchdog.has_expired(now) and self._speed:
            self._set_stream(0.0)

    def _judge_move(
        self,
        state: GripperState,
        set_point: float,
        arrived: float = ARRIVED,
        blocked: float = BLOCKED,
    ) -> None:
        """End the running move by its measured rest: done at its width, blocked elsewhere.

        Args:
            set_point: width that the gripper aims at now [m]; the move's own where it got that at once.
            arrived: fingers this near to a width have arrived there [m].
            blocked: fingers that rest for this long off their set-point are blocked [s].
        """
        move = self._move
        if move is None or move.state is not MotionState.RUNNING:
            return
        rests = self._supervisor.at_rest
        if rests and set_point == move.width and abs(state.width - move.width) < arrived:
            self._end_move(MotionState.DONE)
        elif not rests or abs(set_point - state.width) < arrived:
            self._off_target_since = math.inf
        else:
            self._off_target_since = min(self._off_target_since, state.stamp)
            if state.stamp - self._off_target_since > blocked:
                self._end_move(
                    MotionState.FAILED, f"the fingers are blocked at {1e3 * state.width:.1f} mm"
                )

    def _end_move(self, state: MotionState, problem: str = "") -> None:
        """Report the end of the present move, and let the fingers rest."""
        if self._move is not None:
            self._move.end(state, problem)
        self._rest()

    def _fail(self, words: str) -> None:
        """The gripper misbehaves: its move has failed, and it is stopped."""
        self._blame(DeviceFault(self.name, words))
        self._end_move(MotionState.FAILED, f"{self.name}: {words}")

    def _lose(self, error: DeviceError) -> None:
        """The gripper is lost until a new state comes."""
        if not self._lost or self._problem is None:
            self._blame(error)
            with contextlib.suppress(OSError, DeviceError):  # the wire itself may be lost
                self._end_move(MotionState.FAILED, f"the gripper was lost: {error.message}")
        self._lost = self._lost_since_ack = True
        self._forget()

    def _failed(self, error: BaseException) -> None:
        """Handle an error of the wire, or a defect of the driver itself."""
        if isinstance(error, DeviceError):
            self._lose(error)
            return
        lost: DeviceError = DeviceFault(self.name, f"the driver failed: {error!r}")
        if isinstance(error, OSError):
            lost = DeviceLost(self.name, f"the wire failed: {error}")
        lost.__cause__ = error
        self._lose(lost)

    def _blame(self, problem: DeviceError) -> None:
        """Latch a problem until it is acknowledged; the first one is kept."""
        with self._lock:
            if self._problem is None:
                self._problem = problem

    def _rests(self) -> bool:
        """Return True if the fingers were measured at rest, or follow the streamed speed."""
        return self._supervisor.follows if self._speed else self._supervisor.at_rest

    # ------------------------------------------------------------------------------------ the owner's side of requests

    def _new_move(self, width: float, speed: float) -> GripperMotion:
        return GripperMotion(
            width, speed, self.state().width, lambda move: self._owner.post(lambda: self._stop(move))
        )  # fmt: skip

    def _begin(self, move: GripperMotion) -> None:
        """Start a move, unless a stop or a loss came first."""
        refusal = self._unready()
        if refusal:
            move.end(MotionState.FAILED, f"{self.name}: {refusal}")
            move.settled = move is not self._move or move.settled
            return
        if self._move is not None and self._move is not move:
            self._move.end(MotionState.STOPPED)
            self._move.settled = True
        self._move, self._aim, self._speed = move, move.width, 0.0
        self._off_target_since = math.inf
        self._supervisor.move(self._clock.now(), self.state().width, move.width, move.speed)
        self._start_move(move)

    def _stop(self, move: GripperMotion) -> None:
        if not move.ended:
            move.end(MotionState.STOPPED)
            if move is self._move:
                self._rest()

    def _rest(self) -> None:
        self._speed = 0.0
        if not self._lost:  # else the last end of the last command stays known
            self._supervisor.rest(self._clock.now())
        self._start_rest()

    def _take_speed(self, speed: float) -> None:
        """While latched the fingers may close and hold but not open."""
        if self._lost or self._lost_since_ack:
            return
        if self._move is not None and not self._move.ended:
            self._stop(self._move)
        self._aim = None
        self._watchdog.renew(self._clock.now())
        self._set_stream(allowed_speed(speed, self.limits, self._latched is not None))

    def _set_stream(self, speed: float) -> None:
        if speed or self._speed:
            self._supervisor.stream(self._clock.now(), speed, self._watchdog.limit)
        self._speed = speed
        self._start_stream(speed)

    def _unready(self) -> str:
        """Return why no move may be started now; empty when it may."""
        if self._latched is not None:
            return f"latched in the safe state ({self._latched})"
        if self._lost or self._lost_since_ack or self._problem is not None:
            return f"not ready: {self._why_lost() if self._lost_since_ack else self._words()}"
        return self._refusal()

    def _why_lost(self) -> str:
        known = "was lost; acknowledge the loss before it moves: " if self._lost_since_ack else ""
        return known + self._words()

    def _words(self) -> str:
        return self._problem.message if self._problem is not None else "no state has come"

    # --------------------------------------------------------------------------------------------- the interface

    def state(self) -> GripperState:
        """See the Protocol. Raises DeviceLost: there is no fresh state."""
        if self._lost or self._state is None:
            raise DeviceLost(self.name, self._words())
        return self._state

    def move(self, width: float, speed: float) -> GripperMotion:
        limits, refusal = self.limits, self._unready()
        if refusal:
            raise MotionRefused(self.name, refusal)
        require_move(self.name, limits, width, speed)
        width = min(max(width, limits.width_min), limits.width_max)
        move = self._asked = self._new_move(width, min(speed, limits.speed_max))
        self._owner.post(lambda: self._begin(move))
        return move

    def set_speed(self, speed: float) -> None:
        """See the Protocol; while latched the fingers may close and hold but not open.

        Raises DeviceLost: the gripper is lost, or was lost and that is not acknowledged yet.
        """
        if self._lost or self._lost_since_ack:
            raise DeviceLost(self.name, self._why_lost())
        self._owner.post(lambda: self._take_speed(speed))

    # ------------------------------------------------------------------------------------------------ the device

    def link(self) -> str:
        return "ok" if self._problem is None else self._problem.message

    def last_seen(self) -> float | None:
        return None if self._state is None else self._state.stamp

    def check(self) -> None:
        problem = self._problem
        if problem is not None:
            raise problem
        self._owner.check()

    def safe_stop(self, reason: str) -> None:
        with self._lock:
            if self._latched is None:
                self._latched = reason
        self._owner.post(lambda: self._end_move(MotionState.STOPPED))

    def acknowledge(self) -> None:
        """Release the latch; the fingers stay where they are. Raises DeviceLost: no states come."""
        if self._lost:
            raise DeviceLost(self.name, f"is still lost: {self._words()}")
        self._owner.ask(self._release)

    def _release(self) -> None:
        if self._lost:
            raise DeviceLost(self.name, f"is still lost: {self._words()}")
        self._supervisor.rest(self._clock.now())
        with self._lock:
            self._latched = self._problem = None
        self._lost_since_ack = False

    def pause(self) -> None:
        self._owner.post(self._pause)

    def _pause(self) -> None:
        if self._move is not None and self._move.state is MotionState.RUNNING:
            self._move.state = MotionState.PAUSED
            self._rest()

    def resume(self) -> None:
        move, refusal = self._asked, self._unready()
        if move is not None and move.state is MotionState.PAUSED and refusal:
            raise MotionRefused(self.name, refusal)
        self._owner.post(self._resume)

    def _resume(self) -> None:
        if self._move is not None and self._move.state is MotionState.PAUSED:
            self._move.state = MotionState.RUNNING
            self._begin(self._move)

    def settled(self) -> bool:
        """Return True if the fingers were measured at rest. Streamed speeds do not count as motion: force control may
        go on for hours. For a lost gripper only the latest end of its last command is known.
        """
        if self._lost:
            return self._clock.now() > self._supervisor.rest_by
        move = self._asked
        return (move is None or move.settled or move.state is MotionState.PAUSED) and self._rests()

    def close(self) -> None:
        """Disconnect; the fingers stay where they are."""
        self.safe_stop("closed")
        self._owner.close()
        self._problem, self._lost = DeviceLost(self.name, "is closed"), True
        self._leave()
