"""Devices behind Protocols: real, simulated, emulated and mock, selected by a cell file.

The names below are the public API (docs/stability.md): they change only as semantic versioning allows. They are loaded
on first use, so that `import pomona.drivers` costs nothing.
"""

import os
from typing import TYPE_CHECKING

from pomona.executive.values.public_names import on_first_use

if TYPE_CHECKING:
    from pomona.drivers.base.knot_maker import KnotMaker as KnotMaker
    from pomona.drivers.base.parallel_gripper import (
        ParallelGripper as ParallelGripper,
        SpeedOrder as SpeedOrder,
        Stop as Stop,
        Wanted as Wanted,
        WidthOrder as WidthOrder,
    )
    from pomona.drivers.base.position_gripper import PositionGripper as PositionGripper
    from pomona.drivers.camera_options import IntrinsicsSection as IntrinsicsSection
    from pomona.drivers.depth_model import (
        D4XX as D4XX,
        SIMULATED as SIMULATED,
        DepthModel as DepthModel,
        DepthModelSection as DepthModelSection,
        depth_model_of as depth_model_of,
    )
    from pomona.drivers.described_arm import other_model as other_model
    from pomona.drivers.described_hand import (
        HAND_STROKES as HAND_STROKES,
        other_fingers as other_fingers,
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
    from pomona.drivers.fruit_body import HARD_MODULUS as HARD_MODULUS
    from pomona.drivers.gripper_supervisor import (
        GripperMotion as GripperMotion,
        GripperSupervision as GripperSupervision,
        GripperSupervisor as GripperSupervisor,
        allowed_speed as allowed_speed,
        require_move as require_move,
    )
    from pomona.drivers.hold_watch import (
        HandMemory as HandMemory,
        HandRecord as HandRecord,
        may_hold as may_hold,
    )
    from pomona.drivers.interfaces import (
        Arm as Arm,
        ArmLimits as ArmLimits,
        ArmState as ArmState,
        Box as Box,
        Camera as Camera,
        Cameras as Cameras,
        Carrier as Carrier,
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
        LoadSensor as LoadSensor,
        Motion as Motion,
        MotionState as MotionState,
        PadContact as PadContact,
        Pads as Pads,
        PathWatchSettings as PathWatchSettings,
        PressSensor as PressSensor,
        SampleRate as SampleRate,
        SetPoints as SetPoints,
        StreamedArm as StreamedArm,
        Subscription as Subscription,
        Trajectory as Trajectory,
        Workspace as Workspace,
        WrenchSample as WrenchSample,
        WrenchSensor as WrenchSensor,
    )
    from pomona.drivers.motion_supervisor import Supervision as Supervision
    from pomona.drivers.path_arm import (
        AT_REST as AT_REST,
        PathArm as PathArm,
        SetPointStream as SetPointStream,
        StreamingArm as StreamingArm,
        words as words,
    )
    from pomona.drivers.path_motion import PathFollower as PathFollower, PathMotion as PathMotion
    from pomona.drivers.robot_file import (
        ArmFile as ArmFile,
        read_limits as read_limits,
        read_spec as read_spec,
    )
    from pomona.drivers.rolling_path import (
        POINT_PERIOD as POINT_PERIOD,
        OutOfSetPointsError as OutOfSetPointsError,
        RollingPath as RollingPath,
        SetPoint as SetPoint,
    )
    from pomona.drivers.serial_link import (
        SerialLink as SerialLink,
        serial_opener as serial_opener,
        serial_ports as serial_ports,
    )
    from pomona.drivers.services import ConnectContext as ConnectContext
    from pomona.drivers.streamed_motion import StreamedMotion as StreamedMotion
    from pomona.drivers.streams import (
        SIDES as SIDES,
        SILENCE as SILENCE,
        Belief as Belief,
        FrameGuard as FrameGuard,
        WrenchStream as WrenchStream,
    )
    from pomona.executive.cell.cell import Cell as Cell
    from pomona.executive.cell.cell_file import read_cell_file as read_cell_file
    from pomona.executive.cell.connect import load_cell as load_cell
    from pomona.executive.cell.device import (
        Device as Device,
        FaultSwitch as FaultSwitch,
        World as World,
    )
    from pomona.executive.cell.owner import (
        Address as Address,
        Link as Link,
        Malformed as Malformed,
        Nonsense as Nonsense,
        Owner as Owner,
        TcpLink as TcpLink,
        Watchdog as Watchdog,
        raise_priority as raise_priority,
        tcp_opener as tcp_opener,
    )
    from pomona.executive.cell.registration import (
        Driver as Driver,
        NoOptions as NoOptions,
        Settings as Settings,
        Surroundings as Surroundings,
        driver as driver,
        read_section_file as read_section_file,
    )

PUBLIC = {
    "base.knot_maker": "KnotMaker",
    "base.parallel_gripper": "SpeedOrder WidthOrder ParallelGripper Stop Wanted",
    "base.position_gripper": "PositionGripper",
    "camera_options": "IntrinsicsSection",
    "depth_model": "D4XX DepthModel DepthModelSection SIMULATED depth_model_of",
    "described_arm": "other_model",
    "described_hand": "HAND_STROKES other_fingers",
    "errors": (
        "BadTrajectory CellFileError DeviceError DeviceFault DeviceLost DriverError FrameUnreadable MotionRefused "
        "StopFailed UnusableMesh UnusableRobotFile"
    ),
    "fruit_body": "HARD_MODULUS",
    "gripper_supervisor": "GripperMotion GripperSupervision GripperSupervisor allowed_speed require_move",
    "hold_watch": "HandMemory HandRecord may_hold",
    "interfaces": (
        "Arm ArmLimits ArmState Box Camera Cameras Carrier DepthCamera ForceSensor Frame FrameSequence FruitKinds "
        "Gripper GripperLimits GripperState HandTask Hands Hull Intrinsics LoadSensor Motion MotionState PadContact "
        "Pads PathWatchSettings PressSensor SampleRate SetPoints StreamedArm Subscription Trajectory Workspace "
        "WrenchSample WrenchSensor"
    ),
    "motion_supervisor": "Supervision",
    "path_arm": "AT_REST PathArm SetPointStream StreamingArm words",
    "path_motion": "PathFollower PathMotion",
    "pomona.executive.cell.cell": "Cell",
    "pomona.executive.cell.cell_file": "read_cell_file",
    "pomona.executive.cell.connect": "load_cell",
    "pomona.executive.cell.device": "Device FaultSwitch World",
    "pomona.executive.cell.owner": "Address Link Malformed Nonsense Owner TcpLink Watchdog raise_priority tcp_opener",
    "pomona.executive.cell.registration": "Driver NoOptions Settings Surroundings driver read_section_file",
    "robot_file": "ArmFile read_limits read_spec",
    "rolling_path": "OutOfSetPointsError POINT_PERIOD RollingPath SetPoint",
    "serial_link": "SerialLink serial_opener serial_ports",
    "services": "ConnectContext",
    "streamed_motion": "StreamedMotion",
    "streams": "Belief FrameGuard SIDES SILENCE WrenchStream",
}
"""Public names by the module that defines them."""

# PyOpenGL selects its platform when it is first imported. All pictures are rendered off screen.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

if not TYPE_CHECKING:
    __getattr__, __dir__ = on_first_use(__name__, PUBLIC)
