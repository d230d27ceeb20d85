"""A grasp to test grip control on, which shares no code with it: two soft pads, a fruit, and LuGre bristles.

Each pad touches the fruit in a disc of rings and spokes. Every element carries its share of the normal force and its
own bristle, dz/dt = v - sigma0 |v| / mu z, and pulls with f_n (sigma0 z + sigma1 dz/dt). Nothing knows of a limit
surface: it emerges from the elements. The fruit moves in the pads' plane (x across, z up, turning by theta about the
pads' normal) and along the normal (y); it stands on a table until it is lifted. The fingers follow their speed like a
real drive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from pomona.executive.values.arrays import Float64

SAMPLE, STEP = 0.002, 1e-4
"""Of the sensor [s], and the longest step of the integration; shorter ones where the bristles' damping on a light
fruit, which grows with the normal force, would not be stable with it."""

UNSTABLE = 1.5
"""An explicit step is stable up to two over damping times mobility; the force may grow within a sample."""

RINGS, SPOKES = 6, 12
BRISTLE, BRISTLE_DAMPING = 1e4, 30.0
"""sigma0 [1/m] and sigma1 [s/m], per unit of normal force."""

GRAVITY = 9.81
PAD, PAD_DAMPING = 2000.0, 4.0
"""Stiffness [N/m] and damping [N·s/m] of one pad."""

FINGER, DRIVE, DRIVE_DAMPING = 0.58, 2e4, 219.0
"""Mass of a finger with its drive [kg], and the drive's stiffness [N/m] and damping [N·s/m]."""

TABLE, TABLE_DAMPING, TABLE_HALF, TABLE_FRICTION = 2e4, 40.0, 0.02, 0.6

# Places in the state vector.
X, Z, THETA, VX, VZ, OMEGA, Y, VY, FINGER_AT, FINGER_SPEED, SET_POINT = range(11)


@dataclass(frozen=True, slots=True)
class Fruit:
    """A fruit between two pads.

    Attributes:
        mass [kg], width [m] between the pads.
        mu: friction between fruit and pad.
        delta, gamma, k: contact radius delta * f_n**gamma [m] and shape of the pressure.
        offset: centre of mass from the grasp axis, (across, up) [m].
        off_centre: how far the fruit lies off the fingers' middle [m].
    """

    mass: float = 0.2
    width: float = 0.08
    mu: float = 0.6
    delta: float = 0.004353
    gamma: float = 0.2569
    k: float = 4.0
    offset: tuple[float, float] = (0.0, 0.0)
    off_centre: float = 0.0

    @property
    def inertia(self) -> float:
        """About the centre of mass [kg·m²], of a sphere."""
        return 0.4 * self.mass * (0.5 * self.width) ** 2


def pressure_shares(k: float) -> tuple[Float64, Float64, Float64]:
    """Elements of a contact: places (x, z) in units of its radius and shares of the normal force, each (n,)."""
    node, weight = np.polynomial.legendre.leggauss(RINGS)
    r, weight = 0.5 * (node + 1.0), 0.5 * weight
    share = weight * r * (1.0 - r**k) ** (1.0 / k)
    angle = (
        2.0 * np.pi * (np.arange(SPOKES)[None, :] + 0.5 * (np.arange(RINGS)[:, None] % 2)) / SPOKES
    )
    x, z = r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)
    shares = np.repeat(share / share.sum() / SPOKES, SPOKES)
    return x.ravel(), z.ravel(), shares


@njit(cache=True)
def _advance(state, bristles, elements, fruit, carriage, pull, command, count, step, wrenches):  # type: ignore[no-untyped-def]
    """Advance `count` steps with the gripper's height and speed given at the start, and write both pad wrenches."""
    mass, inertia, half, mu, delta, gamma, offset_x, offset_z = fruit
    height, climb, acceleration = carriage
    n = elements.shape[1]
    force = np.zeros((2, 3))
    normal = np.zeros(2)
    for _ in range(count):
        height += climb * step
        climb += acceleration * step
        state[SET_POINT] += 0.5 * command * step
        pull_x = pull[0]
        pull_z = pull[1]
        # The grasped point of the fruit, seen from its centre of mass.
        cos, sin = math.cos(state[THETA]), math.sin(state[THETA])
        arm_x = -(cos * offset_x + sin * offset_z)
        arm_z = -(-sin * offset_x + cos * offset_z)
        at_x = state[X] + arm_x
        at_z = state[Z] + arm_z - height
        v_x = state[VX] + state[OMEGA] * arm_z
        v_z = state[VZ] - state[OMEGA] * arm_x - climb
        drive = DRIVE * (state[SET_POINT] - state[FINGER_AT]) - DRIVE_DAMPING * state[FINGER_SPEED]
        total_x = pull_x
        total_z = pull_z - mass * GRAVITY
        torque = 0.0
        for i in range(2):
            side = 1.0 if i == 0 else -1.0  # pad 0 sits at -y and pushes towards +y
            pressed = half - state[FINGER_AT] - side * state[Y]
            rate = -state[FINGER_SPEED] - side * state[VY]
            f_n = max(PAD * pressed + PAD_DAMPING * rate, 0.0) if pressed > 0.0 else 0.0
            normal[i] = f_n
            rho = delta * max(f_n, 1e-3) ** gamma
            sum_x = 0.0
            sum_z = 0.0
            moment = 0.0
            for e in range(n):
                r_x = rho * elements[0, e]
                r_z = rho * elements[1, e]
                s_x = v_x + state[OMEGA] * r_z
                s_z = v_z - state[OMEGA] * r_x
                speed = math.hypot(s_x, s_z)
                b_x = bristles[i, 0, e]
                b_z = bristles[i, 1, e]
                # Implicit in the relaxation, so that fast sliding stays stable.
                relax = 1.0 + step * BRISTLE * speed / mu
                n_x = (b_x + step * s_x) / relax
                n_z = (b_z + step * s_z) / relax
                share = f_n * elements[2, e]
                p_x = -share * (BRISTLE * n_x + BRISTLE_DAMPING * (n_x - b_x) / step)
                p_z = -share * (BRISTLE * n_z + BRISTLE_DAMPING * (n_z - b_z) / step)
                bristles[i, 0, e] = n_x if f_n > 0.0 else 0.0
                bristles[i, 1, e] = n_z if f_n > 0.0 else 0.0
                sum_x += p_x
                sum_z += p_z
                moment += r_z * p_x - r_x * p_z
            force[i, 0] = sum_x
            force[i, 1] = sum_z
            force[i, 2] = moment
            total_x += sum_x
            total_z += sum_z
            torque += moment + arm_z * sum_x - arm_x * sum_z
        # The table carries the fruit at two points of its foot.
        carried = 0.0
        for side in (-1.0, 1.0):
            foot_x = side * TABLE_HALF * cos
            foot_z = -side * TABLE_HALF * sin
            depth = -(state[Z] + foot_z)
            if depth > 0.0:
                up = max(TABLE * depth - TABLE_DAMPING * (state[VZ] - state[OMEGA] * foot_x), 0.0)
                total_z += up
                torque -= foot_x * up
                carried += up
        total_x -= TABLE_FRICTION * carried * math.tanh(state[VX] / 1e-3)
        along = normal[0] - normal[1] - TABLE_FRICTION * carried * math.tanh(state[VY] / 1e-3)
        state[FINGER_SPEED] += step / FINGER * (drive + 0.5 * (normal[0] + normal[1]))
        state[FINGER_AT] += step * state[FINGER_SPEED]
        state[VX] += step * total_x / mass
        state[VZ] += step * total_z / mass
        state[VY] += step * along / mass
        state[OMEGA] += step * torque / inertia
        state[X] += step * state[VX]
        state[Z] += step * state[VZ]
        state[Y] += step * state[VY]
        state[THETA] += step * state[OMEGA]
    for i in range(2):
        side = 1.0 if i == 0 else -1.0
        # Pad frame: x down (the approach), z out of the face, y = z x x. Wrench of the fruit on the pad.
        wrenches[i, 0] = force[i, 1]
        wrenches[i, 1] = side * force[i, 0]
        wrenches[i, 2] = -normal[i]
        place_x, place_y = -at_z, -side * at_x
        wrenches[i, 3] = place_y * wrenches[i, 2]
        wrenches[i, 4] = -place_x * wrenches[i, 2]
        wrenches[i, 5] = -side * force[i, 2] + place_x * wrenches[i, 1] - place_y * wrenches[i, 0]
    return at_x, at_z


class PatchGrasp:
    """A fruit on a table between two open fingers. Heights count from where the fruit stands.

    `height`, `climb` and `acceleration` are the gripper's and may be set between steps, as may `pull`, a force on the
    fruit (across, up) [N].
    """

    def __init__(self, fruit: Fruit, opening: float | None = None, sample: float = SAMPLE) -> None:
        """Place the fruit.

        Args:
            opening: between the pads at first [m].
            sample: how long a `step` is [s].
        """
        self.fruit, self._sample = fruit, sample
        self._state = np.zeros(11)
        opening = fruit.width + 0.012 if opening is None else opening
        self._state[[FINGER_AT, SET_POINT]] = 0.5 * opening
        self._state[X] = fruit.offset[0]
        self._state[Y] = fruit.off_centre
        self._state[Z] = -0.5 * fruit.mass * GRAVITY / TABLE
        self._elements = np.array(pressure_shares(fruit.k))
        self._bristles = np.zeros((2, 2, RINGS * SPOKES))
        self._shape = (
            fruit.mass, fruit.inertia, 0.5 * fruit.width, fruit.mu, fruit.delta, fruit.gamma, *fruit.offset
        )  # fmt: skip
        self.height = (
            -fruit.offset[1] + self._state[Z]
        )  # level with the grasped point, for any shape of fruit
        self.climb = self.acceleration = 0.0
        self.pull = (0.0, 0.0)
        self.command = 0.0
        self.wrenches = np.zeros((2, 6))
        self.at = (0.0, 0.0)

    def step(self) -> Float64:
        """A sample's time passes; the true wrenches, shape (2, 6), in the pads' frames."""
        carriage = (self.height, self.climb, self.acceleration)
        count = max(round(self._sample / STEP), self._stable_steps())
        step = self._sample / count
        self.at = _advance(
            self._state, self._bristles, self._elements, self._shape, carriage, self.pull, self.command, count, step,
            self.wrenches,
        )  # fmt: skip
        self.height += self.climb * self._sample + 0.5 * self.acceleration * self._sample * (
            self._sample + step
        )
        self.climb += self.acceleration * self._sample
        return self.wrenches

    def _stable_steps(self) -> int:
        """Steps in a sample with which an explicit integration of the bristles' damping stays stable."""
        fruit = self.fruit
        damping = -BRISTLE_DAMPING * float(self.wrenches[:, 2].sum())
        mobility = 1.0 / fruit.mass + (fruit.offset[0] ** 2 + fruit.offset[1] ** 2) / fruit.inertia
        return math.ceil(UNSTABLE * damping * mobility * self._sample)

    @property
    def width(self) -> float:
        """Opening between the pads' faces [m]."""
        return 2.0 * float(self._state[FINGER_AT])

    @property
    def f_n(self) -> float:
        """True grasp force, twice the smaller finger's [N]."""
        return 2.0 * float(-self.wrenches[:, 2].max())

    @property
    def place(self) -> tuple[float, float]:
        """The grasped point of the fruit on the pads, (across, up) [m]."""
        return self.at

    @property
    def turn(self) -> float:
        """How far the fruit has turned [rad]."""
        return float(self._state[THETA])

    @property
    def off_table(self) -> bool:
        return float(self._state[Z]) > 0.002
