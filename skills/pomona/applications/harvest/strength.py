"""Break of a stem: the combined load in pull, twist and bend, relative to the strength of this fruit's stem."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from pomona.applications.harvest.numbers import WallNumbers
from pomona.executive import Float64


@dataclass(frozen=True, slots=True)
class Strength:
    """Strength of one fruit's stem."""

    pull: float  # at the spur [N]
    twist: float  # about the stem [N·m]
    bend: float  # across it [N·m]
    stiffness: float  # of the stem against twist and bend [N·m/rad]
    tear: float  # pull at which the stem leaves the fruit instead [N]

    def row(self) -> Float64:
        """As `used` takes it: pull [N], twist, bend [N·m], tear [N], shape (4,)."""
        return np.array([self.pull, self.twist, self.bend, self.tear])


def draw_strength(numbers: WallNumbers, rng: np.random.Generator) -> Strength:
    """Pull and twist are lognormal with a shared part; the bending strength follows from the stem's stiffness."""
    shared = np.sqrt(numbers.strength_shared)
    own = np.sqrt(1.0 - numbers.strength_shared)
    common, a, b, c = rng.standard_normal(4)
    pull = numbers.pull_median * np.exp(numbers.pull_sigma * (shared * common + own * a))
    twist = numbers.twist_median * np.exp(numbers.twist_sigma * (shared * common + own * b))
    stiffness = twist / rng.uniform(*numbers.twist_angle)
    bend = stiffness * rng.uniform(*numbers.bend_angle)
    tear = numbers.tear_median * np.exp(numbers.tear_sigma * c)
    return Strength(float(pull), float(twist), float(bend), float(stiffness), float(tear))


@numba.njit(cache=True)
def used(force: Float64, moment: Float64, strength: Float64) -> tuple[float, float]:
    """How much of a stem's strength a load uses: at the spur, and where the stem sits in the fruit. It breaks above 1.

    (F/F₀)² + (T/T₀)² + (M/M₀)² at the spur, with T about the stem and M across it; a pull alone tears the stem out.

    Args:
        force: at the spur, in the stem's frame, z along the stem away from the fruit, shape (3,) [N].
        moment: there, same frame, shape (3,) [N·m].
        strength: `Strength.row`.
    """
    pull2 = force[0] ** 2 + force[1] ** 2 + force[2] ** 2
    at_spur = (
        pull2 / strength[0] ** 2
        + (moment[2] / strength[1]) ** 2
        + (moment[0] ** 2 + moment[1] ** 2) / strength[2] ** 2
    )
    return at_spur, pull2 / strength[3] ** 2
