"""Grip control with the minimum force that holds a fruit of unknown weight.

Usable alone on arrays: `limit_surface`, `least_force`, `grasp_force` (limit_surface.py), `observe_slip` (observer.py),
`dynamic_force` (dynamic_term.py), `pad_loads` (pads.py), and `GripController` (controller.py), stepped by samples.
"""
