"""Services of a cell with a robot: workspace, cameras, state of the hand, measurements for the record, score."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from pomona.drivers.device import ConnectContext
from pomona.drivers.estimate import estimate_errors
from pomona.drivers.hand_memory import HandMemory, HandRecord
from pomona.drivers.hold_watch import HoldWatch
from pomona.drivers.interfaces import Arm, ArmLimits, Camera, Cameras, DepthCamera, ForceSensor, Gripper, Hand
from pomona.drivers.readings import Readings
from pomona.drivers.workspace import WorkspaceSection
from pomona.executive.cell import device
from pomona.executive.cell.registration import Settings, Wired
from pomona.executive.cell.services import Services
from pomona.executive.lease import viewed
from pomona.executive.values.findings import Findings
from pomona.executive.values.sections import Placed
from pomona.executive.values.yaml_nodes import YamlMapping

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


class RobotServices(Services):
    """Follows the hand of a cell, and gives skills its workspace and cameras."""

    context, section = ConnectContext, WorkspaceSection

    def __init__(self, devices: Mapping[str, device.Device], workspace: object | None = None) -> None:
        super().__init__(devices, workspace)
        arm, fingers, gripper = (self._first(interface) for interface in (Arm, ForceSensor, Gripper))
        memory = getattr(gripper if fingers is None else fingers, "hand_memory", None)
        if memory is None and gripper is not None and not gripper.outlives:
            memory = HandMemory(None, HandRecord())  # of a new world, which ends with this process
        self._hand = HoldWatch(arm, fingers, gripper, memory)
        self._readings: Readings | None = None

    @classmethod
    def judge(cls, placed: Placed[Any], facts: Iterable[object], findings: Findings) -> None:
        """Named poses must be reachable by the cell's arm, as far as its limits are known."""
        limits = next((fact for fact in facts if isinstance(fact, ArmLimits)), None)
        node = placed.node.get("workspace")
        poses = node.get("poses") if isinstance(node, YamlMapping) else None
        workspace = placed.values.workspace
        if limits is None or workspace is None or not isinstance(poses, YamlMapping):
            return
        for name, joints in workspace.poses.items():
            q = np.array(joints)
            if q.shape != limits.lower.shape or np.any((q < limits.lower) | (q > limits.upper)):
                words = f"the pose '{name}' needs {limits.lower.size} joints within the arm's limits"
                findings.error(poses.entries[name][1], "pose", words)

    @classmethod
    def connected(cls, settings: Mapping[str, Settings[Any]], context: device.ConnectContext) -> RobotServices:
        """Give a gripper without force sensor the memory of its hand, which is empty in a cell that was cleared."""
        assert isinstance(context, ConnectContext)
        gripper: Any = context.find(Gripper)
        if gripper is not None and context.find(ForceSensor) is None and gripper.outlives:
            said = settings[gripper.name].values
            wires = said.wires if isinstance(said, Wired) else (str(context.cell.resolve()), gripper.name)
            gripper.hand_memory = context.hand_memory(wires)
            if context.cleared:
                gripper.hand_memory.keep_hand("", gripper.state().width)
        return cls(context.devices, context.workspace)

    def find(self, interface: type) -> Any:
        if interface is Hand:
            return self._hand
        if interface is Cameras:
            seeing: Any = [device for device in self.devices.values() if Camera in device.interfaces]
            return Cameras(tuple(viewed(c, DepthCamera if isinstance(c, DepthCamera) else Camera) for c in seeing))
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

    def score(self, truth: Mapping[str, object], reported: Mapping[str, Any]) -> Mapping[str, object]:
        """Errors of the run's estimate of the fruit's position and size are part of the score."""
        fruits = truth.get("fruits", ())
        scored = {name: what for name, what in truth.items() if name != "fruits"}
        scored |= estimate_errors(reported, fruits if isinstance(fruits, Sequence) else ())
        return {name: scored[name] for name in dict.fromkeys((*COUNTS_MOST, *scored)) if name in scored}

    def close(self) -> None:
        if self._readings is not None:
            self._readings.close()

    def _first(self, interface: type) -> Any:
        return next((device for device in self.devices.values() if interface in device.interfaces), None)
