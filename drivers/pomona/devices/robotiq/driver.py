"""A Robotiq gripper as a `Gripper`: positions in counts, commanded at once or in steps.

The gripper knows positions only. A move at its own speeds is one command; a slower one, and a streamed speed, becomes
positions that advance in steps, a few steps before the measured one: this bounds the force on soft pads. The
force of the command is the limit of the motor's current while it moves; at the limit the fingers stop, and stay.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pomona.devices.robotiq.codec import (
    ACTIVE,
    CLOSING,
    FAULTS,
    OPENING,
    RobotiqCommand,
    RobotiqStatus,
)
from pomona.devices.robotiq.options import MODELS, RobotiqFile
from pomona.devices.robotiq.session import RobotiqSession
from pomona.drivers import (
    DeviceError,
    DeviceFault,
    DeviceLost,
    GripperMotion,
    GripperState,
    Malformed,
    MotionState,
    Nonsense,
    ParallelGripper,
)
from pomona.executive import Clock

PATIENCE = 0.004  # the wire is waited for no longer than this at a time [s]
AHEAD = 3  # most steps by which a position that advances precedes the measured one, beside its way in DELAY
DELAY = (
    0.04  # time from a command to the width that shows it [s]: two exchanges and the fingers' own
)
CATCH_UP = 1.5  # speed of the fingers towards a position that advances, as a multiple of its own
SPEED_WINDOW = 0.04  # window of a speed by differences [s]: positions are counts
ACCELERATION = 1.0  # assumed acceleration for the supervisor [m/s²]
CONNECT, ACTIVATION = (
    1.0,
    8.0,
)  # deadlines of the first status, and of the activation, which moves the fingers [s]
RECONNECT = 0.5  # pause between attempts to open a lost wire again [s]


class RobotiqGripper(ParallelGripper):
    """The gripper. One thread owns the wire; requests are posted to it."""

    outlives = True

    def __init__(
        self,
        open_session: Callable[[], RobotiqSession],
        clock: Clock,
        options: RobotiqFile,
        name: str = "gripper",
    ) -> None:
        self.model, self.options = MODELS[options.model], options
        super().__init__(
            name,
            clock,
            options.limits,
            acceleration=ACCELERATION,
            watchdog=options.watchdog,
            supervision=options.supervision,
        )
        self._open_session = open_session
        self._session: RobotiqSession | None = None
        self._retry_at = self._heard_at = clock.now()
        self._status: RobotiqStatus | None = None
        self._command: RobotiqCommand | None = (
            None  # None: nothing was commanded yet, or the last is no longer known
        )
        self._set_point: float | None = None  # that advances [m]
        self._stepped_at = clock.now()
        self._widths: list[tuple[float, float]] = []

    # ---------------------------------------------------------------------------------------- connection

    def connect(self) -> None:
        """Open the wire and read the status; nothing moves, unless the options allow an activation.

        Raises DeviceError, OSError: no gripper answers, or it is not activated; DeviceFault: a fault, or it moves.
        """
        self._session = self._open_session()
        try:
            self._supervisor.rest(self._clock.now())
            status = self._await(lambda status: True, CONNECT, "does not answer")
            if status.activation != ACTIVE:
                self._activate()
                status = self._await(lambda status: True, CONNECT, "does not answer")
            before, status = status, self._await(lambda status: True, CONNECT, "does not answer")
            self._check_fault(status)
            if abs(status.position - before.position) > 1:
                raise DeviceFault(
                    self.name, "moves without a command of this run: another program moves it"
                )
            self._take(status)
            if self._problem is not None:
                raise self._problem
        except (DeviceError, OSError):
            self._leave()
            raise

    def _activate(self) -> None:
        if not self.options.activate:
            words = (
                "is not activated, and its activation moves the fingers through their whole stroke"
            )
            remedy = "activate it at the pendant, or set 'activate: yes' and start with --cleared"
            raise DeviceFault(self.name, f"{words}: {remedy}")
        for active in (False, True):
            self._command = RobotiqCommand(active=active)
            wanted = ACTIVE if active else 0
            self._await(
                lambda status, wanted=wanted: status.activation == wanted,  # type: ignore[misc]
                ACTIVATION,
                "was not activated",
            )
        self._command = None

    def _await(
        self, until: Callable[[RobotiqStatus], bool], seconds: float, problem: str
    ) -> RobotiqStatus:
        assert self._session is not None
        end, nonsense = self._clock.now() + seconds, ""
        while self._clock.now() < end:
            try:
                status = self._session.serve(self._command, PATIENCE)
            except Malformed as error:
                nonsense = nonsense or f": {error}"
                continue
            except OSError:
                if not nonsense:
                    raise
                break
            if status is not None and until(status):
                return status
        raise DeviceLost(self.name, f"{problem} within {seconds:g} s{nonsense}")

    def step(self) -> None:
        """Serve the gripper once; its own thread calls this in a loop.

        Raises OSError, DeviceLost, Nonsense: the wire failed, or no gripper answers.
        """
        now = self._clock.now()
        if self._session is None:
            self._supervise()
            if now < self._retry_at:
                self._clock.advance(min(self._retry_at - now, 0.05))
                return
            self._session, self._heard_at = self._open_session(), now
        try:
            status = self._session.serve(self._command, PATIENCE)
            if status is not None:
                self._heard_at = self._clock.now()
                self._check_fault(status)
                self._take(status)
        except Malformed as error:
            if self._clock.now() - self._heard_at > self.options.deadline:
                raise Nonsense(self.name, error) from error
        except DeviceFault as error:
            self._lose(error)
        silent = self._clock.now() - self._heard_at
        if silent > self.options.deadline:
            raise DeviceLost(self.name, f"does not answer for {1e3 * silent:.0f} ms")
        self._supervise()

    def _failed(self, error: BaseException) -> None:
        """As the base; the wire is opened again."""
        super()._failed(error)
        self._leave()
        self._retry_at = self._clock.now() + RECONNECT

    def _check_fault(self, status: RobotiqStatus) -> None:
        if status.fault in FAULTS or status.activation != ACTIVE:
            raise DeviceFault(self.name, FAULTS.get(status.fault, "is no longer activated"))

    def _take(self, status: RobotiqStatus) -> None:
        """Take a status: the width by its position, the speed by differences, the force by the cause of a stop."""
        now = self._clock.now()
        self._status, width = status, self.width_of(status.position)
        recent = [(t, w) for t, w in self._widths if t >= now - SPEED_WINDOW]
        self._widths = [*(recent or self._widths[-1:]), (now, width)]
        then, before = self._widths[0]
        speed = (width - before) / (now - then) if now - then > 0.5 * SPEED_WINDOW else 0.0
        limit = (
            2.0 * self.limits.force_max
        )  # reached when the fingers were stopped; below it the force is unknown
        self._measured(now, width, speed, {CLOSING: limit, OPENING: -limit}.get(status.object))

    # ------------------------------------------------------------------------------------------- counts

    def width_of(self, position: int) -> float:
        """Return the opening at a position in counts [m]."""
        most_open, closed = self.options.counts
        share = (closed - position) / (closed - most_open)
        return self.options.finger_offset + self.model.stroke * min(max(share, 0.0), 1.0)

    def position_of(self, width: float) -> int:
        """Return the position in counts nearest to an opening [m]."""
        closed = self.options.counts[1]
        return round(closed - (width - self.options.finger_offset) / self.limits.step)

    def _speed_code(self, speed: float) -> int:
        slowest, fastest = self.model.speeds
        return min(max(round((speed - slowest) / (fastest - slowest) * 255.0), 0), 255)

    # ---------------------------------------------------------------------------------------- commands

    def _start_move(self, move: GripperMotion) -> None:
        self._set_point, self._stepped_at = self.state().width, self._clock.now()
        if move.speed >= self.model.speeds[0]:
            self._go_to(move.width, move.speed)
            self._set_point = move.width

    def _start_stream(self, speed: float) -> None:
        if self._set_point is None:
            self._set_point, self._stepped_at = self.state().width, self._clock.now()

    def _start_rest(self) -> None:
        holds = self._status is not None and self._status.object in (OPENING, CLOSING)
        self._set_point = None
        if (
            self._command is not None and not holds
        ):  # fingers that hold something keep their command, and press on
            command = self._command
            self._command = RobotiqCommand(
                True, False, command.position, command.speed, command.force
            )

    def _go_to(self, width: float, speed: float) -> None:
        least, most = self.model.forces
        force = round((self.limits.force_max - least) / (most - least) * 255.0)
        self._command = RobotiqCommand(
            True, True, self.position_of(width), self._speed_code(speed), force
        )

    def _watch(self, state: GripperState) -> None:
        now, move = self._clock.now(), self._move
        elapsed, self._stepped_at = (
            min(max(now - self._stepped_at, 0.0), 0.02),
            now,
        )  # no jump after a stall
        if self._set_point is None:
            return
        running = move is not None and move.state is MotionState.RUNNING
        if self._speed or (running and move is not None and self._set_point != move.width):
            target = (
                move.width if running and move is not None else math.copysign(math.inf, self._speed)
            )
            speed = move.speed if running and move is not None else abs(self._speed)
            self._advance(target, speed, elapsed, state.width)
        self._judge_move(state, self._set_point, 1.5 * self.limits.step)

    def _advance(self, target: float, speed: float, elapsed: float, width: float) -> None:
        """Let the set-point advance towards `target` at a speed [m/s], for fingers at `width` [m]."""
        assert self._set_point is not None
        limits, ahead = self.limits, AHEAD * self.limits.step + speed * DELAY
        left = target - self._set_point
        wanted = self._set_point + math.copysign(min(abs(left), speed * elapsed), left)
        wanted = min(max(wanted, limits.width_min), limits.width_max)
        least, most = min(width - ahead, self._set_point), max(width + ahead, self._set_point)
        self._set_point = min(max(wanted, least), most)
        self._go_to(self._set_point, CATCH_UP * speed)

    def _forget(self) -> None:
        self._command, self._set_point = None, None

    def _leave(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            session.close()
