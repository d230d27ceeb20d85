"""After the process that moved a device is gone: sees to it that the joints rest; called by the supervisor process.

Nothing needs to be sent: what the device was told last ends at rest. Whether it does is looked at here.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from pomona.drivers.ros2.joints import JointFeed
from pomona.executive.clock import SystemClock
from pomona.executive.ros2.peer import Ros2Peer

DEADLINE = 2.5
"""Seconds within which the joints must be seen at rest."""
STILL = 0.1
"""For so long they must not have moved [s]."""


def see_rest(address: str, states: str, joints: Sequence[str], slow: float) -> None:
    """Wait until the joints rest.

    Args:
        address, states, joints: as in the cell file.
        slow: what is slower than this rests [rad/s or m/s].

    Raises:
        TimeoutError: they move on, or nothing is heard of them.
        UsageError: nobody can be reached there.
    """
    wire = Ros2Peer(address, node="pomona_supervisor")
    try:
        feed = JointFeed("joints", wire, states, joints, SystemClock(), DEADLINE)
        seen: list[tuple[float, np.ndarray]] = []
        end = time.monotonic() + DEADLINE
        while time.monotonic() < end:
            sample = feed.newest(0.02)
            if sample is None:
                continue
            seen = [(t, q) for t, q in seen if np.abs(q - sample.q).max() < slow * STILL]
            seen.append((sample.stamp, sample.q))
            if sample.stamp - seen[0][0] >= STILL:
                return
        words = "they move on" if seen else "nothing is heard of them"
        raise TimeoutError(f"joints on {states} were not measured at rest within {DEADLINE:g} s: {words}")
    finally:
        wire.close()
