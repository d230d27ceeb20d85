"""Options in cell files for a camera on the arm or in the cell, of any connection."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.drivers import DepthModel, DepthModelSection, depth_model_of
from pomona.executive import (
    TIME,
    Float64,
    Measure,
    PathTo,
    Problem,
    Section,
    is_rigid,
    read_plain_text,
    value,
)


class UnusableHandEye(ValueError):
    """A file that holds no pose of a camera."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountedCameraFile:
    """Where a streaming camera sits, how much its depth errs, and when it counts as lost."""

    hand_eye: Path = value(
        PathTo("file", "make it with `pomona calibrate hand-eye`"),
        help="pose of the camera in its mount; `pomona calibrate hand-eye` makes the file",
    )
    depth_model: DepthModelSection | None = value(
        Section(DepthModelSection), None, "how the depth errs; without it as a RealSense D4xx"
    )
    silence: float = value(
        Measure(TIME, "50 ms", "10 s"),
        "500 ms",
        "without an image for this long the camera is lost",
    )

    def problems(self) -> Iterator[Problem]:
        try:
            read_hand_eye(self.hand_eye)
        except UnusableHandEye as error:
            yield Problem("hand_eye", str(error), "make it with `pomona calibrate hand-eye`")

    @property
    def depth_errs(self) -> DepthModel:
        """Error model of its depth: the file's, or the nominal one."""
        return depth_model_of(self.depth_model)


def read_hand_eye(path: Path) -> Float64:
    """T_mount_camera (4, 4) [m], from the file that `pomona calibrate hand-eye` writes.

    Raises UnusableHandEye: it holds no pose.
    """
    try:
        T = np.array(json.loads(read_plain_text(path))["T_mount_camera"], dtype=np.float64)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise UnusableHandEye(f"{path} holds no 'T_mount_camera': {error}") from error
    if not is_rigid(T):
        raise UnusableHandEye(f"'T_mount_camera' in {path} is no rigid 4 x 4 transform")
    # A camera is within this distance of the flange or base that carries it [m]; in millimetres it would be far beyond
    if np.linalg.norm(T[:3, 3]) > 5.0:
        raise UnusableHandEye(
            f"'T_mount_camera' in {path} is {np.linalg.norm(T[:3, 3]):.3g} m long: it is in metres"
        )
    return T
