"""Base of grippers without a wire, as simulated and mock ones: read when they are asked, at rest when a move ends."""

from __future__ import annotations

from abc import abstractmethod

from pomona.drivers.base.parallel_gripper import ParallelGripper, Wanted
from pomona.drivers.gripper_supervisor import DirectMotion, GripperMotion, GripperSupervision
from pomona.drivers.interfaces import GripperLimits, GripperState
from pomona.executive.clock import Clock


class DirectGripper(ParallelGripper[GripperState, None]):
    """A gripper in this process. A clock calls its `step`, which follows the base's `_move` and `_speed`."""

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
        """See the base."""
        super().__init__(
            name, clock, limits, acceleration=acceleration, watchdog=watchdog, supervision=supervision
        )  # fmt: skip
        self._lost = False
        self._supervisor.rest(clock.now())

    @abstractmethod
    def state(self) -> GripperState:
        """Opening and speed now."""

    def last_seen(self) -> float | None:
        return self.state().stamp

    def check(self) -> None:
        wrong = self._supervisor.look(self._clock.now(), self.state())
        if wrong and self._problem is None:
            self._fail(wrong)
        super().check()

    def _serve(self) -> None:
        """Nothing: a clock calls `step`, which follows what is wanted."""

    def next_command(self, wanted: Wanted, status: GripperState) -> None:
        """Return nothing, for the same reason."""

    def _send(self, command: None) -> None:
        """Nothing."""

    def _new_move(self, width: float, speed: float, force: float) -> GripperMotion:
        return DirectMotion(width, speed, self.state().width, self._rest, force)

    def _rests(self) -> bool:
        return True
