"""Base of drivers for parallel grippers: latch, loss, moves, streamed speeds, supervision.

The base keeps what is wanted of the fingers, and asks the driver for the next command until the gripper's own status
shows it. A loss, a fault, a stop and the end of the driver replace it by a stop, and only a stop survives a
reconnection: nothing resumes by itself. A problem fails the move and stays latched until an operator acknowledges it.
While latched the fingers may close and hold, but not open. A driver derives from `ParallelGripper` and implements:

    def _serve(self) -> None:
        answer = self._wire.receive(0.004)
        if answer is not None:
            self._status = answer
            self._measured(self._clock.now(), answer.width, answer.speed)
        elif ...:                                  # no answer for too long
            self._lose(DeviceLost(self.name, "does not answer"))

    def next_command(self, wanted: Wanted, status: Answer) -> bytes | None: ...
    def _send(self, command: bytes) -> None: ...

and, as its gripper needs them, `_open`, `_leave`, `shows`, `_watch`, `_refusal`. `pomona new gripper NAME` writes such a
driver, with an emulated gripper at the other end of its wire.
"""

from __future__ import annotations

import contextlib
import math
import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

from pomona.drivers.errors import DeviceError, DeviceFault, DeviceLost, MotionRefused, StopFailed
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

ARRIVED = 1e-3
BLOCKED = 0.3
"""Fingers this near to a width have arrived there [m]; at rest off it for this long they are blocked [s]. Fingers begin
to move later than their command, by 0.1 s at most (`GripperSupervision.lag`)."""
RECONNECT = 0.5  # between tries to open a wire that failed [s]
LEAVING = 0.3  # time for the last stop before a driver closes its wire [s]


@dataclass(frozen=True, slots=True)
class Stop:
    """The fingers rest; what they hold they go on holding."""


@dataclass(frozen=True, slots=True)
class WidthOrder:
    """The fingers go to a width [m] at a speed [m/s], and press with a force of one finger at most [N]."""

    width: float
    speed: float
    force: float


@dataclass(frozen=True, slots=True)
class SpeedOrder:
    """The opening changes at a speed [m/s]; 0: the fingers stand."""

    speed: float


Wanted = Stop | WidthOrder | SpeedOrder
S = TypeVar("S")
C = TypeVar("C")


class ParallelGripper(Device, ABC, Generic[S, C]):
    """A parallel gripper with the status `S` and commands `C`. One owner serves the wire; requests are posted to it.

    Attributes:
        limits: of moves and streamed speeds.
        stopping: time within which the fingers rest after a stop [s].
        repeat: time after which a command that is not shown is given again [s].
    """

    interfaces = (Gripper,)
    stopping: ClassVar[float] = 0.5
    repeat: ClassVar[float] = 0.02

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
        self._clock = clock
        self._watchdog = Watchdog(watchdog)
        self._lock = threading.Lock()  # of latched and problem
        self._owner = Owner(name, self.step, self._failed, clock)
        self._supervisor = GripperSupervisor(limits, acceleration, supervision)
        self._wanted: Wanted | None = None  # None: nothing, or a stop that was shown
        self._sent: Wanted | None = None  # the newest command was for this
        self._sent_at = -math.inf
        self._stop_by = math.inf  # the fingers must rest by then
        self._status: S | None = None  # None: nothing is known
        self._is_open = False
        self._retry_at = -math.inf
        self._state: GripperState | None = None
        self._lost = True
        self._unacknowledged = False
        self._move: GripperMotion | None = None
        self._asked: GripperMotion | None = None  # the last requested one, before the owner gets it
        self._aim: float | None = None
        self._off_target_since = math.inf
        self._latched: str | None = None

    # ----------------------------------------------------------------------------- methods that a driver implements

    @abstractmethod
    def _serve(self) -> None:
        """Serve the wire for a few milliseconds; the gripper's thread calls this without end.

        It takes the status and measurements (`_measured`), and reports a loss (`_lose`) and faults (`_give_up`).
        """

    @abstractmethod
    def next_command(self, wanted: Wanted, status: S) -> C | None:
        """Return the command that brings the fingers from this status to what is wanted; None to wait.

        A gripper that cannot move at a commanded speed raises DeviceFault in `set_speed`.
        """

    @abstractmethod
    def _send(self, command: C) -> None:
        """Send a command."""

    def shows(self, wanted: Wanted, status: S) -> bool:
        """Return True if the status itself shows what is wanted, so that nothing is commanded any more.

        By default fingers at rest show a stop, and a motion is commanded once: its supervision finds one that is lost.
        """
        return self._supervisor.at_rest if isinstance(wanted, Stop) else wanted is self._sent

    def _watch(self, state: GripperState) -> None:
        """Look at the present move in each step, and report its end; by default its measured rest ends it."""
        if self._move is not None:
            self._judge_move(state, self._move.width)

    def _refusal(self) -> str:
        """Return why the gripper itself takes no move now, as the rest of a sentence; empty when it does."""
        return ""

    def _open(self) -> None:
        """Open the wire: before the first step, and again after it has failed. Raises OSError, DeviceError."""

    def _leave(self) -> None:
        """Close the wire."""

    # ------------------------------------------------------------------------------------------ the owner's thread

    def step(self) -> None:
        """Command what is wanted, serve the wire, and compare measured with commanded motion.

        What goes wrong is latched: an error of the wire, and a defect of the driver.
        """
        try:
            if self._is_open or self._reopen():
                self._command()
                self._serve()
            self._supervise()
        except Exception as error:
            self._failed(error)

    def _reopen(self) -> bool:
        """Open the wire, some time after the last try; return True if it is open."""
        left = self._retry_at - self._clock.now()
        if left > 0.0:
            self._clock.advance(min(left, 0.02))
            return False
        self._retry_at = self._clock.now() + RECONNECT
        self._open()
        self._is_open = True
        return True

    def _drop(self) -> None:
        """Close the wire, to open it again: nothing is known of the gripper, and it may have been switched off."""
        if self._is_open:
            self._leave()
        self._status = None
        self._is_open = False

    def _command(self) -> None:
        """Ask for the next command, until the status shows what is wanted."""
        wanted = self._wanted
        status = self._status
        if wanted is None or status is None:
            return
        stops = isinstance(wanted, Stop)
        # Fingers begin to move later than their command: those that still rest do not show a stop that was not sent.
        shown = self.shows(wanted, status)
        unsent = stops and isinstance(self._sent, WidthOrder | SpeedOrder)
        waits = wanted is self._sent and self._clock.now() - self._sent_at < self.repeat
        command = self.next_command(wanted, status) if (unsent or not shown) and not waits else None
        if command is not None:
            self._send(command)
            self._sent = wanted
            self._sent_at = self._clock.now()
        elif shown and stops and not unsent:
            self._wanted = None

    def connect(self) -> None:
        """Serve the wire until the first state has come; nothing moves.

        Raises DeviceError, OSError: none comes, or it is implausible.
        """
        self._supervisor.rest(self._clock.now())
        while self._state is None and self._problem is None:
            self.step()
        super().check()

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
        if self._lost:
            self._stop_by = self._clock.now() + self.stopping
        self._lost = False
        self._state = state
        if self._move is not None:
            self._move.measured = width

    def _supervise(self) -> None:
        """Compare measured with commanded motion, end a stream that was not renewed, and watch move and stop."""
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
        self._watch_stop(state)
        if move is not None and move.ended and not self._lost and self._rests():
            move.settled = True

    def _end_stale_stream(self, now: float) -> None:
        if self._watchdog.has_expired(now) and self._speed:
            self._set_stream(0.0)

    def _watch_stop(self, state: GripperState) -> None:
        if self._still() or not isinstance(self._wanted, Stop):
            self._stop_by = math.inf
        elif state.stamp > self._stop_by:  # not the clock: this thread may have stalled
            self._disobeyed(
                f"was not measured at rest {1e3 * self.stopping:.0f} ms after a stop, at {1e3 * state.width:.1f} mm"
            )

    def _disobeyed(self, words: str) -> None:
        """Report a failed stop before any other problem."""
        self._stop_by = self._clock.now() + self.stopping
        with self._lock:
            self._problem = StopFailed(self.name, words, self._problem)

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

    # ------------------------------------------------------------------------------------------------- problems

    def _end_move(self, state: MotionState, problem: str = "") -> None:
        """Report the end of the present move, and let the fingers rest."""
        if self._move is not None:
            self._move.end(state, problem)
        self._rest()

    def _fail(self, words: str) -> None:
        """The gripper misbehaves: its move has failed, and it is stopped, once."""
        if self._problem is not None and isinstance(self._wanted, Stop):
            return
        self._blame(DeviceFault(self.name, words))
        self._end_move(MotionState.FAILED, f"{self.name}: {words}")

    def _give_up(self, error: DeviceError) -> None:
        """The gripper is lost, or reports a fault: it is stopped, and takes no order before an acknowledgement."""
        self._blame(error)
        if not self._unacknowledged:
            self._unacknowledged = True
            if self._move is not None:
                self._move.end(MotionState.FAILED, f"{self.name}: {error.message}")
            if self._wanted is not None:
                self._rest()

    def _lose(self, error: DeviceError) -> None:
        """Nothing is known of the gripper until a new state comes."""
        self._give_up(error)
        self._lost = True

    def _failed(self, error: BaseException) -> None:
        """Handle an error of the wire, or a defect of the driver itself: the wire is opened again."""
        if isinstance(error, OSError):
            error = DeviceLost(self.name, f"the wire failed: {error}")
        elif not isinstance(error, DeviceError):
            error = DeviceFault(self.name, f"the driver failed: {error!r}")
        self._lose(error)
        self._drop()

    def _blame(self, problem: DeviceError) -> None:
        """Latch a problem until it is acknowledged; the first one is kept."""
        with self._lock:
            if self._problem is None:
                self._problem = problem

    def _still(self) -> bool:
        """Return True if the fingers were measured at rest, or follow the streamed speed."""
        return self._supervisor.follows if self._speed else self._supervisor.at_rest

    def _rests(self) -> bool:
        """Return True if no stop is owed, and the fingers are still."""
        return not isinstance(self._wanted, Stop) and self._still()

    # ------------------------------------------------------------------------------------ the owner's side of requests

    @property
    def _speed(self) -> float:
        """The streamed speed [m/s]."""
        return self._wanted.speed if isinstance(self._wanted, SpeedOrder) else 0.0

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
        self._move = move
        self._aim = move.width
        self._off_target_since = math.inf
        self._supervisor.move(self._clock.now(), self.state().width, move.width, move.speed)
        self._wanted = WidthOrder(move.width, move.speed, move.force)

    def _stop(self, move: GripperMotion) -> None:
        if not move.ended:
            move.end(MotionState.STOPPED)
            if move is self._move:
                self._rest()

    def _rest(self) -> None:
        """A stop is wanted from now on."""
        now = self._clock.now()
        if not self._lost:  # else the last end of the last command stays known
            self._supervisor.rest(now)
        if not isinstance(self._wanted, Stop):
            self._wanted = Stop()
            self._stop_by = now + self.stopping

    def _take_speed(self, speed: float) -> None:
        """While latched the fingers may close and hold but not open."""
        if self._lost or self._unacknowledged:
            return
        if self._move is not None and not self._move.ended:
            self._stop(self._move)
        self._aim = None
        self._watchdog.renew(self._clock.now())
        self._set_stream(allowed_speed(speed, self.limits, self._latched is not None))

    def _set_stream(self, speed: float) -> None:
        if speed or self._speed:
            self._supervisor.stream(self._clock.now(), speed, self._watchdog.limit)
        self._wanted = SpeedOrder(speed)

    def _unready(self) -> str:
        """Return why no move may be started now; empty when it may."""
        if self._latched is not None:
            return f"latched in the safe state ({self._latched})"
        if self._lost or self._unacknowledged or self._problem:
            return f"not ready: {self._why_lost()}"
        return self._refusal()

    def _why_lost(self) -> str:
        known = "was lost; acknowledge the loss before it moves: " if self._unacknowledged else ""
        return known + self._words()

    def _words(self) -> str:
        return self._problem.message if self._problem is not None else "no state has come"

    # --------------------------------------------------------------------------------------------- the interface

    def state(self) -> GripperState:
        """See the Protocol. Raises DeviceLost: there is no fresh state."""
        if self._lost or self._state is None:
            raise DeviceLost(self.name, self._words())
        return self._state

    def move(self, width: float, speed: float, force: float | None = None) -> GripperMotion:
        limits = self.limits
        refusal = self._unready()
        if refusal:
            raise MotionRefused(self.name, refusal)
        force = limits.force_max if force is None else force
        require_move(self.name, limits, width, speed, force)
        width = min(max(width, limits.width_min), limits.width_max)
        speed = min(speed, limits.speed_max)
        force = min(force, limits.force_max)
        move = self._asked = GripperMotion(
            width, speed, self.state().width, lambda move: self._owner.post(lambda: self._stop(move)), force
        )  # fmt: skip
        self._owner.post(lambda: self._begin(move))
        return move

    def set_speed(self, speed: float) -> None:
        """See the Protocol; while latched the fingers may close and hold but not open.

        Raises DeviceLost: the gripper is lost, or was lost and that is not acknowledged yet.
        """
        if self._lost or self._unacknowledged:
            raise DeviceLost(self.name, self._why_lost())
        self._owner.post(lambda: self._take_speed(speed))

    # ------------------------------------------------------------------------------------------------ the device

    def last_seen(self) -> float | None:
        return None if self._state is None else self._state.stamp

    def check(self) -> None:
        super().check()
        self._owner.check()

    def safe_stop(self, reason: str) -> None:
        with self._lock:
            if self._latched is None:
                self._latched = reason
        self._owner.post(lambda: self._end_move(MotionState.STOPPED))

    def acknowledge(self) -> None:
        """Release the latch; the fingers stay where they are. Raises DeviceLost: no states come."""
        self._owner.ask(self._release)

    def _release(self) -> None:
        if self._lost:
            raise DeviceLost(self.name, f"is still lost: {self._words()}")
        self._supervisor.rest(self._clock.now())
        with self._lock:
            self._latched = self._problem = None
        self._unacknowledged = False

    def pause(self) -> None:
        self._owner.post(self._pause)

    def _pause(self) -> None:
        if self._move is not None and self._move.state is MotionState.RUNNING:
            self._move.state = MotionState.PAUSED
            self._rest()

    def resume(self) -> None:
        move = self._asked
        refusal = self._unready()
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
        """Stop the fingers, which stay where they are, and disconnect."""
        self.safe_stop("closed")
        self._owner.close()
        end = self._clock.now() + LEAVING
        with contextlib.suppress(OSError, DeviceError):
            while isinstance(self._wanted, Stop) and self._clock.now() < end:
                self.step()
                self._clock.advance(1e-3)
        self._drop()
        self._problem = DeviceLost(self.name, "is closed")
        self._lost = True
