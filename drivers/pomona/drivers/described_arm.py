"""Whether a robot's description is that of a model: the distances between the axes of its successive joints.

Neither frames, names nor the posture change these distances, and calibrated arms differ by a few millimetres. Within a
vendor's models one distance at least differs by 53 mm; between UR15 and UR30 it is 13 mm, which is a warning.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from pomona.drivers.robot_file import read_spec
from pomona.executive.values.arrays import Float64
from pomona.executive.values.sections import Problem

# a distance that differs by more is doubtful; another arm's [m]
DOUBT = 0.01
OFF = 0.02
PARALLEL = 0.1  # sine of the angle below which two axes count as parallel: 6°


def axis_distances(robot: Path, dof: int) -> Float64:
    """Return the distance between each joint's axis and the next one's, shape (dof - 1,) [m].

    Parallel axes: from the next joint's place. Raises UnusableRobotFile.
    """
    import mujoco  # takes a moment

    model = read_spec(robot).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    driven = [i for i in range(model.nu) if model.actuator(i).name != "gripper"]
    joints = np.sort(model.actuator_trnid[driven, 0])[:dof]
    along = data.xaxis[joints]
    between = np.diff(data.xanchor[joints], axis=0)
    normal = np.cross(along[:-1], along[1:])
    sine = np.linalg.norm(normal, axis=1)
    skew = np.abs(np.einsum("ij,ij->i", normal, between)) / np.maximum(sine, PARALLEL)
    apart: Float64 = np.where(
        sine < PARALLEL, np.linalg.norm(np.cross(along[:-1], between), axis=1), skew
    )
    return apart


def other_model(
    robot: Path, lengths: Mapping[str, tuple[float, ...]], model: str
) -> Iterator[Problem]:
    """Yield the problem of a description that is not that of `model`; one without known lengths is not compared.

    Raises UnusableRobotFile.
    """
    if model not in lengths:
        return
    found = axis_distances(robot, len(lengths[model]) + 1)
    off = {name: _difference(found, of) for name, of in lengths.items()}
    if off[model] > DOUBT:
        named = next((name for name in off if off[name] <= DOUBT), "")
        shape = f"{_shown(found)} mm apart" + (f", as in a {named}" if named else "")
        doubtful = off[model] <= OFF
        words = f"{robot} {'may be' if doubtful else 'is'} no description of a {model}: its joints' axes are {shape}"
        hint = f"give that of a {model}" + (f", or 'model: {named}'" if named else "")
        yield Problem("robot", f"{words}, not {_shown(lengths[model])} mm", hint, warning=doubtful)


def _difference(found: Float64, of: tuple[float, ...]) -> float:
    """Return the largest difference of two arms' distances [m]; infinite for another number of joints."""
    return float(np.abs(found - of).max()) if len(found) == len(of) else np.inf


def _shown(lengths: Float64 | tuple[float, ...]) -> str:
    return ", ".join(f"{1e3 * length:.0f}" for length in lengths)
