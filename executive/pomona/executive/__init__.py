"""The executive runs task trees. It knows no fruit, no robot and no device.

The names below are the public API (docs/stability.md): they change only as semantic versioning allows. They are loaded
on first use, so that `import pomona.executive` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pomona.executive.behaviours import run_behaviour as run_behaviour
    from pomona.executive.errors import (
        PomonaError as PomonaError,
        SkillError as SkillError,
        UsageError as UsageError,
    )
    from pomona.executive.ports import (
        ACCELERATION as ACCELERATION,
        ANGLE as ANGLE,
        ANGULAR_SPEED as ANGULAR_SPEED,
        FORCE as FORCE,
        LENGTH as LENGTH,
        MASS as MASS,
        PRESSURE as PRESSURE,
        RATE as RATE,
        RATIO as RATIO,
        REQUIRED as REQUIRED,
        SPEED as SPEED,
        STIFFNESS as STIFFNESS,
        TIME as TIME,
        TORQUE as TORQUE,
        Acceleration as Acceleration,
        Angle as Angle,
        AngularSpeed as AngularSpeed,
        Force as Force,
        Length as Length,
        Mass as Mass,
        Outputs as Outputs,
        Port as Port,
        Pressure as Pressure,
        Quantity as Quantity,
        Rate as Rate,
        Ratio as Ratio,
        Speed as Speed,
        Stiffness as Stiffness,
        Time as Time,
        Torque as Torque,
    )
    from pomona.executive.skill import (
        Failure as Failure,
        Interrupted as Interrupted,
        Skill as Skill,
        SkillFailure as SkillFailure,
        Work as Work,
    )
    from pomona.executive.skill_testing import (
        SkillEnd as SkillEnd,
        drive as drive,
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
    "behaviours": ("run_behaviour",),
    "errors": (
        "PomonaError",
        "SkillError",
        "UsageError",
    ),
    "ports": (
        "ACCELERATION",
        "ANGLE",
        "ANGULAR_SPEED",
        "Acceleration",
        "Angle",
        "AngularSpeed",
        "FORCE",
        "Force",
        "LENGTH",
        "Length",
        "MASS",
        "Mass",
        "Outputs",
        "PRESSURE",
        "Port",
        "Pressure",
        "Quantity",
        "RATE",
        "RATIO",
        "REQUIRED",
        "Rate",
        "Ratio",
        "SPEED",
        "STIFFNESS",
        "Speed",
        "Stiffness",
        "TIME",
        "TORQUE",
        "Time",
        "Torque",
    ),
    "skill": (
        "Failure",
        "Interrupted",
        "Skill",
        "SkillFailure",
        "Work",
    ),
    "skill_testing": (
        "SkillEnd",
        "drive",
    ),
    "views": (
        "BodiesView",
        "ImageView",
        "Line2",
        "Line3",
        "Mesh3",
        "Pinhole",
        "Points3",
        "PosesView",
        "ProgressView",
        "SceneView",
        "SeriesView",
        "TableView",
    ),
}
"""Public names by the module that defines them."""

_HOMES = {name: module for module, names in PUBLIC.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'pomona.executive' has no attribute '{name}'")
    found = globals()[name] = getattr(import_module(f"pomona.executive.{_HOMES[name]}"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
