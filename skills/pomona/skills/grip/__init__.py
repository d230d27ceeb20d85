"""Grip control with the minimum force that holds a fruit of unknown weight.

Usable alone on arrays: `limit_surface`, `least_force` (limit_surface.py), and `GripController`
(controller.py), stepped by samples.

The names below are public, and loaded on first use.
"""

from typing import TYPE_CHECKING

from pomona.executive.values.public_names import on_first_use

if TYPE_CHECKING:
    from pomona.skills.grip.controller import GripController as GripController, warm_up as warm_up
    from pomona.skills.grip.grip import GripPhase as GripPhase, GripProblem as GripProblem
    from pomona.skills.grip.hold import Hold as Hold, take_over as take_over
    from pomona.skills.grip.limit_surface import (
        SoftContact as SoftContact,
        surface_table as surface_table,
    )
    from pomona.skills.grip.settings import (
        ForceLoopSettings as ForceLoopSettings,
        GripSettings as GripSettings,
        WatchSettings as WatchSettings,
    )

PUBLIC = {
    "controller": "GripController warm_up",
    "grip": "GripPhase GripProblem",
    "hold": "Hold take_over",
    "limit_surface": "SoftContact surface_table",
    "settings": "ForceLoopSettings GripSettings WatchSettings",
}
"""Public names by the module that defines them."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = on_first_use(__name__, PUBLIC)
