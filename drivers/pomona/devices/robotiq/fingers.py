"""Whether the fingers of a robot's description are those of a gripper's model: stroke, and opening when closed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pomona.devices.robotiq.driver import MODELS, RobotiqOptions
from pomona.drivers import UnusableRobotFile, read_spec
from pomona.executive import Problem

OFF = 0.01  # an opening that differs by more is another gripper's [m]: strokes of the models differ by 35 mm


def described_opening(robot: Path) -> tuple[float, float] | None:
    """Return the distance of the two pad sites with closed and with open fingers [m]; None without two pads.

    Sliding joints with a spring are soft pads, not fingers. Raises UnusableRobotFile.
    """
    import mujoco  # takes a moment

    model = read_spec(robot).compile()
    pads = [site for site in range(model.nsite) if model.site(site).name.startswith("pad_")]
    if len(pads) != 2:
        return None
    slides = (model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE) & (model.jnt_stiffness == 0.0)
    data, ends = mujoco.MjData(model), []
    for end in (0, 1):
        data.qpos[model.jnt_qposadr[slides]] = model.jnt_range[slides, end]
        mujoco.mj_kinematics(model, data)
        ends.append(float(np.linalg.norm(data.site_xpos[pads[0]] - data.site_xpos[pads[1]])))
    return ends[0], ends[1]


def other_fingers(robot: Path, options: RobotiqOptions) -> Iterator[Problem]:
    """Yield the problem of a description with other fingers; where none of the models has them it is a warning."""
    try:
        found = described_opening(robot)
    except UnusableRobotFile:  # the arm's own section reports it
        return
    if found is None:
        return
    closed, stroke, limits = found[0], found[1] - found[0], options.limits
    if abs(stroke - MODELS[options.model].stroke) > OFF:
        named = next((name for name, of in MODELS.items() if abs(stroke - of.stroke) <= OFF), "")
        words = f"the fingers in {robot} open by {1e3 * stroke:.0f} mm" + (f", as a {named}'s" if named else "")
        hint = "give the arm a description with this gripper" + (f", or 'model: {named}'" if named else "")
        own = f"those of a {options.model} by {1e3 * MODELS[options.model].stroke:.0f} mm"
        yield Problem("model", f"{words}; {own}", hint, warning=not named)
    elif abs(closed - limits.width_min) > OFF:
        words = f"the closed pads in {robot} are {1e3 * closed:.0f} mm apart, and here {1e3 * limits.width_min:.0f} mm"
        yield Problem("finger_offset", words, "measure it; both must agree", warning=True)
