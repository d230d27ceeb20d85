"""Grasp candidates on the paper's sphere around a fruit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.units import ANGLE, LENGTH, Array
from pomona.skills.perception.measured_fruit import MeasuredFruit

Pose = Annotated[Float64, Array(4, 4)]


@dataclass(frozen=True, slots=True, eq=False)
class Grasp:
    """One candidate: poses of the gripper's centre point (TCP) before and at the grasp."""

    index: int  # number of the candidate on the sphere, in the sampling's own order
    theta: Annotated[float, ANGLE]  # theta, alpha: the paper's angles [rad]
    alpha: Annotated[float, ANGLE]
    # T_base_pre_grasp, T_base_grasp: poses of the TCP; z approach, y sliding direction of the fingers
    T_base_pre_grasp: Pose
    T_base_grasp: Pose
    width: Annotated[float, LENGTH]  # opening to approach with [m]
    # joint solutions of the pre-grasp that are free of collision, shape (n, dof) [rad], best first
    q_pre_grasp: Float64
    clearance: Annotated[float, LENGTH]  # distance from the nearest obstacle over the approach [m]
    oblique: Annotated[float, ANGLE]  # angle at which the pads meet the skin [rad]; 0 is square
    fruit: MeasuredFruit  # the fruit to grasp

    @property
    def sentence(self) -> str:
        """Description for the operator."""
        theta, alpha = np.degrees((self.theta, self.alpha))
        return f"θ {theta:.0f}°, α {alpha:.0f}°, {self.width * 1e3:.0f} mm open, {self.clearance * 1e3:.0f} mm clear"


@dataclass(frozen=True, slots=True)
class RuledOut:
    """A candidate that was ruled out, and why: a code such as UNREACHABLE or IN_COLLISION and a sentence."""

    index: int
    theta: Annotated[float, ANGLE]
    alpha: Annotated[float, ANGLE]
    code: str
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class GraspCandidates:
    """The remaining candidates, best first, and the excluded ones."""

    grasps: tuple[Grasp, ...]
    ruled_out: tuple[RuledOut, ...]
    attempt: int


# a fruit within this distance of the last one is the same [m]: less than half a fruit
SAME_PLACE = 0.04


Direction = tuple[
    float, float
]  # tilt and azimuth of an approach, rounded [rad]: the name of a candidate


def direction(grasp: Grasp) -> Direction:
    """Return the direction from which a candidate approaches."""
    return round(grasp.theta, 6), round(grasp.alpha, 6)


class Tried:
    """Remembers attempts at one fruit, and forgets them for the next."""

    def __init__(self) -> None:
        self._fruit: MeasuredFruit | None = None
        self._candidates: set[Direction] = set()
        self.attempt = 0

    @property
    def directions(self) -> frozenset[Direction]:
        """Where this fruit was approached from."""
        return frozenset(self._candidates)

    def begin(self, fruit: MeasuredFruit) -> None:
        """A new attempt at a fruit begins."""
        if self._fruit is None or not same_fruit(self._fruit, fruit):
            self._candidates.clear()
            self.attempt = 0
        self._fruit = fruit
        self.attempt += 1

    def add(self, grasp: Grasp) -> None:
        """A candidate was tried; one of another fruit does not count."""
        if self._fruit is not None and same_fruit(self._fruit, grasp.fruit):
            self._candidates.add(direction(grasp))


def same_fruit(one: MeasuredFruit, other: MeasuredFruit) -> bool:
    """Return True if two measurements are of one fruit: the same kind at the same place."""
    apart = np.linalg.norm(one.T_base_fruit[:3, 3] - other.T_base_fruit[:3, 3])
    return one.fruit.name == other.fruit.name and bool(apart < SAME_PLACE)
