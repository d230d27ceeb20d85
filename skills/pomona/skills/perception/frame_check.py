"""Compares a frame with the table and with its own colour: is the depth this frame's, and the camera's pose true?

A table at the wrong place or tilt is evidence against one of several statements. Depth that is mirrored, or that fits
an earlier pose of the camera, is no depth of this frame (DEPTH_MISMATCH); else the camera's pose, the depth's scale or
the table's height in the cell file is wrong (POSE_MISMATCH).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pomona.drivers.interfaces import Frame, Workspace
from pomona.executive.values.arrays import Float64
from pomona.skills.perception.depth_registration import depth_elsewhere
from pomona.skills.perception.table_view import SeenTable, depth_points, frame_view, should_show_table, view_table

POSE_MISMATCH, DEPTH_MISMATCH = "POSE_MISMATCH", "DEPTH_MISMATCH"
MISMATCHES = (POSE_MISMATCH, DEPTH_MISMATCH)  # failure codes of every skill that checks its frames

FLIPS = {"left to right": (-1.0, 1.0), "top to bottom": (1.0, -1.0)}
"""How mirrored depth is mirrored back: factors of the image's columns and rows."""


@dataclass(frozen=True, slots=True)
class FrameProblem:
    """A statement of a frame that cannot be true."""

    code: str  # POSE_MISMATCH or DEPTH_MISMATCH
    message: str  # measured and allowed values, and the remedy
    data: Mapping[str, float] = field(default_factory=dict)  # the same as numbers


def frame_problem(
    frame: Frame,
    T_base_camera: Float64,
    workspace: Workspace,
    earlier: Sequence[tuple[float, Float64]] = (),
) -> FrameProblem | None:
    """Return the implausible part of a frame, or None, for the camera's stated pose, shape (4, 4).

    `earlier` are times [s] and poses of the camera at earlier frames, oldest first.
    """
    view = frame_view(frame, T_base_camera, workspace)
    missing = view is None and should_show_table(frame, T_base_camera, workspace)
    doubted = missing or (view is not None and not view.sound)
    beside = depth_elsewhere(frame, or_nowhere=doubted) if frame.colour.any() else ""
    if not doubted:
        words = f"{beside}: the depth image is not registered to colour, or of another moment"
        return FrameProblem(DEPTH_MISMATCH, f"{words}; check the camera's driver") if beside else None
    deviation = np.inf if view is None else view.deviation
    if wrong := _other_depth(frame, T_base_camera, workspace, deviation, earlier) or beside:
        shown = "the depth image does not show the table" if view is None else view.sentence
        return FrameProblem(DEPTH_MISMATCH, f"{wrong}: {shown}; check the camera's driver", _data(view))
    return None if view is None else pose_problem(view)


def pose_problem(view: SeenTable) -> FrameProblem | None:
    """Return the problem of a table that is not where the cell file has it, or None."""
    if view.sound:
        return None
    ratio = view.height_ratio
    scale = f"; depth that is {100.0 * abs(ratio):.1f} % too {'long' if ratio > 0.0 else 'short'} does the same"
    return FrameProblem(
        POSE_MISMATCH,
        f"{view.sentence}; the camera's pose or the table's height in the cell file is wrong"
        f"{scale if view.tilt < 0.5 * view.allowed_tilt else ''}. "
        "Measure the table, or run `pomona calibrate hand-eye` or `pomona calibrate depth`",
        _data(view),
    )


def _other_depth(
    frame: Frame,
    T_base_camera: Float64,
    workspace: Workspace,
    deviation: float,
    earlier: Sequence[tuple[float, Float64]],
) -> str:
    """Return words for depth of another moment or mirrored depth, where it explains the table's place; else empty."""
    assert frame.depth is not None
    assert workspace.table_z is not None
    table_z = workspace.table_z
    lens, errs = frame.intrinsics, frame.depth_model
    points = depth_points(frame.depth, lens)
    # another explanation counts where it fits this much better: the ratio of both deviations, in tolerances
    best, words = 0.5 * deviation, ""
    for name, signs in FLIPS.items():
        centre = np.array([lens.width - 1 - 2.0 * lens.cx, lens.height - 1 - 2.0 * lens.cy]) / (lens.fx, lens.fy)
        flipped = points.copy()
        for axis, sign in enumerate(signs):
            if sign < 0.0:
                flipped[:, axis] = centre[axis] * points[:, 2] - points[:, axis]
        seen = view_table(flipped, T_base_camera, table_z, lens, errs)
        if seen is not None and seen.sound and seen.deviation < best:
            best, words = seen.deviation, f"depth is mirrored {name}"
    for stamp, T in earlier:
        seen = view_table(points, T, table_z, lens, errs)
        if seen is not None and seen.sound and seen.deviation < best:
            best = seen.deviation
            words = f"depth is {frame.stamp - stamp:.2f} s old, and fits the camera's pose of that time"
    return words


def _data(view: SeenTable | None) -> dict[str, float]:
    return (
        {}
        if view is None
        else {
            "height_m": round(view.height, 4),
            "tilt_rad": round(view.tilt, 4),
            "allowed_m": round(view.allowed, 4),
            "allowed_rad": round(view.allowed_tilt, 4),
        }
    )
