"""SlipAvoidGrasp: the least force that holds, with no knowledge of the weight.

Usable alone on arrays: `limit_surface`, `least_force`, `grasp_force` (limit_surface.py), `observe_slip` (observer.py),
`dynamic_force` (dynamic_term.py), `pad_loads` (pads.py), and `GripController` (controller.py), stepped by samples.
"""
