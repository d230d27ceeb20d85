"""The `workspace:` of a cell file: table, mapped volume, fixed obstacles and named poses, in the base frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.cell_file import Settings
from drivers.interfaces import Box, Workspace


def read_workspace(settings: Settings) -> Workspace:
    """Read the section.

    Raises:
        CellFileError: a value is missing or wrong.
    """
    lower, upper = settings.vector("lower", 3, "length"), settings.vector("upper", 3, "length")
    if np.any(lower >= upper):
        raise settings.error("workspace.upper must lie above workspace.lower in x, y and z", "upper")
    workspace = Workspace(
        table_z=settings.number("table_z", "length") if settings.has("table_z") else None,
        lower=lower,
        upper=upper,
        obstacles=tuple(_read_box(box) for box in settings.sections("obstacles")),
        poses=_read_poses(settings.section("poses")) if settings.has("poses") else {},
    )
    settings.finish()
    return workspace


def _read_box(settings: Settings) -> Box:
    T_base_box = np.eye(4)
    T_base_box[:3, 3] = settings.vector("centre", 3, "length")
    yaw = settings.number("yaw", "angle", 0.0)
    T_base_box[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    size = settings.vector("size", 3, "length")
    if np.any(size <= 0.0):
        raise settings.error("a box has three positive sizes", "size")
    box = Box(settings.text("name"), T_base_box, (size[0] / 2.0, size[1] / 2.0, size[2] / 2.0))
    settings.finish()
    return box


def _read_poses(settings: Settings) -> dict[str, NDArray[np.float64]]:
    return {name: settings.vector(name, None, "angle") for name in settings.names()}
