"""A belt for the operator: its outline, its fruit with their ellipses, and where the hand will meet one."""

from __future__ import annotations

import numpy as np

from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.intercepting import ELLIPSE, ellipse_radius
from pomona.executive import Float64, Line3, SceneView, TableView

AHEAD = 0.5  # time from now for which the ellipses are shown [s]
LARGER = 10.0  # scale of the shown ellipses: one of 3 mm could not be seen beside a fruit
COLUMNS = ("fruit", "size", "along the belt", "place known to", "state")


def belt_scene(
    watch: BeltWatch, now: float, meeting: tuple[float, Float64] | None = None
) -> SceneView:
    """Return the belt in space.

    Args:
        meeting: when and where the hand will be around its fruit: time [s] and place in the base frame, shape (3,) [m].
    """
    lines = [_outline(watch)]
    for track in watch.tracks.tracks:
        place, covariance = watch.tracks.expected(track, now + AHEAD, watch.travel.at(now + AHEAD))
        ring = np.column_stack([LARGER * _ellipse(covariance), np.zeros(25)]) + place
        label = f"where fruit {track.number} will be in {AHEAD:g} s (90 % ellipse, {LARGER:.0f} times as large)"
        lines.append(Line3(_on_belt(watch, ring), label, "planned" if track.rests else "muted"))
    if meeting is not None and meeting[0] > now:
        up = meeting[1] + np.array([[0.0, 0.0, 0.15], [0.0, 0.0, 0.0]])
        lines.append(Line3(up, f"gripped in {meeting[0] - now:.1f} s", "approach"))
    return SceneView(tuple(lines), caption=f"belt at {watch.travel.speed:.2f} m/s")


def bare_belt(watch: BeltWatch) -> SceneView:
    """Return the belt without fruit, for the time in which it runs on and is not watched."""
    caption = f"the fruit was taken; the belt ran at {watch.travel.speed:.2f} m/s when it was last watched"
    return SceneView((_outline(watch),), caption=caption)


def belt_table(watch: BeltWatch, now: float) -> TableView:
    """Return the fruit on the belt as a table."""
    rows = []
    for track in watch.tracks.tracks:
        place, covariance = watch.tracks.expected(track, now, watch.travel.at(now))
        size = " × ".join(f"{1e3 * d:.0f}" for d in track.dimensions) + " mm"
        known = f"{1e3 * ellipse_radius(covariance):.1f} mm"
        state = (
            "tried" if track.number in watch.tried else "rests" if track.rests else "new or rolling"
        )
        rows.append((str(track.number), size, f"{1e3 * place[0]:.0f} mm", known, state))
    return TableView(
        COLUMNS, tuple(rows), f"{watch.sentence}, belt at {watch.travel.speed:.2f} m/s"
    )


def _outline(watch: BeltWatch) -> Line3:
    belt = watch.tracks.belt
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * [
        belt.length / 2.0,
        belt.width / 2.0,
    ]
    return Line3(_on_belt(watch, np.column_stack([corners, np.zeros(5)])), "belt", "muted")


def _ellipse(covariance: Float64) -> Float64:
    """Return points on the level 90 % ellipse of a covariance, shape (25, 2) [m]."""
    values, axes = np.linalg.eigh(covariance[:2, :2])
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    ring: Float64 = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (
        ELLIPSE * np.sqrt(np.maximum(values, 0.0))
    )
    turned: Float64 = ring @ axes.T
    return turned


def _on_belt(watch: BeltWatch, points: Float64) -> Float64:
    """Return points of the belt's frame, shape (n, 3), in the base frame."""
    T = watch.tracks.belt.T_base_belt
    moved: Float64 = points @ T[:3, :3].T + T[:3, 3]
    return moved
