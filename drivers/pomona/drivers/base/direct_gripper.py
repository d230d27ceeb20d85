"""Base of grippers without a wire, as simulated and mock ones: read when they are asked, at rest when a move ends."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from pomona.drivers.base.parallel_gripper import ParallelGripper, Wanted
from pomona.drivers.interfaces import GripperState


class DirectGripper(ParallelGripper[GripperState, None]):
    """A gripper in this process. A clock calls its `step`, which follows the base's `_move` and `_speed`."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """See the base."""
        super().__init__(*args, **kwargs)
        self._lost = False
        self._supervisor.rest(self._clock.now())

    @abstractmethod
    def state(self) -> GripperState:
        """Opening and speed now."""

    def _read(self) -> GripperState:
        """Return what is judged, which may be no state."""
        return self.state()

    def last_seen(self) -> float | None:
        return self.state().stamp

    def check(self) -> None:
        wrong = self._supervisor.look(self._clock.now(), self._read())
        if wrong:
            self._fail(wrong)
        super().check()

    def _serve(self) -> None:
        """Nothing: a clock calls `step`, which follows what is wanted."""

    def next_command(self, wanted: Wanted, status: GripperState) -> None:
        """Return nothing, for the same reason."""

    def _send(self, command: None) -> None:
        """Nothing."""

    def _rest(self) -> None:
        super()._rest()
        if self._move is not None and self._move.ended:
            self._move.settled = True

    def _rests(self) -> bool:
        return True
