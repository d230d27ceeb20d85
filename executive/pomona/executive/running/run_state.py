"""Where a run stands, and how it ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from pomona.executive.reasons import Reason


class RunState(Enum):
    """Where a run stands."""

    IDLE = "idle"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    STOPPING = "stopping"
    STOPPED = "stopped"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    FAULTED = "faulted"

    @property
    def ended(self) -> bool:
        """Whether the run is over."""
        return self in (RunState.STOPPED, RunState.SUCCEEDED, RunState.FAILED, RunState.FAULTED)


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended."""

    outcome: str  # success, failure, stopped or error
    reason: Reason | None  # why it did not succeed
    ticks: int  # number of ticks
    time: float  # time, wall: seconds on the run's clock (pauses left out) and really
    wall: float
    truth: Mapping[str, Any] | None  # the simulated world's score
    interrupted: bool = False  # it was ended by Ctrl-C
