"""The executive runs task trees. It knows no fruit, no robot and no device.

The names below are the public API (docs/stability.md): they change only as semantic versioning allows. They are loaded
on first use, so that `import pomona.executive` costs nothing.
"""

from typing import TYPE_CHECKING

from pomona.executive.values.public_names import on_first_use

if TYPE_CHECKING:
    from pomona.executive.behaviours import run_behaviour as run_behaviour
    from pomona.executive.cell.cell import Cell as Cell
    from pomona.executive.cell.cell_file import read_cell_file as read_cell_file
    from pomona.executive.cell.cell_piece import CellPiece as CellPiece
    from pomona.executive.cell.connect import load_cell as load_cell
    from pomona.executive.cell.device import (
        ConnectContext as ConnectContext,
        Device as Device,
        FaultSwitch as FaultSwitch,
        World as World,
        paced as paced,
        stamped as stamped,
    )
    from pomona.executive.cell.errors import (
        CellFileError as CellFileError,
        DeviceError as DeviceError,
        DeviceFault as DeviceFault,
        DeviceLost as DeviceLost,
        DriverError as DriverError,
        MotionRefused as MotionRefused,
        StopFailed as StopFailed,
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
    from pomona.executive.clock import (
        Clock as Clock,
        ManualClock as ManualClock,
        SystemClock as SystemClock,
    )
    from pomona.executive.errors import (
        PomonaError as PomonaError,
        SkillError as SkillError,
        UsageError as UsageError,
    )
    from pomona.executive.execute import (
        Executed as Executed,
        RunOrder as RunOrder,
        run_tree as run_tree,
    )
    from pomona.executive.files import find_cell as find_cell, find_tree as find_tree
    from pomona.executive.lease import command as command
    from pomona.executive.palette import OVERLAY as OVERLAY
    from pomona.executive.ports import (
        REQUIRED as REQUIRED,
        Acceleration as Acceleration,
        Angle as Angle,
        AngularSpeed as AngularSpeed,
        Force as Force,
        Length as Length,
        Mass as Mass,
        Outputs as Outputs,
        Port as Port,
        Pressure as Pressure,
        Rate as Rate,
        Ratio as Ratio,
        Speed as Speed,
        Time as Time,
        Torque as Torque,
    )
    from pomona.executive.run_views import RunView as RunView, ViewedRun as ViewedRun
    from pomona.executive.running.events import (
        AttemptEnded as AttemptEnded,
        ErrorRaised as ErrorRaised,
        Event as Event,
        NodeChanged as NodeChanged,
        OperatorActed as OperatorActed,
        PortWritten as PortWritten,
        Published as Published,
        RunEnded as RunEnded,
        RunStarted as RunStarted,
        SafeStopped as SafeStopped,
        StateChanged as StateChanged,
        TreeChanged as TreeChanged,
    )
    from pomona.executive.running.runner import Runner as Runner
    from pomona.executive.running.signals import raise_again as raise_again
    from pomona.executive.running.starting import Starting as Starting
    from pomona.executive.skill import (
        CellFacts as CellFacts,
        Computation as Computation,
        Failure as Failure,
        Interrupted as Interrupted,
        Skill as Skill,
        SkillFailure as SkillFailure,
        Work as Work,
    )
    from pomona.executive.skill_testing import SkillEnd as SkillEnd, drive as drive
    from pomona.executive.values.archives import (
        ArchiveTooLarge as ArchiveTooLarge,
        open_archive as open_archive,
        read_plain_arrays as read_plain_arrays,
    )
    from pomona.executive.values.arrays import Float64 as Float64, UInt8 as UInt8
    from pomona.executive.values.documents import ValueFile as ValueFile
    from pomona.executive.values.findings import (
        Finding as Finding,
        format_finding as format_finding,
    )
    from pomona.executive.values.image_bytes import is_cut_off as is_cut_off
    from pomona.executive.values.installation import install_extra as install_extra
    from pomona.executive.values.kinds import (
        AsWritten as AsWritten,
        Counts as Counts,
        Flag as Flag,
        MappingOf as MappingOf,
        Measure as Measure,
        Number as Number,
        OrWord as OrWord,
        PathTo as PathTo,
        Span as Span,
        Text as Text,
        Whole as Whole,
        Words as Words,
        choose as choose,
    )
    from pomona.executive.values.pictures import (
        UnusablePicture as UnusablePicture,
        decode_picture as decode_picture,
        decode_plane as decode_plane,
        is_lfs_pointer as is_lfs_pointer,
        read_picture as read_picture,
        read_plane as read_plane,
        write_picture as write_picture,
    )
    from pomona.executive.values.plain_text import (
        NoTableError as NoTableError,
        is_file as is_file,
        read_plain_text as read_plain_text,
        read_table as read_table,
    )
    from pomona.executive.values.read_only import ReadOnly as ReadOnly
    from pomona.executive.values.rotations import is_rigid as is_rigid
    from pomona.executive.values.sections import (
        Problem as Problem,
        Section as Section,
        value as value,
    )
    from pomona.executive.values.units import (
        ACCELERATION as ACCELERATION,
        ANGLE as ANGLE,
        ANGULAR_SPEED as ANGULAR_SPEED,
        FORCE as FORCE,
        LENGTH as LENGTH,
        MASS as MASS,
        PRESSURE as PRESSURE,
        RATE as RATE,
        RATIO as RATIO,
        SPEED as SPEED,
        STIFFNESS as STIFFNESS,
        TIME as TIME,
        TORQUE as TORQUE,
        Quantity as Quantity,
    )
    from pomona.executive.values.yaml_nodes import (
        YamlMapping as YamlMapping,
        YamlNode as YamlNode,
        YamlScalar as YamlScalar,
    )
    from pomona.executive.views import (
        BodiesView as BodiesView,
        ImageView as ImageView,
        Line2 as Line2,
        Line3 as Line3,
        Mesh3 as Mesh3,
        Pinhole as Pinhole,
        Points3 as Points3,
        PosesView as PosesView,
        ProgressView as ProgressView,
        SceneView as SceneView,
        SeriesView as SeriesView,
        TableView as TableView,
    )

PUBLIC = {
    "behaviours": "run_behaviour",
    "cell.cell": "Cell",
    "cell.cell_file": "read_cell_file",
    "cell.cell_piece": "CellPiece",
    "cell.connect": "load_cell",
    "cell.device": "ConnectContext Device FaultSwitch World paced stamped",
    "cell.errors": "CellFileError DeviceError DeviceFault DeviceLost DriverError MotionRefused StopFailed",
    "cell.owner": "Address Link Malformed Nonsense Owner TcpLink Watchdog raise_priority tcp_opener",
    "cell.registration": "Driver NoOptions Settings Surroundings driver read_section_file",
    "clock": "Clock ManualClock SystemClock",
    "errors": "PomonaError SkillError UsageError",
    "execute": "Executed RunOrder run_tree",
    "files": "find_cell find_tree",
    "lease": "command",
    "palette": "OVERLAY",
    "ports": (
        "Acceleration Angle AngularSpeed Force Length Mass Outputs Port Pressure REQUIRED Rate Ratio Speed "
        "Time Torque"
    ),
    "run_views": "RunView ViewedRun",
    "running.events": (
        "AttemptEnded ErrorRaised Event NodeChanged OperatorActed PortWritten Published RunEnded RunStarted "
        "SafeStopped StateChanged TreeChanged"
    ),
    "running.runner": "Runner",
    "running.signals": "raise_again",
    "running.starting": "Starting",
    "skill": "CellFacts Computation Failure Interrupted Skill SkillFailure Work",
    "skill_testing": "SkillEnd drive",
    "values.archives": "ArchiveTooLarge open_archive read_plain_arrays",
    "values.arrays": "Float64 UInt8",
    "values.documents": "ValueFile",
    "values.findings": "Finding format_finding",
    "values.image_bytes": "is_cut_off",
    "values.installation": "install_extra",
    "values.kinds": "AsWritten Counts Flag MappingOf Measure Number OrWord PathTo Span Text Whole Words choose",
    "values.pictures": (
        "UnusablePicture decode_picture decode_plane is_lfs_pointer read_picture read_plane write_picture"
    ),
    "values.plain_text": "NoTableError is_file read_plain_text read_table",
    "values.read_only": "ReadOnly",
    "values.rotations": "is_rigid",
    "values.sections": "Problem Section value",
    "values.units": (
        "ACCELERATION ANGLE ANGULAR_SPEED FORCE LENGTH MASS PRESSURE Quantity RATE RATIO SPEED STIFFNESS TIME TORQUE"
    ),
    "values.yaml_nodes": "YamlMapping YamlNode YamlScalar",
    "views": (
        "BodiesView ImageView Line2 Line3 Mesh3 Pinhole Points3 PosesView ProgressView SceneView SeriesView TableView"
    ),
}
"""Public names by the module that defines them."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = on_first_use(__name__, PUBLIC)
