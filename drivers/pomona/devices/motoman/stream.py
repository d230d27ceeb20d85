"""Sends a motion to the controller point by point, a moment ahead of the arm.

The controller keeps a queue and interpolates; a point that does not fit is answered BUSY and sent again. The queue is
kept short (`lead`), because queued points cannot be changed: a stop takes effect behind them. It is shorter still while
the arm is slow, as where it lands: a slow arm that runs out of points stands at once, without harm.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pomona.devices.motoman.codec import Result, TrajectoryPoint, Valid
from pomona.devices.motoman.options import POINT_PERIOD, SHORT, MotomanFile
from pomona.devices.motoman.session import ControllerSession
from pomona.devices.motoman.words import refusal
from pomona.drivers import DeviceFault, KnotMaker, PathMotion, StreamedMotion
from pomona.executive import Clock, Float64

# period of the controller's own interpolation, and of stepping the path here [s]
INTERPOLATION = 0.004
SLOW = 0.05  # speed of each joint up to which the queue is short [rad/s]
APART = 1.2  # time between points, as a multiple of that of an answer
GAP = 0.1  # gap between points after which a moving arm rests [s]: going on would be an unrequested start


class RanDryError(DeviceFault):
    """The controller had no points while the arm moved, and has stopped it."""


class PointStream(KnotMaker):
    """The points of one motion.

    Attributes:
        sent: points that the controller accepted.
        busy: how often it answered BUSY.
        dry: how often the controller must have run out of points while the arm moved.
    """

    def __init__(
        self,
        motion: PathMotion | StreamedMotion,
        q_arm: Float64,
        clock: Clock,
        options: MotomanFile,
        commanded: Callable[[float, Float64], None] = lambda due, q: None,
    ) -> None:
        """Begin at the arm's own position `q_arm`, shape (dof,) [rad].

        `commanded` is called with every accepted point and the time at which the arm shall pass it [s].
        """
        super().__init__(motion, q_arm, clock, INTERPOLATION, POINT_PERIOD, options.lead)
        self._commanded = commanded
        self._joint_of_place = np.argsort(options.wire_joints)
        self.sent = 0
        self.busy = 0
        self.dry = 0
        self._group = options.group
        self._lead = options.lead
        # the set-points of a streamed motion are not known further ahead when it becomes quick
        self._slow_lead = options.lead * (SHORT if isinstance(motion, PathMotion) else 1.0)
        self._time = 0.0
        self._began: float | None = None
        self._resend_at = self._sent_at = 0.0
        self._moving = self._quick = False
        self._point: TrajectoryPoint | None = self._make(q_arm, np.zeros_like(q_arm))

    @property
    def played(self) -> bool:
        """Whether the controller must have played everything that was sent."""
        return (
            self._point is None
            and self._began is not None
            and self._clock.now() >= self._began + self._time
        )

    @property
    def ahead(self) -> float:
        """How much motion the controller must still have in its queue [s]; negative when it has run out."""
        return 0.0 if self._began is None else self._time - (self._clock.now() - self._began)

    def pump(self, session: ControllerSession) -> None:
        """Take the answer to the last point, and send the next when it is due.

        Raises:
            DeviceFault: the controller refused a point.
            RanDryError: it had none for longer than `GAP`; nothing is sent.
            OSError, DeviceLost, Nonsense: see `ControllerSession`.
        """
        now = self._clock.now()
        if session.awaiting:
            reply = session.reply()
            if reply is None:
                return
            if reply.result == Result.BUSY:
                self.busy += 1
                self._resend_at = (
                    now + 0.01
                )  # wait before a point that was answered BUSY is sent again [s]
            elif reply.result == Result.SUCCESS:
                self._accepted(session.device, now)
            else:
                raise DeviceFault(session.device, refusal(reply))
        ahead = self.ahead
        if self._point is None and ahead < (self._lead if self._quick else self._slow_lead):
            time = self._time
            moved = self._moving
            if moved and ahead < -GAP:
                why = "the computer or the connection was delayed, and the arm has stopped"
                raise RanDryError(session.device, f"ran out of points for {-ahead:.2f} s: {why}")
            self._point = self._following()
            if self._point is not None and ahead < 0.0:
                self._began = (
                    now - time
                )  # the queue has run dry: at rest, after a pause, or because this came late
                self.dry += int(moved)
        if self._point is not None and now >= self._resend_at:
            self._sent_at = now
            session.send(self._point)

    def _accepted(self, device: str, now: float) -> None:
        """Points are as far apart as their answers, or the queue would run dry. Raises DeviceFault: these are too late."""
        point = self._point
        self._point = None
        self.sent += 1
        took = now - self._sent_at
        if self._began is None:
            self._began = self._sent_at
            if took > self._lead / 2.0:
                late = f"answers {1e3 * took:.0f} ms late"
                raise DeviceFault(device, f"{late}: the connection is too slow for `lead`")
        self._steps = max(self._steps, math.ceil(APART * took / INTERPOLATION))
        self._slow_lead = max(self._slow_lead, 2.0 * APART * took)
        if point is not None:
            self._commanded(self._began + point.time, self.q_last)

    def _following(self) -> TrajectoryPoint | None:
        """Return the next point, or None while the set-point rests."""
        now = self._clock.now()
        knot = self.next(now if self._began is None else max(self._began + self._time, now))
        if knot is None:
            return None
        elapsed, q, qd = knot
        self._time += elapsed
        return self._make(q, qd)

    def _make(self, q: Float64, qd: Float64) -> TrajectoryPoint:
        self._moving, self._quick = bool(np.any(qd != 0.0)), bool(np.any(np.abs(qd) > SLOW))
        valid = Valid.TIME | Valid.POSITION | Valid.VELOCITY
        q_wire = q[self._joint_of_place]
        qd_wire = qd[self._joint_of_place]
        return TrajectoryPoint(
            self._group,
            self.sent,
            valid,
            self._time,
            tuple(q_wire.tolist()),
            tuple(qd_wire.tolist()),
        )
