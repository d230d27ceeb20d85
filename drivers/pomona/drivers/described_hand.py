"""Whether the fingers of a robot's description are those of a gripper: stroke, and opening when closed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pomona.drivers.errors import UnusableRobotFile
from pomona.drivers.robot_file import read_spec
from pomona.executive.cell.registration import Surroundings
from pomona.executive.values.sections import Problem

OFF = 0.01  # an opening that differs by more is another gripper's [m]: strokes of the hands differ by 17 mm or more
HAND_STROKES = {
    "hand-e": 0.050,
    "2f-85": 0.085,
    "2f-140": 0.140,
    "WSG 32": 0.068,
    "WSG 50-110": 0.110,
    "WSG 50-210": 0.210,
}
"""Of hands [m], by their data sheets."""
PADS = "on each finger add a site in the middle of its pad: <site name='pad_left'/>, <site name='pad_right'/>"


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
    data = mujoco.MjData(model)
    ends = []
    for end in (0, 1):
        data.qpos[model.jnt_qposadr[slides]] = model.jnt_range[slides, end]
        mujoco.mj_kinematics(model, data)
        ends.append(float(np.linalg.norm(data.site_xpos[pads[0]] - data.site_xpos[pads[1]])))
    return ends[0], ends[1]


def other_fingers(around: Surroundings, own: str, closed: float) -> Iterator[Problem]:
    """Yield the problem of a description with other fingers; where no known hand has them it is a warning.

    One without pads cannot be compared, which is a warning as well: grasps and ways know no opening of its fingers.

    Args:
        own: the gripper, as `HAND_STROKES` names it, or the first word of several.
        closed: distance of its pads when it is closed [m].
    """
    for robot in dict.fromkeys(getattr(said, "robot", None) for said in around.options.values()):
        if not isinstance(robot, Path):
            continue
        try:
            found = described_opening(robot)
        except UnusableRobotFile:  # the arm's own section reports it
            continue
        if found is None:
            words = f"{robot} has no two sites 'pad_…', so its fingers are not compared with those of a {own}"
            yield Problem("", f"{words}, and plans know no opening of them", PADS, warning=True)
            continue
        stroke = found[1] - found[0]
        near = [name for name, of in HAND_STROKES.items() if abs(stroke - of) <= OFF]
        if not any(name.startswith(own) for name in near):
            words = f"the fingers in {robot} open by {1e3 * stroke:.0f} mm"
            hint = "give the arm a description with this gripper"
            if near:
                words += f", as a {near[0]}'s"
                hint += f", or take a {near[0]} here"
            ways = " or ".join(
                f"{1e3 * of:.0f}" for name, of in HAND_STROKES.items() if name.startswith(own)
            )
            yield Problem("", f"{words}; those of a {own} by {ways} mm", hint, warning=not near)
        elif abs(found[0] - closed) > OFF:
            words = f"the closed pads in {robot} are {1e3 * found[0]:.0f} mm apart, and here {1e3 * closed:.0f} mm"
            yield Problem("finger_offset", words, "measure it; both must agree", warning=True)
