"""How free a fruit lies: room for the fingers beside it, by geometry alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.drivers import Workspace
from pomona.executive import Float64
from pomona.skills import rot_x, rot_z
from pomona.skills.motion import Convex, GripperShape, fruit_points
from pomona.skills.perception import MeasuredFruit

TURNS = 12  # number of plumb grasps in half a turn: one in 15°
RISE = 0.09  # length of the way down that the fingers take beside the fruit [m]
# distance from the fruit's outside beyond which nothing is near to a finger beside it [m]
NEAR = 0.05
LEAST_AIR = 0.002  # between each pad and the fruit [m], as the sampling of grasps needs it
PLENTY = 0.02  # more room than this is worth no more [m]


def freedom(
    fruit: MeasuredFruit,
    obstacles: Sequence[Convex],
    fingers: GripperShape,
    widest: float,
    air: float,
) -> tuple[float, float]:
    """Return the room beside the fingers of the freest plumb grasp of a fruit, and the mean of all turns [m].

    Room is negative in a collision, and for a fruit that the fingers cannot take.

    Args:
        obstacles: the other fruit, and what stands beside the fruit.
        fingers: outline of the fingers, which open to `widest` [m].
        air: between each pad and the fruit [m].
    """
    points = fruit_points(fruit)
    near = [shape for shape in obstacles if _gap(shape, fruit) < NEAR]
    if not near:
        return PLENTY, PLENTY
    rooms = [
        _room(points, near, fingers, widest, air, turn) for turn in np.arange(TURNS) * np.pi / TURNS
    ]
    return max(rooms), float(np.mean(rooms))


def obstacles_of(fruit: MeasuredFruit, workspace: Workspace) -> tuple[Convex, ...]:
    """Return the fruit beside a fruit, and boxes of the cell file that reach above its middle: walls, no floors."""
    height = fruit.T_base_fruit[2, 3]
    boxes = [
        box
        for box in workspace.obstacles
        if box.T_base_box[2, 3] + np.abs(box.T_base_box[2, :3]) @ np.array(box.half_extents)
        > height
    ]
    return (
        *(Convex.of_fruit(other, "neighbour") for other in fruit.beside),
        *map(Convex.of_box, boxes),
    )


def _gap(shape: Convex, fruit: MeasuredFruit) -> float:
    """Return a lower bound of the distance between a shape and a fruit's outside [m]."""
    return float(shape.distance(fruit.T_base_fruit[:3, 3][None])[0] - fruit.dimensions.max() / 2.0)


def _room(
    points: Float64,
    near: Sequence[Convex],
    fingers: GripperShape,
    widest: float,
    air: float,
    turn: float,
) -> float:
    """Return the least distance between a finger on its way down and the obstacles, for one turn of the hand [m]."""
    R_base_tcp = rot_z(turn) @ rot_x(np.pi)
    across = points @ R_base_tcp[:, 1]
    if np.ptp(across) + 2.0 * LEAST_AIR > widest:
        return -PLENTY
    p_grasp = (points.max(axis=0) + points.min(axis=0)) / 2.0
    p_grasp += ((across.max() + across.min()) / 2.0 - p_grasp @ R_base_tcp[:, 1]) * R_base_tcp[:, 1]
    width = min(float(np.ptp(across)) + 2.0 * air, widest)
    corners = fingers.points + (width - fingers.closed) * fingers.slides
    room = PLENTY
    for body in set(fingers.bodies):
        own = corners[[name == body for name in fingers.bodies]]
        swept = np.vstack((own, own - [0.0, 0.0, RISE])) @ R_base_tcp.T + p_grasp
        for (
            shape
        ) in near:  # the largest gap along one of the shape's normals separates two convex bodies
            room = min(
                room,
                float(((swept @ shape.planes[:, :3].T).min(axis=0) - shape.planes[:, 3]).max()),
            )
    return room
