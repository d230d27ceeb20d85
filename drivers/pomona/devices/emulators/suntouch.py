"""A force/tactile finger that speaks its bytes: a wrench on the pad becomes 25 voltages."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pomona.devices.emulators.server import Peer
from pomona.executive import Float64

TAXELS = 25
STEPS = 4096 / 3.3  # of the converter [1/V]
SPREAD = 0.006  # width of the dent that a contact makes [m]
NOISE = 4e-4  # of every taxel [V]: half a step of the converter. No live sensor repeats a value.


class Pad:
    """A soft pad over 5 × 5 taxels: an invented, smooth model, not that of a real finger.

    The normal force makes a dent around the centre of pressure; shear and torsion drag the skin, which every taxel sees
    from its own direction; every taxel has its own gain and saturates.
    """

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 25])
        grid = (np.arange(5) - 2.0) * 0.004  # distance of neighbouring taxels [m]
        self._x, self._y = (axis.ravel() for axis in np.meshgrid(grid, grid, indexing="ij"))
        self.rest = rng.uniform(1.2, 1.8, TAXELS)  # voltages without contact, shape (25,) [V]
        self._gain = rng.uniform(0.8, 1.2, TAXELS)
        self._drag = rng.uniform(-1.0, 1.0, (TAXELS, 3)) * (0.06, 0.06, 12.0)

    def volts(self, wrench: Float64) -> Float64:
        """Voltages, shape (25,) [V], under a wrench in the pad's frame, shape (6,) [N, N·m]."""
        fx, fy, fz, tx, ty, tz = wrench
        pressing = max(-fz, 0.0)
        # The moment of the normal force about the pad's centre; softened so that a grazing contact has a centre too.
        cx = float(np.clip(ty / (pressing + 0.2), -0.01, 0.01))
        cy = float(np.clip(-tx / (pressing + 0.2), -0.01, 0.01))
        dent = np.exp(-0.5 * (((self._x - cx) / SPREAD) ** 2 + ((self._y - cy) / SPREAD) ** 2))
        depth = 0.12 * pressing * dent + self._drag @ (fx, fy, tz)
        volts: Float64 = self.rest + 1.1 * np.tanh(self._gain * depth / 1.1)
        return volts


def encode(volts: Float64) -> bytes:
    """Return the bytes of an answer; voltages, shape (25,) [V], are rounded and clipped to 12 bits."""
    return np.clip(np.rint(volts * STEPS), 0, 4095).astype("<u2").tobytes()


class SunTouchEmulator:
    """One finger: answers every request with the voltages of the present wrench.

    Attributes:
        silent: the cable is pulled.
        drop_bytes: number of bytes of the next answer that get lost.
        spike: added to a taxel of the next answer [V].
        restless: jump of a taxel with every answer [V].
        stuck: the answer does not change.
        dead: every taxel reads 0 V.
        held: number of successive answers with one measurement.
    """

    def __init__(self, wrench: Callable[[], Float64], seed: int = 0) -> None:
        self.pad = Pad(seed)
        self.silent = False
        self.drop_bytes = 0
        self.spike = self.restless = 0.0
        self.stuck = self.dead = False
        self.held = 1
        self._answers = 0
        self._wrench = wrench
        self._rng = np.random.default_rng([seed, 26])
        self._said = np.zeros(TAXELS)

    def connected(self, peer: Peer) -> None:
        """Nothing to do: the finger speaks when it is asked."""

    def disconnected(self, peer: Peer) -> None:
        """Nothing to do either."""

    def received(self, peer: Peer, chunk: bytes) -> None:
        for _ in range(chunk.count(b"a")):
            if not self.silent:
                peer.send(self._answer())

    def advance(self, now: float) -> None:
        """The finger has no time of its own."""

    def _answer(self) -> bytes:
        if self.dead:
            volts = np.zeros(TAXELS)
        elif self.stuck or self._answers % self.held:
            volts = self._said
        else:
            volts = self.pad.volts(self._wrench()) + self._rng.normal(0.0, NOISE, TAXELS)
            volts[12] += self.spike + self.restless
            self.restless = -self.restless
        self._said = volts
        self._answers += 1
        answer = encode(volts)[self.drop_bytes :]
        self.spike = 0.0
        self.drop_bytes = 0
        return answer


def random_wrenches(count: int, seed: int) -> Float64:
    """Wrenches that a grasp makes, shape (count, 6): 0–9 N normal, shear and torsion within friction, all wandering."""
    rng = np.random.default_rng([seed, 6])
    walk = np.cumsum(rng.normal(size=(count, 6)), axis=0)
    unit = np.sin(0.3 * walk + rng.uniform(0.0, 6.0, 6))
    pressing = 9.0 * np.clip(0.5 + 0.55 * unit[:, 2], 0.0, 1.0)
    centre = 0.006 * unit[:, 3:5]
    wrenches = np.empty((count, 6))
    wrenches[:, 0] = 0.75 * pressing * unit[:, 0]
    wrenches[:, 1] = 0.75 * pressing * unit[:, 1]
    wrenches[:, 2] = -pressing
    wrenches[:, 3] = -centre[:, 1] * pressing
    wrenches[:, 4] = centre[:, 0] * pressing
    wrenches[:, 5] = 0.004 * pressing * unit[:, 5]
    return wrenches
