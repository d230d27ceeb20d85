"""Devices behind Protocols: real, simulated, emulated and mock, selected by a cell file.

The names below are the public API (docs/stability.md): they change only as semantic versioning allows. They are loaded
on first use, so that `import pomona.drivers` costs nothing.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pomona.drivers.device import (
        ConnectContext as ConnectContext,
        Device as Device,
        World as World,
    )
    from pomona.drivers.errors import (
        BadTrajectory as BadTrajectory,
        CellFileError as CellFileError,
        DeviceError as DeviceError,
        DeviceFault as DeviceFault,
        DeviceLost as DeviceLost,
        DriverError as DriverError,
        FrameUnreadable as FrameUnreadable,
        MotionRefused as MotionRefused,
        StopFailed as StopFailed,
        UnusableMesh as UnusableMesh,
        UnusableRobotFile as UnusableRobotFile,
    )
    from pomona.drivers.interfaces import (
        Arm as Arm,
        ArmLimits as ArmLimits,
        ArmState as ArmState,
        Box as Box,
        Camera as Camera,
        Cameras as Cameras,
        DepthCamera as DepthCamera,
        ForceSensor as ForceSensor,
        Frame as Frame,
        FrameSequence as FrameSequence,
        FruitKinds as FruitKinds,
        Gripper as Gripper,
        GripperLimits as GripperLimits,
        GripperState as GripperState,
        Hands as Hands,
        HandTask as HandTask,
        Hull as Hull,
        Intrinsics as Intrinsics,
        Motion as Motion,
        MotionState as MotionState,
        PathWatchSettings as PathWatchSettings,
        SampleRate as SampleRate,
        SetPoints as SetPoints,
        StreamedArm as StreamedArm,
        Subscription as Subscription,
        Trajectory as Trajectory,
        Workspace as Workspace,
        WrenchSample as WrenchSample,
    )
    from pomona.drivers.registration import (
        Driver as Driver,
        NoOptions as NoOptions,
        Settings as Settings,
        driver as driver,
    )

PUBLIC = {
    "device": (
        "ConnectContext",
        "Device",
        "World",
    ),
    "registration": (
        "Driver",
        "NoOptions",
        "Settings",
        "driver",
    ),
    "errors": (
        "BadTrajectory",
        "CellFileError",
        "DeviceError",
        "DeviceFault",
        "DeviceLost",
        "DriverError",
        "FrameUnreadable",
        "MotionRefused",
        "StopFailed",
        "UnusableMesh",
        "UnusableRobotFile",
    ),
    "interfaces": (
        "Arm",
        "ArmLimits",
        "ArmState",
        "Box",
        "Camera",
        "Cameras",
        "DepthCamera",
        "ForceSensor",
        "Frame",
        "FrameSequence",
        "FruitKinds",
        "Gripper",
        "GripperLimits",
        "GripperState",
        "HandTask",
        "Hands",
        "Hull",
        "Intrinsics",
        "Motion",
        "MotionState",
        "PathWatchSettings",
        "SampleRate",
        "SetPoints",
        "StreamedArm",
        "Subscription",
        "Trajectory",
        "Workspace",
        "WrenchSample",
    ),
}
"""Public names by the module that defines them."""

# PyOpenGL selects its platform when it is first imported. All pictures are rendered off screen.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

_HOMES = {name: module for module, names in PUBLIC.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'pomona.drivers' has no attribute '{name}'")
    found = globals()[name] = getattr(import_module(f"pomona.drivers.{_HOMES[name]}"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
