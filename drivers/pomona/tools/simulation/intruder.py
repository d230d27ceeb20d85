"""A person's hand in the simulated cell: visible to cameras, without contact forces, with a recorded minimum distance.

A world file with `intruder:` has one. It starts at the time `after:`, or when its switch is turned to `reach`. It moves
along a straight line at a constant speed, stays, and returns the same way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.executive.cell.device import FaultSwitch
from pomona.executive.values.arrays import Float64
from pomona.executive.values.kinds import Measure, OrWord, Row
from pomona.executive.values.sections import Problem, value
from pomona.executive.values.units import LENGTH, SPEED, TIME

BODY = "intruder"
PALM = (0.045, 0.020, 0.095)
FOREARM = (0.040, 0.150)
"""Half axes of the hand, an ellipsoid; radius and half length of the forearm behind it, a capsule [m]: an adult's."""
FAR = 1.0  # distances are measured up to this [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class IntruderSection:
    """A person's hand that comes into the cell."""

    start: tuple[float, ...] = value(
        Row(Measure(LENGTH, "-3 m", "3 m"), 3), help="where it waits, in the base frame"
    )
    goal: tuple[float, ...] = value(
        Row(Measure(LENGTH, "-3 m", "3 m"), 3), help="where it reaches to"
    )
    speed: float = value(Measure(SPEED, "1 mm/s", "5 m/s"), "0.5 m/s", "at which it comes and goes")
    after: float | None = value(
        OrWord(Measure(TIME, "0 s", "1 h"), "asked"),
        "asked",
        "when it comes; 'asked': when its switch is turned",
    )
    stays: float | None = value(
        OrWord(Measure(TIME, "0 s", "1 h"), "ever"), "2 s", "how long it stays there"
    )

    def problems(self) -> Iterator[Problem]:
        if np.linalg.norm(np.subtract(self.goal, self.start)) < 1e-3:
            yield Problem("goal", "it is where the hand starts", "a point at least 1 mm from there")


@dataclass(frozen=True, slots=True)
class Reach:
    """One way of the hand: from `start` to `goal`, shape (3,) [m], at `speed` [m/s], where it stays for `stays` [s]."""

    start: Float64
    goal: Float64
    speed: float
    stays: float = np.inf


class Intruder(FaultSwitch):
    """The hand of a world; switch it to `reach`, and it comes.

    Attributes:
        nearest: the smallest distance between it and the robot so far [m]; at most 1 m.
        nearest_moving: the same while the robot moved.
    """

    known_faults = ("reach",)

    def __init__(
        self, mujoco: Any, model: Any, state: Any, arm_dofs: Any, said: IntruderSection
    ) -> None:
        super().__init__()
        self._mujoco = mujoco
        self._model = model
        self._state = state
        self._dofs = arm_dofs
        body = model.body(BODY)
        self._mocap = int(body.mocapid[0])
        self._geoms = [int(body.geomadr[0]) + i for i in range(int(body.geomnum[0]))]
        self._robot = _robot_geoms(model)
        stays = np.inf if said.stays is None else said.stays
        self._reach = Reach(np.array(said.start), np.array(said.goal), said.speed, stays)
        self._after: float | None = said.after
        self._since: float | None = None
        self._place(self._reach.start)
        mujoco.mj_kinematics(model, state)  # who looks before the first step sees it there
        self.forget()

    def forget(self) -> None:
        """Measure the smallest distances anew."""
        self.nearest = self.nearest_moving = FAR

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        self._since = float(self._state.time)

    def clear_fault(self) -> None:
        """It is gone at once."""
        super().clear_fault()
        self._since = None
        self._place(self._reach.start)

    def send(self, reach: Reach) -> None:
        """Let it come now, on another way."""
        self._reach = reach
        self.inject_fault("reach")

    def step(self) -> None:
        """Move it to where it is now; called in every step of the world."""
        now = float(self._state.time)
        if self._since is None and self._after is not None and now >= self._after:
            self._after = None
            self.inject_fault("reach")
        if self._since is None:
            return
        reach = self._reach
        length = float(np.linalg.norm(reach.goal - reach.start))
        way = reach.speed * (now - self._since)
        if way > length:
            way = max(length - max(way - length - reach.speed * reach.stays, 0.0), 0.0)
        self._place(reach.start + way / length * (reach.goal - reach.start))

    def measure(self) -> None:
        """How near it is to the robot now; called a hundred times a second."""
        if self._since is None:
            return
        distance = FAR
        line = np.zeros(6)
        for own in self._geoms:
            for geom in self._robot:
                away = self._mujoco.mj_geomDistance(
                    self._model, self._state, own, geom, distance, line
                )
                distance = min(distance, float(away))
        self.nearest = min(self.nearest, distance)
        if (
            np.abs(self._state.qvel[self._dofs]).max() > 0.02
        ):  # speed of the joints below which the robot rests [rad/s]
            self.nearest_moving = min(self.nearest_moving, distance)

    def truth(self) -> dict[str, object]:
        """Return its entries of the report [mm]."""
        return {
            "intruder_distance_mm": round(1e3 * self.nearest, 1),
            "intruder_distance_moving_mm": round(1e3 * self.nearest_moving, 1),
        }

    def _place(self, position: Float64) -> None:
        along = self._reach.goal - self._reach.start
        quaternion = np.zeros(4)
        self._mujoco.mju_quatZ2Vec(quaternion, along / np.linalg.norm(along))
        self._state.mocap_pos[self._mocap] = position
        self._state.mocap_quat[self._mocap] = quaternion


def add_intruder(mujoco: Any, spec: Any) -> None:
    """The hand's body: it looks along its z axis, and touches nothing."""
    body = spec.worldbody.add_body(name=BODY, mocap=True)
    ghost = {"contype": 0, "conaffinity": 0, "rgba": [0.80, 0.60, 0.50, 1.0], "mass": 0.0}
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, size=list(PALM), **ghost)
    radius, half = FOREARM
    behind = -(PALM[2] + half)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[radius, half, 0.0],
        pos=[0.0, 0.0, behind],
        **ghost,
    )


def _robot_geoms(model: Any) -> list[int]:
    """Everything of the robot that moves and can touch."""
    joints = {int(model.jnt_bodyid[joint]) for joint in model.actuator_trnid[:, 0] if joint >= 0}
    robot = set(joints)
    for body in range(model.nbody):
        if int(model.body_parentid[body]) in robot:
            robot.add(body)
    return [
        g
        for g in range(model.ngeom)
        if int(model.geom_bodyid[g]) in robot and model.geom_contype[g]
    ]
