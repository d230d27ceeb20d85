"""Loads of the grip from two pad wrenches, through filters that are slow for noise and fast for jumps.

A pad's frame: z out of its face (pressing is a negative force z), x along the approach, y = z x x. Both pads share x;
y and z of the second pad point against those of the first, so its tangential force and torsional moment are turned into
the first pad's frame. The torsional moment is taken about the contact's own centre, which the other two torques give.
"""

from __future__ import annotations

import numpy as np

from pomona.executive.values.numba_kernel import kernel

PAD_HALF = 0.010  # bound of the distance of a contact from the pad's centre [m]
PRESSING = 0.2  # normal force below which the contact's place is not computed [N]


LEVER_LOAD = 0.3  # tangential load below which its lever is unknown [N]

MIRROR = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Factors from the second pad's channels to the first pad's frame; pressing stays a negative force z."""


@kernel()
def loads_of_finger(w):  # type: ignore[no-untyped-def]
    """Return (f_n, f_x, f_y, tau_n) of a wrench in the first pad's frame, shape (6,)."""
    f_n = -w[2]
    x = y = 0.0
    if f_n > PRESSING:
        x = min(max(w[4] / f_n, -PAD_HALF), PAD_HALF)
        y = min(max(-w[3] / f_n, -PAD_HALF), PAD_HALF)
    return f_n, w[0], w[1], w[5] - (x * w[1] - y * w[0])


@kernel()
def smooth(raw, noise, fast, slow, smoothed, shares, expected):  # type: ignore[no-untyped-def]
    """Advance the filters by one sample and write both fingers' smoothed wrenches, all of shape (2, 6).

    The common and the differential mode of the fingers are filtered apart (rows 0 and 1 of `fast` and `slow`):
    a load comes to both fingers, and the common mode has less noise. The result is the slow filter's value plus its
    difference to the fast one, as far as that exceeds the noise. The force change predicted from commanded finger
    motion (`expected`) is fed forward, so that the filters do not lag.
    """
    fast[0, 2] -= 0.5 * expected
    slow[0, 2] -= 0.5 * expected
    fast_share, normal_share, load_share = shares
    for j in range(6):
        first = raw[0, j] - noise.bias[0, j]
        second = MIRROR[j] * (raw[1, j] - noise.bias[1, j])
        slow_share = normal_share if j == 2 else load_share
        for mode in range(2):
            value = 0.5 * (first + second) if mode == 0 else 0.5 * (first - second)
            fast[mode, j] += fast_share * (value - fast[mode, j])
            slow[mode, j] += slow_share * (value - slow[mode, j])
        alike = _beyond_noise(fast[0, j], slow[0, j], noise.band[0, j])
        apart = _beyond_noise(fast[1, j], slow[1, j], noise.band[1, j])
        smoothed[0, j] = alike + apart
        smoothed[1, j] = alike - apart


@kernel()
def _beyond_noise(fast, slow, noise):  # type: ignore[no-untyped-def]
    jump = fast - slow
    if abs(jump) <= noise:
        return slow
    return slow + jump * (1.0 - (noise / jump) ** 2)
