"""Services of a cell with a robot: workspace, cameras, state of the hand, measurements for the record, score."""

from __future__ import annotations

import contextlib
import itertools
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.drivers.errors import DriverError
from pomona.drivers.hold_watch import HandMemory, HandRecord, HoldWatch, memory_of
from pomona.drivers.interfaces import (
    Arm,
    ArmLimits,
    Camera,
    Cameras,
    DepthCamera,
    ForceSensor,
    Gripper,
    Hand,
    LoadSensor,
    PressSensor,
    Workspace,
)
from pomona.drivers.workspace import WorkspaceSection
from pomona.executive.cell import device
from pomona.executive.cell.device import Device
from pomona.executive.cell.registration import Settings, Wired
from pomona.executive.cell.services import Services
from pomona.executive.lease import viewed
from pomona.executive.values.findings import Findings
from pomona.executive.values.sections import Placed
from pomona.executive.values.yaml_nodes import YamlMapping


@dataclass(slots=True)
class ConnectContext(device.ConnectContext):
    """Context of a connection: see `pomona.executive.cell.device.ConnectContext`.

    Attributes:
        hand: memory of an emulated world's hand; None where the hand is real.
    """

    workspace: Workspace | None = None
    hand: HandMemory | None = None

    def hand_memory(self, wires: Iterable[str]) -> HandMemory:
        """Return the memory of the hand at the end of these wires."""
        return memory_of(wires) if self.hand is None else self.hand


def estimate_errors(
    reported: Mapping[str, Any], fruits: Sequence[Mapping[str, Any]]
) -> dict[str, float]:
    """Return errors of a reported position and size against the fruit that lies nearest to it.

    Args:
        reported: facts of the estimate: `position_m`, shape (3,), in the base frame, and `dimensions_m`, shape (3,).
        fruits: the world's: `T_base_fruit_at_look`, shape (4, 4), and `dimensions_m`.

    Returns:
        position error, its vertical part (the paper's centroid error, positive when the estimate is too low), the norm
        of the dimensions' error (the paper's dimensional error), the error of the mean width, all [mm]; empty when
        nothing was reported.
    """
    if "position_m" not in reported or "dimensions_m" not in reported or not fruits:
        return {}
    position = np.asarray(reported["position_m"], dtype=np.float64)
    size = np.asarray(reported["dimensions_m"], dtype=np.float64)
    centres = np.array([np.asarray(fruit["T_base_fruit_at_look"])[:3, 3] for fruit in fruits])
    nearest = int(np.argmin(np.linalg.norm(centres - position, axis=1)))
    true_size = np.asarray(fruits[nearest]["dimensions_m"], dtype=np.float64)
    offset = position - centres[nearest]
    return {
        "position_error_mm": 1e3 * float(np.linalg.norm(offset)),
        "centroid_error_mm": -1e3 * float(offset[2]),
        "size_error_mm": 1e3 * float(np.linalg.norm(size - true_size)),
        "width_error_mm": 1e3 * float(size[[0, 2]].mean() - true_size[[0, 2]].mean()),
    }


WRENCH = ("force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm")

MOST = 5000  # maximum number of samples of one device between two calls of `take`: ten seconds at 500 Hz


class Readings:
    """Subscribes to the fingers, and notes arm and gripper whenever it is asked to."""

    def __init__(self, devices: Mapping[str, Device]) -> None:
        self._arms = {name: device for name, device in devices.items() if Arm in device.interfaces}
        self._grippers = {
            name: device for name, device in devices.items() if Gripper in device.interfaces
        }
        feeling = {ForceSensor, LoadSensor, PressSensor}
        self._fingers = {
            name: device for name, device in devices.items() if feeling & {*device.interfaces}
        }
        self._noted: dict[str, deque[Any]] = {
            name: deque(maxlen=MOST) for name in (*self._arms, *self._grippers, *self._fingers)
        }
        sensors: Any = self._fingers
        self._subscriptions = [
            sensor.subscribe(self._noted[name].append) for name, sensor in sensors.items()
        ]

    def note(self) -> None:
        """Read arm and gripper once; this uses their last states and does not wait."""
        moving: Any
        for name, moving in (*self._arms.items(), *self._grippers.items()):
            noted = self._noted[name]
            with contextlib.suppress(
                DriverError
            ):  # the record does not decide whether a silent device ends the run
                state = moving.state()
                if not noted or noted[-1].stamp != state.stamp:
                    noted.append(state)

    def take(self) -> dict[str, dict[str, Any]]:
        """Return the measurements since the last call, by device and quantity.

        Every device gives `stamp_s` on the cell's clock, arms joints and velocities, grippers their width, fingers
        force and torque of each in its pad's frame, load sensors those
        on the flange; shape (n,) each, the name carries the unit.
        """
        taken = {
            name: [noted.popleft() for _ in range(len(noted))]
            for name, noted in self._noted.items()
        }
        return {name: self._columns(name, samples) for name, samples in taken.items() if samples}

    def close(self) -> None:
        """Listen no more."""
        for subscription in self._subscriptions:
            subscription.close()

    def _columns(self, name: str, samples: list[Any]) -> dict[str, Any]:
        columns = {"stamp_s": np.array([sample.stamp for sample in samples])}
        if name in self._arms:
            q, qd = (
                np.array(rows).T
                for rows in zip(*((sample.q, sample.qd) for sample in samples), strict=True)
            )
            columns |= {f"q_{k + 1}_rad": joint for k, joint in enumerate(q)}
            return columns | {f"qd_{k + 1}_rad_per_s": joint for k, joint in enumerate(qd)}
        if name in self._grippers:
            return columns | {"width_m": np.array([sample.width for sample in samples])}
        wrenches = np.array([sample.wrenches for sample in samples])
        parts = ("finger_1", "finger_2") if wrenches.shape[1] == 2 else ("hand",)
        for row, where in enumerate(parts):
            columns |= {f"{where}_{part}": wrenches[:, row, k] for k, part in enumerate(WRENCH)}
        return columns


COUNTS_MOST = (
    "lifted",
    "put_away",
    "drops",
    "lost",
    "collisions",
    "slip_mm",
    "finger_peak_n",
    "position_error_mm",
    "size_error_mm",
)
"""Quantities that come first in a world's score: a summary shows the first five figures that are not 0."""


def unseen_people(cell: Any) -> str:
    """Say that no camera of a cell with an arm sees a person beside it; empty if one may.

    A simulated camera rides on the hand unless it is `fixed`, another one if the arm stands above it in the file, an
    emulated one always.
    """
    arm = False
    fixed = False
    for said in cell.devices.values():
        offered = said.driver.device.interfaces
        arm |= Arm in offered
        apart = hasattr(said.values, "hand_eye") and not arm
        fixed |= Camera in offered and bool(getattr(said.values, "fixed", apart))
    if not arm or (fixed and cell.workspace is not None and cell.workspace.watch is not None):
        return ""
    return "no fixed camera watches the paths: nobody beside, behind or above the arm is noticed"


class RobotServices(Services):
    """Follows the hand of a cell, and gives skills its workspace and cameras."""

    context = ConnectContext
    section = WorkspaceSection

    def __init__(
        self, devices: Mapping[str, device.Device], workspace: object | None = None
    ) -> None:
        super().__init__(devices, workspace)
        offered: dict[type, Any] = {i: each for each in devices.values() for i in each.interfaces}
        arm, fingers, gripper = map(offered.get, (Arm, ForceSensor, Gripper))
        memory = getattr(gripper if fingers is None else fingers, "hand_memory", None)
        if memory is None and gripper is not None and not gripper.outlives:
            memory = HandMemory(None, HandRecord())  # of a new world, which ends with this process
        self._hand = HoldWatch(arm, fingers, gripper, memory)
        self._readings: Readings | None = None

    @classmethod
    def judge(cls, placed: Placed[Any], facts: Iterable[object], findings: Findings) -> None:
        """Judge named poses by the arm's limits and each other; note that no camera can see a person.

        Refuse two devices of which a skill takes one; all cameras are seen through.
        """
        offered: dict[type, str] = {}
        for name, said in placed.values.devices.items():
            for interface in said.driver.device.interfaces:
                other = offered.setdefault(interface, name)
                if other != name and interface is not Camera:
                    findings.error(
                        said.placed.node,
                        "ambiguous",
                        f"'{other}' is a {interface.__name__}, too, and a skill takes one",
                        f"leave '{name}' or '{other}' out",
                    )
        limits = next((fact for fact in facts if isinstance(fact, ArmLimits)), None)
        node = placed.node.get("workspace")
        poses = node.get("poses") if isinstance(node, YamlMapping) else None
        workspace = placed.values.workspace
        if words := unseen_people(placed.values):
            findings.note(
                placed.place("workspace"),
                "unseen",
                words,
                "declare `workspace.watch` and a camera that does not ride on the hand",
            )
        if workspace is None or not isinstance(poses, YamlMapping):
            return
        for name, other in itertools.combinations(workspace.poses, 2):
            q = workspace.poses[name]
            if (
                name.rstrip("0123456789_") == other.rstrip("0123456789_")
                and len(q) == len(workspace.poses[other])
                and np.allclose(q, workspace.poses[other], 0.0, 1e-3)
            ):
                findings.warning(
                    poses.entries[other][1],
                    "pose",
                    f"the pose '{other}' is the same as '{name}': two places, or two looks, are one",
                )
        if limits is None:
            return
        for name, joints in workspace.poses.items():
            q = np.array(joints)
            words = (
                ""
                if q.shape == limits.lower.shape
                else f"has {q.size} joints, the arm has {limits.lower.size}"
            )
            for k in () if words else np.flatnonzero((q < limits.lower) | (q > limits.upper))[:1]:
                low, high = np.degrees((limits.lower[k], limits.upper[k]))
                words = f"has joint {k + 1} at {np.degrees(q[k]):.1f}°, its limits are {low:.1f}° and {high:.1f}°"
            if words:
                findings.error(poses.entries[name][1], "pose", f"the pose '{name}' {words}")

    @classmethod
    def connected(
        cls, settings: Mapping[str, Settings[Any]], context: device.ConnectContext
    ) -> RobotServices:
        """Give a gripper without force sensor the memory of its hand, which is empty in a cell that was cleared."""
        assert isinstance(context, ConnectContext)
        gripper: Any = context.find(Gripper)
        if gripper is not None and context.find(ForceSensor) is None and gripper.outlives:
            said = settings[gripper.name].values
            wires = (
                said.wires
                if isinstance(said, Wired)
                else (str(context.cell.resolve()), gripper.name)
            )
            gripper.hand_memory = context.hand_memory(wires)
            if context.cleared:
                gripper.hand_memory.keep_hand("", gripper.state().width)
        return cls(context.devices, context.workspace)

    def find(self, interface: type) -> Any:
        if interface is Hand:
            return self._hand
        if interface is Cameras:
            seeing: Any = [
                device for device in self.devices.values() if Camera in device.interfaces
            ]
            return Cameras(
                tuple(
                    viewed(c, DepthCamera if isinstance(c, DepthCamera) else Camera) for c in seeing
                )
            )
        return super().find(interface)

    def at_rest(self) -> None:
        self._hand.note()

    def forget(self) -> None:
        self._hand.forget()

    def compare(self) -> None:
        self._hand.compare()

    def in_hand(self) -> str | None:
        return self._hand.in_hand()

    def gather(self) -> None:
        if self._readings is not None:
            self._readings.note()

    def readings(self) -> Mapping[str, Mapping[str, Any]]:
        if self._readings is None:
            self._readings = Readings(self.devices)
        return self._readings.take()

    def score(
        self, truth: Mapping[str, object], reported: Mapping[str, Any]
    ) -> Mapping[str, object]:
        """Errors of the run's estimate of the fruit's position and size are part of the score."""
        fruits = truth.get("fruits", ())
        scored = {name: what for name, what in truth.items() if name != "fruits"}
        scored |= estimate_errors(reported, fruits if isinstance(fruits, Sequence) else ())
        return {
            name: scored[name] for name in dict.fromkeys((*COUNTS_MOST, *scored)) if name in scored
        }

    def close(self) -> None:
        if self._readings is not None:
            self._readings.close()
