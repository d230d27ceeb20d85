"""Frames that skills use are checked: sizes by `Frame` itself, depth and the camera's pose here."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Annotated
from weakref import WeakKeyDictionary

import numpy as np

from pomona.drivers.interfaces import Frame, Workspace
from pomona.executive.skill import Skill, SkillFailure, Work
from pomona.executive.values.arrays import Float64
from pomona.executive.values.units import Array
from pomona.skills.geometry import angle_between
from pomona.skills.perception.frame_check import (
    FrameProblem,
    frame_problem,
    frame_view,
    pose_problem,
)

KEPT = 12  # number of earlier poses of each camera that stale depth is compared with
# poses nearer to each other than this are one [m, rad]
APART = 5e-3
TURNED = np.radians(0.5)

Poses = deque[tuple[float, Float64]]
_EARLIER: WeakKeyDictionary[object, dict[str, Poses]] = WeakKeyDictionary()


def earlier_poses(skill: Skill, frame: Frame) -> Poses:
    """Times [s] and poses of a frame's camera at earlier frames of this run."""
    return _EARLIER.setdefault(skill.context, {}).setdefault(frame.label, deque(maxlen=KEPT))


def note_pose(skill: Skill, frame: Frame, T_base_camera: Float64) -> None:
    """Remember where the camera was, for `earlier_poses`."""
    poses = earlier_poses(skill, frame)
    if poses:
        before = poses[-1][1]
        apart = float(np.linalg.norm(before[:3, 3] - T_base_camera[:3, 3]))
        if apart < APART and angle_between(before[:3, :3], T_base_camera[:3, :3]) < TURNED:
            return
    poses.append((frame.stamp, T_base_camera))


def require_true_look(
    skill: Skill, frame: Frame, T_base_camera: Float64, workspace: Workspace
) -> Work[None]:
    """Compare a look with the table, its colour and earlier poses, beside the tick.

    Raises SkillFailure: POSE_MISMATCH or DEPTH_MISMATCH, which the skill must declare.
    """
    earlier = tuple(earlier_poses(skill, frame))
    problem = yield from skill.compute(frame_problem, frame, T_base_camera, workspace, earlier)
    note_pose(skill, frame, T_base_camera)
    if problem is not None:
        raise mismatch(skill, frame, problem)


def require_sound_pose(
    skill: Skill, frame: Frame, T_base_camera: Float64, workspace: Workspace
) -> None:
    """Compare the table in a depth image with the cell file's; takes 2 ms.

    Raises SkillFailure: POSE_MISMATCH or DEPTH_MISMATCH, which the skill must declare.
    """
    view = frame_view(frame, T_base_camera, workspace)
    if view is not None and not view.sound:
        earlier = tuple(earlier_poses(skill, frame))
        problem = frame_problem(frame, T_base_camera, workspace, earlier) or pose_problem(view)
        assert problem is not None
        raise mismatch(skill, frame, problem)
    note_pose(skill, frame, T_base_camera)


@dataclass(frozen=True, slots=True, eq=False)
class DoubtedLook:
    """A look that shows the table elsewhere than the cell file has it: it shows how far the camera's pose is off."""

    table: Annotated[Float64, Array(2, 4)]  # `SeenTable.planes`
    T_mount_camera: Annotated[Float64, Array(4, 4)]  # the camera in its mount
    on_arm: bool  # True: the mount is the arm's flange, else the base frame


def mismatch(skill: Skill, frame: Frame, problem: FrameProblem) -> SkillFailure:
    """Return the failure of a skill whose frame has a problem."""
    camera = frame.label
    planes = problem.planes
    if planes is not None:
        skill.publish(
            "doubted_look", DoubtedLook(planes, frame.T_mount_camera, frame.q is not None)
        )
    return skill.failure(
        problem.code, f"{camera or 'camera'}: {problem.message}", camera=camera, **problem.data
    )
