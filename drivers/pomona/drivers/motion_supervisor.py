"""Detects faults of an arm: implausible feedback, and motions that deviate from their path.

Every arm's driver, simulated, mock or real, passes feedback, commands and the time to its supervisor; the supervisor
raises the error that must end in the safe state. It has no clock, no thread and no device of its own.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from pomona.drivers.errors import DeviceFault, DeviceLost
from pomona.drivers.interfaces import ArmLimits
from pomona.drivers.path_motion import PathMotion, Phase
from pomona.drivers.streamed_motion import StreamedMotion
from pomona.executive.values.arrays import Float64
from pomona.executive.values.kinds import Measure
from pomona.executive.values.sections import value
from pomona.executive.values.units import ANGLE, TIME

PERIOD = 0.01  # period of the checks [s]; a controller pushes its state every 25 ms
STANDING, STANDING_AFTER = 0.25, 0.5
"""Share of the following error that an arm may stand from a set-point that stands, and the time for which it must
stand, beside the lag [s]: an object in its way held an arm 0.0035 rad off."""
# distance of resting joints from where they came to rest that nobody ordered [rad]: 0.2°
STRAYS = 0.004
JUMPS = 0.05  # joints that something held do not move by more before that is noticed [rad]
BESIDE, WITHIN = 0.05, 0.1
"""Share of the following error by which an arm may leave its path, wherever along it the arm is, and the time within
which it does so [s]: joints that are held or come late do not. The simulated arm left it by less than 0.001 rad."""
SLOWEST = 0.5  # share of its speed to which a controller may slow a motion down by itself
OVERSPEED = 1.5  # highest measured speed over the limit: controllers stop an arm at 1.05 to 1.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Supervision:
    """How closely an arm must follow its commands.

    Attributes:
        following_error: largest following error of a joint [rad]. The simulated arm lags by up to 0.003 rad
            (measured), and without velocity feed-forward by 0.037 rad: twice that has another cause.
        lag: delay of the network and the controller's servos [s]: the arm may be at any of the set-points that are
            no older than this.
        margin: a motion, a stop or a pause may take this much longer than planned [s].
        stall: a controller must take the next point of a running motion within this time [s].
        status: a controller without a status for this long may hide an emergency stop [s]: ten updates of 25 ms.
    """

    following_error: float = value(
        Measure(ANGLE, "0.005 rad", "0.5 rad"), "0.08 rad", "largest following error of a joint"
    )
    lag: float = value(Measure(TIME, "0 s", "1 s"), "200 ms", "delay of network and servos")
    margin: float = value(
        Measure(TIME, "100 ms", "30 s"), "2 s", "a motion may take this much longer than planned"
    )
    stall: float = value(
        Measure(TIME, "50 ms", "5 s"), "500 ms", "the next point must be taken within this time"
    )
    status: float = value(
        Measure(TIME, "30 ms", "2 s"), "250 ms", "without a status for this long the arm is lost"
    )


class MotionSupervisor:
    """Watches one arm. All times are the cell's [s], all joints in one order of the caller's choice, shape (dof,).

    Attributes:
        has_come_free: resting joints have just begun to move, so little that no encoder has jumped: they can stay there.
    """

    def __init__(self, device: str, limits: ArmLimits, supervision: Supervision) -> None:
        self._device, self._limits, self._supervision = device, limits, supervision
        self._status_at: float | None = None
        self._looked_at = -np.inf
        self._set_points: deque[tuple[float, Float64]] = deque()
        self._standing: tuple[float, Float64] | None  # since when the set-point is here
        self._beside: Float64  # by which the joints left the path of a motion [rad]
        self._lately: list[tuple[float, Float64]] = []  # feedback, not older than `WITHIN`
        self._same_since = 0.0  # the newest, to the last bit [s], and the set-point at that time
        self._commanded: Float64 | None = None
        self._speed = 1.0
        self._advanced: tuple[float, float] = (0.0, 0.0)
        self._rests_at: Float64 | None = None  # joints where the arm was left
        self.has_come_free = False
        self.end()

    def due(self, now: float) -> bool:
        """Return True if it is time to look again, for callers that are called more often than every `PERIOD`."""
        if 0.0 <= now - self._looked_at < PERIOD - 1e-9:
            return False
        self._looked_at = now
        return True

    # --------------------------------------------------------------------------------- what the arm says

    def on_feedback(self, stamp: float, q: Float64, qd: Float64) -> None:
        """Judge feedback before anybody uses it.

        Args:
            stamp: when it was measured or came; never goes back.
            q, qd: positions [rad] and velocities [rad/s], shape (dof,).

        Raises DeviceLost: it cannot be true.
        """
        problem = self._implausible(stamp, q, qd)
        if problem:
            raise DeviceLost(self._device, f"its feedback is implausible: {problem}")
        oldest = stamp - self._supervision.lag
        while len(self._set_points) > 1 and self._set_points[1][0] <= oldest:
            self._set_points.popleft()  # but one before the lag
        if not self._lately or not np.array_equal(q, self._lately[-1][1]):
            passed = [commanded for due, commanded in self._set_points if due <= stamp]
            self._same_since, self._commanded = stamp, passed[-1] if passed else None
        self._note_path(stamp, q.copy())

    def on_status(self, now: float) -> None:
        """Note that the controller has reported its status."""
        self._status_at = now

    def check_status(self, now: float) -> None:
        """Check the age of the status, for arms with a controller that reports one.

        Raises DeviceLost: the status is too old, so that a stop or an alarm would be hidden.
        """
        if self._status_at is None:
            self._status_at = now
        silent = now - self._status_at
        if silent > self._supervision.status:
            raise DeviceLost(
                self._device, f"the controller has not sent its status for {1e3 * silent:.0f} ms"
            )

    def forget(self) -> None:
        """Begin anew: after a reconnection or an acknowledgement nothing of before is compared with."""
        self._status_at = self._rests_at = None
        self._lately.clear()
        self.end()

    # --------------------------------------------------------------------------------- what it shall do

    def command(self, due: float, q: Float64) -> None:
        """A set-point that the arm shall pass at the time `due`; in the order of their times."""
        self._rests_at = None
        self._set_points.append((due, q))
        if self._standing is None or np.abs(q - self._standing[1]).max() > 1e-4:  # rad
            self._standing = (due, q)

    def end(self) -> None:
        """No motion is watched any more."""
        self._set_points.clear()
        self._beside, self._standing = np.zeros(1), None
        self._phase, self._deadline = Phase.RESTING, np.inf

    def look_at_rest(self, q: Float64) -> None:
        """Look after an arm that nothing of this run moves. Raises DeviceFault: it moves."""
        if self._rests_at is None:
            self._rests_at = q.copy()
        way = np.abs(q - self._rests_at)
        strayed = float(way.max())
        self.has_come_free = STRAYS < strayed < JUMPS
        if strayed > STRAYS:
            self._rests_at = q * np.nan  # it is told once
            self._accuse(way, "moves without a command of this run")

    def look(self, now: float, motion: PathMotion | StreamedMotion, advance: float) -> None:
        """Look after a motion; `advance` is any number that grows while the arm's controller goes along with it.

        A motion that has failed brakes already: only whether it comes to rest is watched.

        Raises:
            DeviceFault: the arm does not follow, or moves otherwise; its controller does not go on; no end comes.
            DeviceLost: the feedback stands still although the arm is moved.
        """
        self._watch_time(now, motion, advance)
        if self._lately and self._set_points and not motion.problem:
            self._watch_frozen(self._lately[-1][0])
            if self._beside.max() > BESIDE * self._supervision.following_error:
                self._accuse(self._beside, "leaves its path")
            self._watch_following(*self._lately[-1])

    # ----------------------------------------------------------------------------------------- inside

    def _implausible(self, stamp: float, q: Float64, qd: Float64) -> str:
        limits = self._limits
        if not (np.isfinite(q).all() and np.isfinite(qd).all()):
            return "its joints are not finite numbers"
        outside = np.maximum(limits.lower - q, q - limits.upper)
        # mechanical stops keep every joint within this distance of its range [rad]
        if outside.max() > 0.1:
            return f"joint {outside.argmax() + 1} at {q[outside.argmax()]:.4g} rad, far outside its range"
        speed = np.abs(qd) / limits.velocity
        if speed.max() > OVERSPEED:
            return f"joint {speed.argmax() + 1} at {speed.max():.2g} times its largest speed"
        if not self._lately:
            return ""
        before, q_before = self._lately[-1]
        if stamp < before:
            return "its time goes back"
        jump = np.abs(q - q_before)
        # jitter of messages over a network [s]: two pushes of 25 ms
        beyond = jump - OVERSPEED * limits.velocity * (stamp - before + 0.05)
        if beyond.max() > 0.0:
            joint = beyond.argmax()
            return f"joint {joint + 1} jumped by {np.degrees(jump[joint]):.1f}°"
        return ""

    def _watch_time(self, now: float, motion: PathMotion | StreamedMotion, advance: float) -> None:
        supervision, phase = self._supervision, motion.phase
        runs = phase is Phase.RUNNING  # then it rests at its end only: not where it was paused
        if phase is not self._phase or motion.speed != self._speed:
            if self._phase is Phase.RESTING:  # a stop or a new speed shows no progress
                self._advanced = (advance, now)
            self._phase, self._speed = phase, motion.speed
            left = motion.time_left / SLOWEST if runs else 0.0
            self._deadline = np.inf if phase is Phase.RESTING else now + left + supervision.margin
        if advance != self._advanced[0] or (
            motion.set_point_arrived if runs else motion.set_point_rests
        ):
            self._advanced = (advance, now)
        stalled = now - self._advanced[1]
        if stalled > supervision.stall and phase is not Phase.RESTING:
            self._advanced = (advance, now)  # the stop that follows has as much time
            raise DeviceFault(
                self._device, f"the controller has not continued the motion for {stalled:.1f} s"
            )
        if now > self._deadline:
            words = "did not end" if runs else "did not come to rest"
            raise DeviceFault(
                self._device,
                f"the motion {words} {supervision.margin:g} s after its longest expected time",
            )

    def _note_path(self, stamp: float, q: Float64) -> None:
        """Note by how much the joints that move have left the path lately, if it is more than before."""
        self._lately = [one for one in self._lately if one[0] >= stamp - WITHIN] + [(stamp, q)]
        moves = np.abs(q - self._lately[-2:][0][1]) > 1e-4  # rad: joints that stand do not follow
        if len(self._set_points) < 2 or not moves.any():
            return
        path = np.array([commanded for _, commanded in self._set_points]) * moves
        left = beside(path, q * moves) - beside(path, self._lately[0][1] * moves).max()
        self._beside = max(self._beside, left, key=np.max)

    def _watch_frozen(self, stamp: float) -> None:
        """The arm may stand at a set-point as old as the lag: that one must not have moved since the feedback did."""
        _, commanded = self._set_points[0]
        if self._commanded is None:
            self._commanded = commanded
        same = stamp - self._same_since
        # A set-point that has moved this far moves an encoder, too [rad]: hundreds of steps of a 17-bit encoder
        moved = np.abs(commanded - self._commanded).max() > 0.01
        if moved and same > self._supervision.lag:
            since = f"for {1e3 * same:.0f} ms although the arm is to move"
            raise DeviceLost(self._device, f"its feedback has not changed {since}")

    def _watch_following(self, stamp: float, q: Float64) -> None:
        passed = [point for due, point in self._set_points if due <= stamp]
        error = np.abs(np.array(passed or [self._set_points[0][1]]) - q)
        nearest = error[error.max(axis=1).argmin()]
        if nearest.max() > self._supervision.following_error:
            self._refuse(nearest, "is")
        since, standing = self._standing or (np.inf, q)
        off = np.abs(standing - q)
        stood = stamp - since > STANDING_AFTER + self._supervision.lag
        if stood and off.max() > STANDING * self._supervision.following_error:
            self._refuse(off, "stands")

    def _accuse(self, way: Float64, moves: str) -> None:
        who = "another program commands the arm, or something pushes it"
        raise DeviceFault(self._device, f"joint {way.argmax() + 1} {moves}: {who}")

    def _refuse(self, error: Float64, stands: str) -> None:
        away = f"{stands} {np.degrees(error.max()):.1f}° from its set-point"
        raise DeviceFault(
            self._device, f"the arm does not follow: joint {error.argmax() + 1} {away}"
        )


def beside(path: Float64, q: Float64) -> Float64:
    """Return the distances of joints `q`, (dof,) [rad], from the nearest place on a path of straight pieces, (n, dof).

    A piece counts twice as long, since an arm with feed-forward is ahead of the newest set-point.
    """
    start, step = path[:-1], np.diff(path, axis=0)
    along = ((q - start) * step).sum(axis=1) / np.maximum((step * step).sum(axis=1), 1e-18)
    off: Float64 = np.abs(start + np.clip(along, 0.0, 2.0)[:, None] * step - q)
    nearest: Float64 = off[off.max(axis=1).argmin()]
    return nearest
