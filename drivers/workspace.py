"""The `workspace:` of a cell file: table, mapped volume, fixed obstacles and named poses, in the base frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.cell_file import Settings
from drivers.interfaces import Box, Workspace

Float64 = NDArray[np.float64]


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
        obstacles=tuple(box for obstacle in settings.sections("obstacles") for box in _read_obstacle(obstacle)),
        poses=_read_poses(settings.section("poses")) if settings.has("poses") else {},
    )
    settings.finish()
    return workspace


def _read_obstacle(settings: Settings) -> tuple[Box, ...]:
    """A solid box; with `wall` a crate: open at the top, floor and walls of that thickness, its size the outer one."""
    T_base_box = np.eye(4)
    T_base_box[:3, 3] = settings.vector("centre", 3, "length")
    yaw = settings.number("yaw", "angle", 0.0)
    T_base_box[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    size = settings.vector("size", 3, "length")
    if np.any(size <= 0.0):
        raise settings.error("a box has three positive sizes", "size")
    name = settings.text("name")
    if not settings.has("wall"):
        settings.finish()
        return (_box(name, T_base_box, np.zeros(3), size),)
    wall = settings.number("wall", "length", low=1e-4)
    if np.any(2.0 * wall >= size[:2]) or wall >= size[2]:
        raise settings.error("the walls of a crate leave room between them", "wall")
    settings.finish()
    return _crate(name, T_base_box, size, wall)


def _crate(name: str, T_base_crate: Float64, size: Float64, wall: float) -> tuple[Box, ...]:
    """Floor, then walls, all of one name."""
    x, y, z = size
    middle = (x - wall) / 2.0, (y - wall) / 2.0
    return (
        _box(name, T_base_crate, np.array([0.0, 0.0, (wall - z) / 2.0]), np.array([x, y, wall])),
        *(_box(name, T_base_crate, np.array([side * middle[0], 0.0, 0.0]), np.array([wall, y, z])) for side in (-1, 1)),
        *(_box(name, T_base_crate, np.array([0.0, side * middle[1], 0.0]), np.array([x, wall, z])) for side in (-1, 1)),
    )


def _box(name: str, T_base_whole: Float64, offset: Float64, size: Float64) -> Box:
    """A part of something whose pose is given, `offset` from its centre."""
    T_base_box = T_base_whole.copy()
    T_base_box[:3, 3] += T_base_whole[:3, :3] @ offset
    return Box(name, T_base_box, (float(size[0]) / 2.0, float(size[1]) / 2.0, float(size[2]) / 2.0))


def _read_poses(settings: Settings) -> dict[str, Float64]:
    return {name: settings.vector(name, None, "angle") for name in settings.names()}
