"""From two pad wrenches to the loads of the grasp, through filters that are slow for noise and fast for jumps.

A pad's frame: z out of its face (pressing is a negative force z), x along the approach, y = z x x. Both pads share x;
y and z of the second pad point against those of the first, so its tangential force and torsional moment are turned into
the first pad's frame. The torsional moment is taken about the contact's own centre, which the other two torques give.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

PAD_HALF = 0.010
"""A contact lies within this of the pad's centre [m]."""

PRESSING = 0.2
"""Below this normal force the contact's place is not computed [N]."""


@njit(cache=True)
def loads_of_finger(w, mirrored):  # type: ignore[no-untyped-def]
    """(f_n, f_x, f_y, tau_n) of a pad's wrench, shape (6,), in the first pad's frame."""
    f_n = -w[2]
    x = y = 0.0
    if f_n > PRESSING:
        x = min(max(w[4] / f_n, -PAD_HALF), PAD_HALF)
        y = min(max(-w[3] / f_n, -PAD_HALF), PAD_HALF)
    tau_n = w[5] - (x * w[1] - y * w[0])
    if mirrored:
        return f_n, w[0], -w[1], -tau_n
    return f_n, w[0], w[1], tau_n


@njit(cache=True)
def smooth(raw, bias, noise, fast, slow, smoothed, shares):  # type: ignore[no-untyped-def]
    """Advance both first-order filters by one sample and write `smoothed`, all of shape (2, 6).

    `smoothed` is the slow one, plus what the fast one is beyond it by more than noise explains.
    """
    fast_share, normal_share, load_share = shares
    for i in range(2):
        for j in range(6):
            value = raw[i, j] - bias[i, j]
            fast[i, j] += fast_share * (value - fast[i, j])
            slow[i, j] += (normal_share if j == 2 else load_share) * (value - slow[i, j])
            jump = fast[i, j] - slow[i, j]
            beyond = max(abs(jump) - noise[i, j], 0.0)
            smoothed[i, j] = slow[i, j] + (beyond if jump > 0.0 else -beyond)


def pad_loads(wrenches: ArrayLike) -> tuple[Float64, Float64, Float64]:
    """Loads of both fingers without any filter.

    Args:
        wrenches: shape (2, 6) or (n, 2, 6), bias removed, as in `WrenchSample`.

    Returns:
        f_n [N], f_t [N] (magnitude) and tau_n [N·m] (the second finger's turned into the first pad's frame), each of
        shape (2,) or (n, 2).
    """
    w = np.asarray(wrenches, np.float64)
    flat = np.ascontiguousarray(w.reshape(-1, 2, 6))
    rows = np.array([[loads_of_finger(pair[0], False), loads_of_finger(pair[1], True)] for pair in flat])
    rows = rows.reshape(*w.shape[:-1], 4)
    return rows[..., 0], np.hypot(rows[..., 1], rows[..., 2]), rows[..., 3]
