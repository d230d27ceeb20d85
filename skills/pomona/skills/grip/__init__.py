"""Grip control with the minimum force that holds a fruit of unknown weight.

Usable alone on arrays: `limit_surface`, `least_force`, `grasp_force` (limit_surface.py), `observe_slip` (observer.py),
`dynamic_force` (dynamic_term.py), `pad_loads` (pads.py), and `GripController` (controller.py), stepped by samples.

The names below are public, and loaded on first use.
"""

from typing import TYPE_CHECKING

from pomona.executive.values.public_names import on_first_use

if TYPE_CHECKING:
    from pomona.skills.grip.hold import take_over as take_over

PUBLIC = {
    "hold": "take_over",
}
"""Public names by the module that defines them."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = on_first_use(__name__, PUBLIC)
