"""Check that the joints rest after the end of the process that moved them; called by the supervisor process.

No command is necessary: the last set-points end at rest. This module waits until the joints do.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from pomona.devices.ros2.joints import JointFeed
from pomona.executive import SystemClock
from pomona.tools.ros2.rosbridge import open_peer

DEADLINE = 2.5  # seconds within which the joints must be seen at rest
STILL = 0.1  # time without motion after which the joints count as resting [s]


def see_rest(
    address: str, states: str, joints: Sequence[str], slow: float, distribution: str = "jazzy"
) -> None:
    """Wait until the joints are slower than `slow` [rad/s or m/s]; the other arguments are those of the cell file.

    Raises TimeoutError: they go on moving, or no message arrives; UsageError: there is no peer at the address.
    """
    wire = open_peer(address, "pomona_supervisor", distribution)
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
        words = "they go on moving" if seen else "no message arrives"
        raise TimeoutError(
            f"joints on {states} were not measured at rest within {DEADLINE:g} s: {words}"
        )
    finally:
        wire.close()
