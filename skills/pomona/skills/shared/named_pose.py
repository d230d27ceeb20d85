"""Named poses and their variations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pomona.drivers.interfaces import Workspace
from pomona.executive.skill import CellFacts
from pomona.executive.values.arrays import Float64
from pomona.executive.values.kinds import choose
from pomona.executive.values.sections import Problem


def judge_pose(port: str, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
    """The pose that a port names must be among the cell's."""
    workspace, name = (None if cell is None else cell.known(Workspace)), known.get(port)
    if cell is not None and workspace is not None and name is not None and name not in workspace.poses:
        yield Problem(port, f"the cell '{cell.name}' has no pose '{name}'", choose(name, sorted(workspace.poses)))


def offered_poses(cell: CellFacts | None) -> tuple[str, ...]:
    """Return the cell's named poses, for editors."""
    workspace = None if cell is None else cell.known(Workspace)
    return () if workspace is None else tuple(sorted(workspace.poses))


def named_pose(poses: Mapping[str, Float64], name: str, variation: int = 1) -> Float64:
    """The joints of a pose: `name`, or one of its variations `name_2`, `name_3` … (starting over after the last).

    Args:
        poses: by name, shape (dof,) [rad] each.
        name: of the pose.
        variation: which one, from 1.

    Raises:
        KeyError: there is no such pose.
    """
    variations = [poses[name]]
    while (other := f"{name}_{len(variations) + 1}") in poses:
        variations.append(poses[other])
    return variations[(variation - 1) % len(variations)]
