"""A fruit on a stem that breaks by the law of the simulated wall, between two soft pads of a hand."""

from __future__ import annotations

import numpy as np

from pomona.applications.harvest.reachable import grasp_pose
from pomona.applications.harvest.strength import used

G, DT, LEVER = 9.81, 0.02, 0.0548
MASS, DIAMETER = 0.18, 0.076
PAD_STIFFNESS = 1000.0
STRONG = np.array([1e3, 1e3, 1e3, 1e3])
WEAK = np.array([40.0, 0.25, 0.10, 60.0])
"""Pull [N], twist, bend [N·m] and tear [N]: the wall's medians, but for a bend that breaks at 72° here."""


class Stem:
    """A fruit that hangs at a point below its knuckle; the knuckle is on a spring, the stem a bending spring."""

    def __init__(self, strength=WEAK, branch=150.0, bending=0.08, lag=0.08, mass=MASS):
        self.T = grasp_pose(np.array([0.0, -0.6, 0.4]), 0.0, 0.0, 0.0)
        self.rest = self.T[:3, 3] + [0.0, 0.0, LEVER]
        self.strength, self.branch, self.bending, self.lag = strength, branch, bending, lag
        self.diameter, self.mass = DIAMETER, mass
        self.width, self.roll, self.broken, self.time = DIAMETER + 0.02, 0.0, None, 0.0
        self.T_aimed = self.T.copy()
        self.gone = self.saturated = False
        self.presses, self.stem = [], 0.0
        self.R0 = self.T[:3, :3].copy()

    def force(self):
        """Of the pads on the fruit in the base frame, and the stem's moment; nothing before they hold it."""
        if self.width > self.diameter - 2e-4:
            return np.zeros(3), 0.0
        weight = np.array([0.0, 0.0, G * self.mass])
        if self.broken is not None:
            return weight, 0.0
        up = self.T[:3, :3] @ self.R0.T @ np.array([0.0, 0.0, LEVER])
        pulled = self.branch * (self.T[:3, 3] + up - self.rest)
        return weight + pulled - np.array([0.0, 0.0, G * self.mass]), self.bending * abs(self.roll)

    def wrenches(self):
        if self.gone:
            return np.zeros((2, 6))
        squeeze = max(PAD_STIFFNESS * (self.diameter - self.width), 0.0)
        f = -self.T[:3, :3].T @ self.force()[0]  # on both pads, in the hand's frame
        if squeeze == 0.0:
            f = np.zeros(3)
        w = np.zeros((2, 6))
        w[0, :3] = 0.5 * f[2], -0.5 * f[0], -squeeze - 0.5 * f[1]
        w[1, :3] = 0.5 * f[2], 0.5 * f[0], -squeeze + 0.5 * f[1]
        w[:, 2] = np.minimum(w[:, 2], 0.0)
        self.presses.append(-w[:, 2])
        return w

    def move(self, command, dt=DT):
        """Move the set-point by a command; the hand follows it with a lag."""
        self.time += dt
        self.T_aimed = command.moved(self.T_aimed, dt)
        share = dt / (self.lag + dt)
        self.T[:3, 3] += share * (self.T_aimed[:3, 3] - self.T[:3, 3])
        left = self.T[:3, :3].T @ self.T_aimed[:3, :3]
        self.roll += share * float(np.arctan2(left[1, 0], left[0, 0]))
        c, s = np.cos(self.roll), np.sin(self.roll)
        self.T[:3, :3] = self.R0 @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        self.width += dt * command.opening
        self.load()

    def step(self, control, dt=DT):
        """Let a controller move the hand for one period."""
        self.move(
            control.step(dt, self.wrenches(), self.saturated, self.T, self.width, self.T_aimed), dt
        )

    def load(self):
        """Break the stem when its load is too much."""
        if self.broken is None:
            force, moment = self.force()
            stem = force - [0.0, 0.0, G * self.mass]
            self.stem = max(self.stem, float(np.linalg.norm(stem)))
            if used(stem, np.array([moment, 0.0, 0.0]), self.strength)[0] > 1.0:
                self.broken = self.time
