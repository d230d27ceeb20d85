"""A Robotiq gripper as a `Gripper`: positions in counts, commanded at once or in steps.

The gripper knows positions only. A move at its own speeds is one command; a slower one, and a streamed speed, becomes
positions that advance in steps, a few steps before the measured one: this bounds the force on soft pads. The
force of the command is the limit of the motor's current while it moves; at the limit the fingers stop, and stay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

from pomona.devices.robotiq.codec import (
    ACTIVE,
    CLOSING,
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
    GripperState,
    Malformed,
    Nonsense,
    PositionGripper,
    SpeedOrder,
    Stop,
    Wanted,
    WidthOrder,
)
from pomona.executive import Clock

PATIENCE = 0.004  # the wire is waited for no longer than this at a time [s]
AHEAD = 3  # most steps by which a position that advances precedes the measured one, beside its way in DELAY
# time from a command to the width that shows it [s]: two exchanges and the fingers' own
DELAY = 0.04
CATCH_UP = 1.5  # speed of the fingers towards a position that advances, as a multiple of its own
ACCELERATION = 1.0  # assumed acceleration for the supervisor [m/s²]
CONNECT = 1.0
ACTIVATION = (
    8.0  # deadlines of the first status, and of the activation, which moves the fingers [s]
)
RECONNECT = 0.5  # a wire without an answer for this long is opened again [s]


class RobotiqGripper(PositionGripper[RobotiqStatus, RobotiqCommand]):
    """The gripper. One thread owns the wire; requests are posted to it."""

    outlives = True
    declared: ClassVar[Mapping[str, str]] = {
        "a_move_ends_with_its_wire": (
            "it goes on to the position of its last command: the manual's register gFLT has fault 9, no communication "
            "for 1 s, and no stop by it"
        )
    }

    def __init__(
        self,
        open_session: Callable[[], RobotiqSession],
        clock: Clock,
        options: RobotiqFile,
        name: str = "gripper",
    ) -> None:
        self.model = MODELS[options.model]
        self.options = options
        super().__init__(
            name,
            clock,
            options.limits,
            acceleration=ACCELERATION,
            watchdog=options.watchdog,
            supervision=options.supervision,
        )
        self._open_session = open_session
        self._heard_at = clock.now()
        # None: nothing was commanded yet, or the last is no longer known
        self._written: RobotiqCommand | None = None

    # ---------------------------------------------------------------------------------------- connection

    def connect(self) -> None:
        """Open the wire and read the status; nothing moves, unless the options allow an activation.

        Raises DeviceError, OSError: no gripper answers, or it is not activated; DeviceFault: a fault, or it moves.
        """
        self._reopen()
        try:
            self._supervisor.rest(self._clock.now())
            status = self._await(lambda status: True, CONNECT, "does not answer")
            if status.activation != ACTIVE:
                self._activate()
                status = self._await(lambda status: True, CONNECT, "does not answer")
            before = status
            status = self._await(lambda status: True, CONNECT, "does not answer")
            if status.problem:
                raise DeviceFault(self.name, status.problem)
            if abs(status.position - before.position) > 1:
                raise DeviceFault(
                    self.name, "moves without a command of this run: another program moves it"
                )
            self._take(status)
            if self._problem is not None:
                raise self._problem
        except (DeviceError, OSError):
            self._drop()
            raise

    def _open(self) -> None:
        self._session = self._open_session()
        self._heard_at = self._clock.now()

    def _activate(self) -> None:
        if not self.options.activate:
            words = (
                "is not activated, and its activation moves the fingers through their whole stroke"
            )
            remedy = "activate it at the pendant, or set 'activate: yes' and start with --cleared"
            raise DeviceFault(self.name, f"{words}: {remedy}")
        for active, wanted in ((False, 0), (True, ACTIVE)):
            self._written = RobotiqCommand(active=active)
            self._await(
                lambda status, wanted=wanted: status.activation == wanted,  # type: ignore[misc]
                ACTIVATION,
                "was not activated",
            )
        self._written = None

    def _await(
        self, until: Callable[[RobotiqStatus], bool], seconds: float, problem: str
    ) -> RobotiqStatus:
        end = self._clock.now() + seconds
        nonsense = ""
        while self._clock.now() < end:
            try:
                status = self._session.serve(self._written, PATIENCE)
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

    def _serve(self) -> None:
        """Exchange the command for the status. Raises OSError: the wire failed."""
        nonsense: DeviceError | None = None
        try:
            status = self._session.serve(self._written, PATIENCE)
            if status is not None:
                self._heard_at = self._clock.now()
                self._take(status)
        except Malformed as error:
            nonsense = Nonsense(self.name, error)
        except DeviceFault as error:
            self._give_up(error)
        silent = self._clock.now() - self._heard_at
        if silent > self.options.deadline:
            words = f"does not answer for {1e3 * silent:.0f} ms"
            self._lose(nonsense or DeviceLost(self.name, words))
        if silent > RECONNECT:
            self._drop()

    def _drop(self) -> None:
        """As the base: a gripper that was switched off meanwhile must not be activated by the last command."""
        super()._drop()
        self._written = self._set_point = None

    def _take(self, status: RobotiqStatus) -> None:
        """Take a status: the width by its position, the force by the cause of a stop."""
        now = self._clock.now()
        width = self.width_of(status.position)
        self._status = status
        # reached when the fingers were stopped; below it the force is unknown
        limit = 2.0 * self.limits.force_max
        force = {CLOSING: limit, OPENING: -limit}.get(status.object)
        self._measured(now, width, self._rate(now, width), force)
        if status.activation != ACTIVE:
            self._sent = self._written = None  # the last command would activate it
        if status.problem:
            self._give_up(DeviceFault(self.name, status.problem))

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

    # ---------------------------------------------------------------------------------------- commands

    def next_command(self, wanted: Wanted, status: RobotiqStatus) -> RobotiqCommand | None:
        """Return the registers; none for a gripper that is not activated: the stop waits for that."""
        if status.activation != ACTIVE:
            return None
        if isinstance(wanted, Stop):
            if status.holds:  # it keeps its command, and presses on
                return self._written
            self._set_point = None
            return RobotiqCommand(True, False, status.requested)
        assert self._set_point is not None
        speed = CATCH_UP * abs(wanted.speed)
        force = self.limits.force_max
        if isinstance(wanted, WidthOrder):
            speed = wanted.speed if self._is_direct(wanted) else speed
            force = wanted.force
        codes = _code(speed, self.model.speeds), _code(force, self.model.forces)
        return RobotiqCommand(True, True, self.position_of(self._set_point), *codes)

    def shows(self, wanted: Wanted, status: RobotiqStatus) -> bool:
        stopped = not status.go or status.holds
        return stopped and super().shows(wanted, status)

    def _send(self, command: RobotiqCommand) -> None:
        self._written = command

    def _is_direct(self, wanted: WidthOrder) -> bool:
        """Return True for a move at a speed of the gripper's own: one command."""
        return wanted.speed >= self.model.speeds[0]

    def _advanced(self, wanted: WidthOrder | SpeedOrder, width: float, elapsed: float) -> float:
        if isinstance(wanted, WidthOrder) and self._is_direct(wanted):
            return wanted.width
        return super()._advanced(wanted, width, elapsed)

    def _ahead(self, speed: float) -> float:
        return AHEAD * self.limits.step + speed * DELAY

    def _watch(self, state: GripperState) -> None:
        if self._set_point is not None:
            self._judge_move(state, self._set_point, 1.5 * self.limits.step)

    def _leave(self) -> None:
        self._session.close()


def _code(value: float, span: tuple[float, float]) -> int:
    """Return a speed [m/s] or a force [N] in counts of its span."""
    least, most = span
    return min(max(round((value - least) / (most - least) * 255.0), 0), 255)
