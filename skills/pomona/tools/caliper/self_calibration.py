"""A camera's pose file, corrected from picks between two runs, and the step back.

The file before the last correction stays beside it as FILE.before. A step back swaps both, and the runs of the picks
that had led to it are noted in the file: they lead to no correction again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.errors import UsageError
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.values.arrays import Float64
from pomona.executive.values.plain_text import read_plain_text
from pomona.executive.values.rotations import is_rigid
from pomona.tools.caliper.records import SAME_POSE

LONGEST = 1_000_000  # longest pose file that is read [bytes]
FIRST = "T_mount_camera_first"  # key: the pose before the first correction
BEFORE = "T_mount_camera_before"  # key: the pose before the last correction
RUNS = "runs"  # key: runs whose picks led to the pose
UNDONE = "undone"  # key: runs whose picks lead to no correction any more


class NotApplied(UsageError):
    """A correction that is not written; the text is the reason."""


def read_pose(path: Path) -> tuple[dict[str, Any], Float64]:
    """Return the content of a camera's pose file, and its T_mount_camera, shape (4, 4).

    Raises UsageError: it holds no pose.
    """
    try:
        content = parse_object(read_plain_text(path, LONGEST))
        T = np.array(content["T_mount_camera"], np.float64)
        first, last = (np.array(content.get(key, np.eye(4)), np.float64) for key in (FIRST, BEFORE))
        runs = {key: [str(run) for run in content.get(key, ())] for key in (UNDONE, RUNS)}
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path} holds no 'T_mount_camera': {error}") from error
    for name, pose in (("T_mount_camera", T), (FIRST, first), (BEFORE, last)):
        if pose.shape != (4, 4) or not is_rigid(pose):
            raise UsageError(f"'{name}' in {path} is no rigid 4 x 4 transform")
    return {**content, **runs}, T


def apply(path: Path, proposal: Mapping[str, Any], most: float, most_turned: float) -> None:
    """Write a proposal of `from-picks` into a camera's pose file; nothing may use the camera meanwhile.

    Args:
        most, most_turned: bounds of the way and the turn from the pose before the first correction [m, rad].

    Raises NotApplied: it is of another calibration, was undone, goes beyond the bounds, or the file is read-only;
    UsageError: the file cannot be read or written. It has not changed.
    """
    before, T = read_pose(path)
    if not _follows(proposal, T):
        raise NotApplied(f"{path}: the picks are of another pose than this file's")
    if undone := set(before[UNDONE]) & set(proposal[RUNS]):
        raise NotApplied(f"{path}: a correction from {sorted(undone)[0]} was undone")
    first, T_new = np.array(before.get(FIRST, T.tolist())), np.array(proposal["T_mount_camera"])
    way, turn = _apart(first, T_new)
    if way > most or turn > most_turned:
        words = f"it would sit {1e3 * way:.1f} mm and {np.degrees(turn):.1f}° from the first pose"
        bounds = f"'most' is {1e3 * most:g} mm, 'most_turned' {np.degrees(most_turned):.1f}°"
        raise NotApplied(f"{path}: {words}; {bounds}")
    _require_writable(path)
    _replace(before_of(path), before)
    _replace(path, {**proposal, FIRST: first.tolist(), UNDONE: sorted(before[UNDONE])})


def undo(path: Path) -> None:
    """Take the last correction back; a second call applies it again.

    Raises UsageError: there is no correction, or the file has another calibration since.
    """
    try:
        before, T_before = read_pose(before_of(path))
    except UsageError as error:
        raise UsageError(f"{path} has no correction that could be taken back: {error}") from error
    now, T_now = read_pose(path)
    if not (_follows(now, T_before) or _follows(before, T_now)):
        words = f"another calibration than that of its last correction; {before_of(path).name} is not of this one"
        raise UsageError(f"{path} has {words}")
    runs = {*before[UNDONE], *now[UNDONE], *now[RUNS]}
    _require_writable(path)
    _replace(path, {**before, UNDONE: sorted(runs)})
    _replace(before_of(path), now)


def before_of(path: Path) -> Path:
    """Return the path of the file before its last correction; it lies beside the target of a link."""
    path = path.resolve()
    return path.with_name(f"{path.name}.before")


def _follows(content: Mapping[str, Any], T: Float64) -> bool:
    """Return True where a correction has led from a pose, shape (4, 4), to this content."""
    return BEFORE in content and bool(np.abs(np.array(content[BEFORE]) - T).max() <= SAME_POSE)


def _apart(one: Float64, other: Float64) -> tuple[float, float]:
    """Return the distance of two poses [m] and the angle between them [rad]."""
    cosine = 0.5 * (float(np.trace(one[:3, :3].T @ other[:3, :3])) - 1.0)
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3])), float(
        np.arccos(np.clip(cosine, -1.0, 1.0))
    )


def _require_writable(path: Path) -> None:
    if (
        not path.stat().st_mode & 0o222
    ):  # a file that is replaced as a whole would change all the same
        raise NotApplied(f"{path} is read-only: `chmod u+w {path}` allows corrections")


def _replace(path: Path, content: Mapping[str, Any]) -> None:
    """Write a file whole or not at all, also when the power fails. Raises UsageError: it cannot be written."""
    path = path.resolve()  # the target of a link: the link stays
    beside = path.with_name(f".{path.name}.new")
    try:
        with beside.open("w", encoding="utf-8") as file:
            file.write(json.dumps(content, indent=1) + "\n")
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}") from error
