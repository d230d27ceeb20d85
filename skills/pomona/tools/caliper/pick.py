"""One pick as a measurement: where and how wide the fingers felt a fruit, against the camera's measurement of it.

Two more events measure the camera. A finger that lands on a fruit on the approach shows, coarsely, how far the fruit
lies beside its measured place. A look that was doubted shows the table, and no fruit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.rotations import is_rigid

# relative difference of felt and measured width above which another thing was felt
MOST_UNLIKE = 0.2
LEAST_PART = 0.5  # felt width relative to the measured one below which the fingers felt each other
# distance of the felt from the measured skin above which another thing was felt [m]
MOST_APART = 0.05
BESIDE = 2.5e-3
"""Felt width below the measured one by more than errors of 3 % in depth and three of size explain [m]: the pads, 20 mm
wide, closed beside the widest section of a fruit that lies more than 10 mm off across the fingers."""
LONGEST = 10.0  # no touch is farther from the camera, or wider [m]


KINDS = {
    "touches": "PickTouches",
    "doubted_look": "DoubtedLook",
}  # topics of a record, and the types of their values
NO_WAY = 1e-6  # length of a way that has no direction [m]


class UnusableTouches(ValueError):
    """Touches that no calibration can be compared with; the text is the reason."""


@dataclass(frozen=True, slots=True, eq=False)
class Pick:
    """One pick, in the frame of the camera as the cell had it: x right, y down, z along the view.

    A look without a fruit has a table alone: its axis is 0, its place lies on the table, and it has no widths.
    """

    name: str  # of its run, with the time of the touches
    axis: Float64  # unit vector from the right to the left finger, shape (3,)
    place: Float64  # centre of the fruit as the camera measured it, shape (3,) [m]
    across: float  # its measured width along the fingers [m]
    side: int  # finger that touched first: 1 left, -1 right, 0 unknown (a plain gripper); 1 where it landed
    # place: the skin's distance from the measured skin, outwards, at the first touch [m]; NaN where `side` is 0
    first: float
    wider: float  # felt minus measured width [m]; NaN where only one finger touched, and of a plain gripper
    T_mount_camera: Float64  # the camera in its mount, shape (4, 4)
    on_arm: bool  # the mount is the arm's flange
    up: Float64  # the base frame's z axis, shape (3,)
    # the table as that look shows it, and as the cell file has it: normal and offset n · p + d = 0, shape (2, 4)
    table: Float64 | None = None
    # True: a finger landed on the fruit on the approach; `axis` leads from the skin to it, `first` is the distance
    landed: bool = False

    @property
    def is_look(self) -> bool:
        """True for a look without a fruit."""
        return not np.isfinite(self.across)


def pick_from(value: Mapping[str, Any], name: str) -> Pick:
    """Return the pick of a recorded `PickTouches` or `DoubtedLook`, as plain JSON.

    Raises UnusableTouches: it is malformed, or another thing than the measured fruit was felt.
    """
    if value.get("type") == KINDS["doubted_look"]:
        return _look_from(value, name)
    try:
        T_base_tcp, T_base_fruit, T_base_camera, T_mount_camera = (
            _pose(value[key])
            for key in ("T_base_tcp", "T_base_fruit", "T_base_camera", "T_mount_camera")
        )
        skin = np.array(value["skin"], float)
        left, right, closed = (_width(value[key]) for key in ("left", "right", "closed"))
        on_arm = value["on_arm"] is True
        table = _planes(value.get("table"))
        way = None if value.get("landed") is None else _way(value["landed"])
    except (KeyError, TypeError, ValueError) as error:
        raise UnusableTouches(f"its touches are malformed: {error}") from error
    across = float(skin.sum()) if skin.shape == (2,) else np.nan
    if not 0.0 < across < LONGEST:
        raise UnusableTouches("its touches are malformed: the measured skin has no width")
    apart = float(np.linalg.norm(T_base_fruit[:3, 3] - T_base_tcp[:3, 3]))
    if apart > across + MOST_APART:
        raise UnusableTouches(
            f"the measured fruit lies {1e3 * apart:.0f} mm from the fingers: they closed on another"
        )
    R = T_base_camera[:3, :3]
    axis = T_base_tcp[:3, 1]
    side, first, wider = _felt(left, right, closed, skin)
    if way is not None:
        first = float(np.linalg.norm(way))
        if first < NO_WAY:
            raise UnusableTouches(
                "a finger met the fruit where it was measured: the way to it has no direction"
            )
        side = 1
        axis = way / first
    _refuse_other_things(first, wider, across)
    if side and wider < -BESIDE:
        # of the widest section, as if it lay where the pads closed
        first = first - 0.5 * wider
        wider = np.nan
    return Pick(
        name,
        R.T @ axis,
        R.T @ (T_base_fruit[:3, 3] - T_base_camera[:3, 3]),
        across,
        side,
        first,
        wider,
        T_mount_camera,
        on_arm,
        R.T[:, 2],
        table,
        way is not None,
    )


def _look_from(value: Mapping[str, Any], name: str) -> Pick:
    try:
        T_mount_camera = _pose(value["T_mount_camera"])
        planes = _planes(value["table"])
    except (KeyError, TypeError, ValueError) as error:
        raise UnusableTouches(f"its look is malformed: {error}") from error
    if planes is None or planes[0, 2] > -0.1:
        raise UnusableTouches("its look shows no table before the camera")
    place = np.array([0.0, 0.0, -planes[0, 3] / planes[0, 2]])
    on_arm = value.get("on_arm") is True
    up = planes[1, :3]
    return Pick(
        name, np.zeros(3), place, np.nan, 0, np.nan, np.nan, T_mount_camera, on_arm, up, planes
    )


def _felt(
    left: float | None, right: float | None, closed: float | None, skin: Float64
) -> tuple[int, float, float]:
    """Return side and place of the first touch, and felt minus measured width [m].

    A plain gripper's width is read while it presses: pads and fruit give way by millimetres that nothing tells apart
    from an error of the camera. Such a width is not used.
    """
    across = float(skin.sum())
    if left is None and right is None:
        if closed is None:
            raise UnusableTouches("no finger touched anything")
        _refuse_other_things(np.nan, closed - across, across, squeezed=True)
        return 0, np.nan, np.nan
    first = max(width for width in (left, right) if width is not None)
    side = 1 if first == left else -1
    wider = np.nan if left is None or right is None else min(left, right) - across
    return side, 0.5 * first - float(skin[0 if side > 0 else 1]), wider


def _refuse_other_things(
    first: float, wider: float, across: float, *, squeezed: bool = False
) -> None:
    if wider < (LEAST_PART - 1.0) * across:
        words = f"the fingers met at {1e3 * (across + wider):.1f} mm, the fruit is {1e3 * across:.1f} mm wide"
        raise UnusableTouches(f"{words}: they touched each other, or something small")
    if wider > MOST_UNLIKE * across or (wider < -MOST_UNLIKE * across and not squeezed):
        words = f"felt {1e3 * (across + wider):.1f} mm, the camera measured {1e3 * across:.1f} mm"
        raise UnusableTouches(f"{words}: another fruit, or another side of it")
    if abs(first) > MOST_APART:
        raise UnusableTouches(
            f"a finger touched {1e3 * abs(first):.0f} mm from the measured skin: another thing"
        )


def _pose(value: Any) -> Float64:
    T = np.array(value, float)
    if not is_rigid(T) or not np.abs(T[:3, 3]).max() < LONGEST:
        raise ValueError("a pose is no rigid transform")
    return T


def _way(value: Any) -> Float64:
    way = np.array(value, float)
    if way.shape != (3,) or not float(np.linalg.norm(way)) < LONGEST:
        raise ValueError("a landing has no way")
    return way


def _planes(value: Any) -> Float64 | None:
    if value is None:
        return None
    planes = np.array(value, float)
    if (
        planes.shape != (2, 4)
        or not np.abs(np.linalg.norm(planes[:, :3], axis=1) - 1.0).max() < 1e-6
    ):
        raise ValueError("the table's planes have no normals")
    if not np.abs(planes[:, 3]).max() < LONGEST:
        raise ValueError("the table is too far")
    return planes


def _width(value: Any) -> float | None:
    if value is None:
        return None
    if value["width"] is None:
        raise ValueError("the gripper reports no width")
    width = float(value["width"])
    if not 0.0 <= width < LONGEST:
        raise ValueError(f"a width is {width} m")
    return width
