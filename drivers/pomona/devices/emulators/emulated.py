"""Emulated devices of a simulated cell, found by entry point: the wires of each, and its fault switches.

A package adds one by an `EmulatorKind` in the entry point group `pomona.emulators`; the cell file names it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from pomona.devices.emulators.server import Emulator
from pomona.drivers import Cell, FaultSwitch
from pomona.executive import Float64

if TYPE_CHECKING:
    from pomona.tools.simulation import SimWorld

GROUP = "pomona.emulators"
JUMP = 0.6
"""Step of the first joint's feedback by the fault `jump` [rad]."""


@dataclass(frozen=True, slots=True)
class EmulatedWire:
    """A place where a driver finds a device.

    Attributes:
        name: of its switch for faults of the wire, after the device's: "motion_wire".
        address: HOST:PORT or the path of a serial port.
        clients: that are served at a time.
    """

    name: str
    address: str
    emulator: Emulator
    clients: int = 1


@dataclass(frozen=True, slots=True)
class EmulatedDevice:
    """A device of a simulated cell.

    Attributes:
        advance: called with the time [s] in each step of the world.
        switches: for faults of the device, by the end of their names: "" is the device's own.
    """

    wires: tuple[EmulatedWire, ...]
    advance: Callable[[float], None]
    switches: Mapping[str, FaultSwitch] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class EmulatorKind:
    """An entry point.

    Attributes:
        addresses: of the device's wires, from its address in the cell file.
        make: builds the device in a simulated cell, for these addresses.
    """

    addresses: Callable[[str], tuple[str, ...]]
    make: Callable[[Cell, tuple[str, ...]], EmulatedDevice]


@lru_cache(maxsize=1)
def kinds() -> tuple[str, ...]:
    """Return the names of all kinds of emulators."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def kind_of(name: str) -> EmulatorKind:
    """Return the kind with this name, which is one of `kinds`."""
    kind: EmulatorKind = next(iter(entry_points(group=GROUP, name=name))).load()
    return kind


def world_of(cell: Cell) -> SimWorld:
    """Return the world of a simulated cell."""
    return cast("SimWorld", cell.devices["world"])


class OwnTime:
    """Time of a controller, which may go slower than the world's.

    Attributes:
        rate: its seconds in a second of the world.
    """

    def __init__(self) -> None:
        self.rate = 1.0
        self._then: float | None = None
        self._behind = 0.0

    def at(self, now: float) -> float:
        """Return the controller's time at a time of the world [s], which never goes back."""
        if self._then is not None:
            self._behind += (1.0 - self.rate) * (now - self._then)
        self._then = now
        return now - self._behind


class Joints(Protocol):
    """The arm behind the controller, joints in the wire's order."""

    def measured(self) -> tuple[Float64, Float64]:
        """Return positions [rad] and velocities [rad/s], shape (dof,)."""

    def drive(self, q: Float64, qd: Float64) -> None:
        """The set-point of now."""


class EmulatedArm(FaultSwitch):
    """An emulated controller of an arm, with the faults of its joints.

    Faults: `stuck` (the joints stand still while the controller's model moves); `frozen` (reports the same for ever);
    `nan`, `wild`, `jump` (implausible feedback).
    """

    known_faults: tuple[str, ...] = ("stuck", "frozen", "nan", "wild", "jump")

    def __init__(self, joints: Joints) -> None:
        super().__init__()
        self._joints = joints
        self._frozen = joints.measured()
        self._q = self._frozen[0]
        self._qd = np.zeros_like(self._q)

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        self._frozen = self._joints.measured()

    def clear_fault(self) -> None:
        """As the base; freed joints stay where they are."""
        if self.fault == "stuck":
            self._halt()
        super().clear_fault()

    def _halt(self) -> None:
        """Take the joints where they are for the model."""
        self._q, self._qd = self._joints.measured()[0], np.zeros_like(self._qd)

    def _drive(self, q: Float64, qd: Float64) -> None:
        if self.fault != "stuck":
            self._joints.drive(q, qd)

    def measured(self) -> tuple[Float64, Float64]:
        """Return the reported positions [rad] and velocities [rad/s], shape (dof,) each."""
        q, qd = self._joints.measured()
        match self.fault:
            case "frozen":
                return self._frozen
            case "nan":
                return np.full_like(q, np.nan), qd
            case "wild":
                return np.full_like(q, 1e30), qd
            case "jump":
                return q + JUMP * np.eye(len(q))[0], qd
        return q, qd


class SimJoints:
    """The simulated arm's joints as an emulated controller drives them: position set-points with feed-forward."""

    def __init__(self, world: SimWorld) -> None:
        model = world.model
        self._state = world.state
        self._actuators = world.arm_actuators
        self._qpos = model.jnt_qposadr[world.arm_joints]
        self._qvel = model.jnt_dofadr[world.arm_joints]
        kp = model.actuator_gainprm[self._actuators, 0]
        kv = -model.actuator_biasprm[self._actuators, 2]
        self._feed_forward = kv / kp

    def measured(self) -> tuple[Float64, Float64]:
        return self._state.qpos[self._qpos].copy(), self._state.qvel[self._qvel].copy()

    def drive(self, q: Float64, qd: Float64) -> None:
        self._state.ctrl[self._actuators] = np.asarray(q) + self._feed_forward * qd
