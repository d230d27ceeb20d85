"""Plumb grasps of a fruit between neighbours, which the fingers push aside on their way down.

Walls and the floor are kept clear; a neighbour may be in a finger's way, and the fruit itself, by some millimetres.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pomona.applications.crates.hooks import Beside, facing, postures_over, touched
from pomona.executive import Float64
from pomona.skills import rot_x, rot_z
from pomona.skills.motion import ArmSpace, Grasp, GraspCandidates, GripperShape, RuledOut

TURNS = tuple(float(turn) for turn in np.radians(np.arange(0.0, 180.0, 15.0)))
"""Turns of the hand about the vertical [rad]; both ends of the hand are tried for each."""
AIR = 2e-3
"""Between each pad and the fruit [m]."""
LEAST_AIR = 1e-3
"""The same where the fingers do not open farther [m]."""
ALONG = tuple(float(shift) for shift in np.arange(-0.004, 0.0041, 0.001))
"""Shifts of the hand along its sliding direction that are tried [m]: beyond the air a pad pushes the fruit."""
ACROSS = (0.0, -0.006, 0.006)
"""The same across it [m]."""
ACROSS_COST = 2.0
"""Cost of a shift across the sliding direction [1/m]: the pads then meet the fruit beside its middle."""
CROWDED = 0.05
"""Difference of the overlaps of both fingers from which the hand gives way to one side [1]."""
GIVE = 2e-3
"""Room that the fingers keep from walls along their sliding direction [m]: the hand gives way by it."""
PADS = 1e-3
"""Way by which a pad may push the fruit aside [m]: farther in, its rubber (friction 0.8) locks on the skin."""
LOCK = 0.11
"""Largest overlap of a finger with a neighbour, in its radii [1]. A ball between a finger and the floor is nipped, and
does not roll away, where tan((90° - a) / 2) < friction, with cos a = 1 - overlap / radius: from 0.12 on at 0.6, the
friction of skin on plastic."""
FLOOR_AIR = 3e-3
RAISED = 4e-3
"""Air between the fingers and the floor, and height of the TCP over the fruit's middle at least [m]."""
PALM_AIR = 5e-3
"""Air between palm and fruit [m]."""
FINGERS_UP = 0.12
"""Length of the fingers that is beside the fruit on the way [m]: the outline is swept by it."""
NEIGHBOUR = "neighbour"  # name of measured fruit among a map's obstacles


@dataclass(frozen=True, slots=True, eq=False)
class InsertPlace:
    """One place of the open hand around a fruit, for one turn.

    Attributes:
        turn: of the hand about the vertical [rad].
        T_base_tcp: lowest place, shape (4, 4).
        width: opening [m].
        push: largest overlap with a neighbour, and with the fruit, in their radii [1].
        why: the obstacle that rules it out; empty without one.
    """

    turn: float
    T_base_tcp: Float64
    width: float
    push: float
    why: str


def insert_places(beside: Beside, fingers: GripperShape, widest: float) -> Iterator[InsertPlace]:
    """Yield for each turn the place with the least push, or the obstacle of the last one.

    Args:
        fingers: outline of the fingers, which open to `widest` [m].
    """
    for turn in TURNS:
        R_base_tcp = rot_z(turn) @ rot_x(np.pi)
        across = beside.points @ R_base_tcp[:, 1]
        fruit_width = float(np.ptp(across))
        width = min(fruit_width + 2.0 * AIR, widest)
        middle = (beside.points.max(axis=0) + beside.points.min(axis=0)) / 2.0
        middle += ((across.max() + across.min()) / 2.0 - middle @ R_base_tcp[:, 1]) * R_base_tcp[
            :, 1
        ]
        T_base_tcp = np.eye(4)
        T_base_tcp[:3, :3], T_base_tcp[:3, 3] = R_base_tcp, middle
        lowest = fingers.lowest(T_base_tcp, width)[0]
        T_base_tcp[2, 3] += max(RAISED, beside.points[:, 2].min() + FLOOR_AIR - lowest)
        why = ""
        if width - fruit_width < 2.0 * LEAST_AIR:
            why = f"the fruit is {1e3 * fruit_width:.0f} mm wide here, the fingers open to {1e3 * widest:.0f} mm"
        elif beside.points[:, 2].max() + PALM_AIR > T_base_tcp[2, 3] + fingers.palm_depth:
            why = "the fruit would touch the palm"
        if why:
            yield InsertPlace(turn, T_base_tcp, width, np.inf, why)
        else:
            yield _least_push(beside, fingers, turn, T_base_tcp, width, width - fruit_width)


def insert_candidates(
    beside: Beside, space: ArmSpace, near: Float64, fingers: GripperShape, widest: float
) -> GraspCandidates:
    """Return grasps to which the arm can go straight down, the one with the least push first.

    A candidate's `T_base_pre_grasp` is over the fruit and the walls beside it; its `clearance` is negative by the push.

    Args:
        space: the arm among its obstacles.
        near: joints from which short ways are preferred, shape (dof,) [rad].
    """
    grasps = []
    ruled_out = []
    for index, place in enumerate(
        sorted(insert_places(beside, fingers, widest), key=lambda place: place.push)
    ):
        q_free = np.empty((0, space.world.shape.model.dof))
        why = place.why
        T_base_over = place.T_base_tcp.copy()
        if not why:
            T_base_over[2, 3] = beside.top + fingers.points[:, 2].max()
            passed = (*beside.names, NEIGHBOUR)
            q_free, why = postures_over(
                space.at_width(place.width),
                passed,
                near,
                T_base_over,
                place.T_base_tcp,
                np.zeros(3),
            )
        if why:
            ruled_out.append(
                RuledOut(
                    index, 0.0, place.turn, "IN_COLLISION" if "touch" in why else "UNREACHABLE", why
                )
            )
            continue
        grasps.append(
            Grasp(
                index, 0.0, place.turn, T_base_over, place.T_base_tcp, place.width, q_free,
                -place.push * beside.radius, 0.0,
                beside.fruit,
            )
        )  # fmt: skip
    return GraspCandidates(tuple(grasps), tuple(ruled_out), 1)


def crowded_side(beside: Beside, fingers: GripperShape, grasp: Grasp) -> float:
    """Return 1 if a neighbour is in the way of the finger along the hand's y axis, -1 of the other one, 0 of both."""
    corners = finger_corners(fingers, grasp.T_base_grasp, grasp.width)
    ahead = (corners - grasp.T_base_grasp[:3, 3]) @ grasp.T_base_grasp[:3, 1] > 0.0
    one, other = (max(_overlaps(corners[own], beside), default=0.0) for own in (ahead, ~ahead))
    return float(np.sign(one - other)) if abs(one - other) > CROWDED else 0.0


def _least_push(
    beside: Beside,
    fingers: GripperShape,
    turn: float,
    T_base_tcp: Float64,
    width: float,
    free: float,
) -> InsertPlace:
    """Return the place with the least push among shifts of the hand; `free` is the air on both sides together [m]."""
    corners = finger_corners(fingers, T_base_tcp, width)
    best = (LOCK, T_base_tcp)
    why = ""
    give = GIVE * T_base_tcp[:3, 1]
    for shift in sorted(ALONG, key=abs):
        pads = max(0.0, abs(shift) - free / 2.0)
        for aside in ACROSS:
            moved = shift * T_base_tcp[:3, 1] + aside * T_base_tcp[:3, 0]
            swept = np.vstack((corners + moved - give, corners + moved + give))
            if pads > PADS:
                continue
            if near := touched(swept, fingers.bodies * 4, beside.walls):
                why = why or near
                continue
            bodies = [[name == body for name in fingers.bodies * 2] for body in set(fingers.bodies)]
            push = max(
                (each for own in bodies for each in _overlaps(corners[own] + moved, beside)),
                default=0.0,
            )
            push += ACROSS_COST * abs(aside) + pads / beside.radius
            if push < best[0]:
                T_best = T_base_tcp.copy()
                T_best[:3, 3] += moved
                best = push, T_best
    if best[0] < LOCK:
        return InsertPlace(turn, best[1], width, best[0], "")
    words = (
        why
        or f"the fingers would touch neighbours {100.0 * LOCK:.0f} % of a radius inside and nip them"
    )
    return InsertPlace(turn, T_base_tcp, width, np.inf, words)


def finger_corners(fingers: GripperShape, T_base_tcp: Float64, width: float) -> Float64:
    """Return the corners of the fingers at a place and above it, shape (2 n, 3) [m]: their hull is the way down."""
    corners = (fingers.points + (width - fingers.closed) * fingers.slides) @ T_base_tcp[
        :3, :3
    ].T + T_base_tcp[:3, 3]
    return np.vstack((corners, corners + np.array([0.0, 0.0, FINGERS_UP])))


def _overlaps(points: Float64, beside: Beside) -> list[float]:
    """Return how far each neighbour is in the way of a convex body, in its own radii [1]."""
    pairs = zip(beside.neighbours, beside.fruit.beside, strict=True)
    return [
        max(0.0, -facing(points, shape)[1]) / (float(fruit.dimensions[0]) / 2.0)
        for shape, fruit in pairs
    ]
