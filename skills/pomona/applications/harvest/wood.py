"""Wood as a chain of hinges: where they stand, how stiff they are, and how the chain gives way.

A branch of length L is cut into N elements of length h; each element's bending is gathered in a pair of hinges at its
middle, of stiffness E·I/h there. The chain's deflection is then the beam's up to terms of h².
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.executive import Float64

GRAVITY = 9.81


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """A branch along one line."""

    length: float  # [m]
    modulus: float  # Young's [Pa]
    diameters: tuple[float, float]  # at the base and at the tip, between which it tapers evenly [m]
    hinges: Float64  # distances of the hinge pairs from the base, shape (n,) [m]
    stiffness: Float64  # of each pair's hinges, shape (n,) [N·m/rad]

    def diameter(self, s: float | Float64) -> Float64:
        """At distances from the base [m], in their shape [m]."""
        base, tip = self.diameters
        return np.asarray(base + (tip - base) * np.asarray(s) / self.length)

    def mass(self, density: float, start: float, end: float) -> float:
        """Of a part between two distances from the base, as a truncated cone [kg]."""
        a, b = (float(self.diameter(s)) / 2.0 for s in (start, end))
        return density * np.pi * (end - start) * (a * a + a * b + b * b) / 3.0

    def deflection(self, at: Float64, loaded: Float64, forces: Float64) -> Float64:
        """Of the chain across its line, under small forces across it: shape (len(at),) [m].

        Args:
            at: distances from the base where the deflection is wanted [m].
            loaded: distances where the forces act [m]; forces: [N].
        """
        levers = np.maximum(loaded[None, :] - self.hinges[:, None], 0.0)
        angles = (levers @ forces) / self.stiffness
        deflected: Float64 = np.maximum(at[:, None] - self.hinges[None, :], 0.0) @ angles
        return deflected

    def first_frequency(self, loaded: Float64, masses: Float64) -> float:
        """Of its first mode under point masses [rad/s]: Rayleigh's quotient with the shape under their weight."""
        y = self.deflection(loaded, loaded, GRAVITY * masses)
        return float(np.sqrt(GRAVITY * (masses @ y) / (masses @ y**2)))


def second_moment(diameter: float | Float64) -> Float64:
    """Of a round section's area, about a diameter [m⁴], in the shape of `diameter`."""
    return np.asarray(np.pi / 64.0 * np.asarray(diameter) ** 4)


def hinge_chain(length: float, diameters: tuple[float, float], modulus: float, count: int) -> Chain:
    """Return a branch as `count` hinge pairs at the middles of as many elements."""
    h = length / count
    hinges = np.asarray((np.arange(count) + 0.5) * h, np.float64)
    base, tip = diameters
    across: Float64 = np.asarray(base + (tip - base) * hinges / length, np.float64)
    return Chain(length, modulus, diameters, hinges, modulus * second_moment(across) / h)


def spur_stiffness(length: float, diameter: float, modulus: float) -> float:
    """Of one hinge pair at a spur's base that gives way at its tip as the spur does: 3·E·I/L [N·m/rad]."""
    return float(3.0 * modulus * second_moment(diameter) / length)


def bending_stress(moment: float, diameter: float) -> float:
    """Return the largest stress in a round section under a bending moment [Pa]."""
    return float(32.0 * moment / (np.pi * diameter**3))
