"""Postures of another arm in which its hand stands where the shipped arm's does, by inverse kinematics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import Workspace
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import inverse
from pomona.skills.motion.collision import CollisionWorld, Margins, RobotShape
from pomona.skills.motion.robot import RobotModel, inverse_kinematics

OFTEN = 0.5  # share of postures in which hulls touch, and parts do not: of five arms such pairs have 0.66 to 1, others 0.33
DRAWS = 128  # postures that are tried for it
# poses that no cell can be without
OBSERVE = "observe"
HOME = "home"
TRIED = 12  # postures of the first pose from which the others are reached
# half of the width of a camera's view, beside which no part of the arm shall stand [rad]
VIEW = 0.48
ROOM = 0.01  # least distance of a joint to its limits [rad]: a hundred times the rounding of a written pose


@dataclass(frozen=True, slots=True)
class Reached:
    """Postures by the names of their poses, and the names of those out of reach."""

    postures: Mapping[str, Float64]  # (dof,) [rad]
    missing: tuple[str, ...]

    @property
    def usable(self) -> bool:
        """Whether the poses that no cell can be without are among them."""
        return all(name in self.postures for name in (OBSERVE, HOME))


def never_apart(model: RobotModel) -> set[tuple[str, str]]:
    """Return the pairs of bodies that come nearer than their margin in most postures, and neighbours.

    No arm is built to touch itself in most postures: such pairs are hulls of hollow shapes, as in the wrists of a UR.
    """
    shape = RobotShape.of(model)
    margin = Margins().itself
    lower = np.maximum(model.lower, -np.pi)
    upper = np.minimum(model.upper, np.pi)
    postures = np.random.default_rng(0).uniform(lower, upper, (DRAWS, model.dof))
    spheres = [
        [shape.spheres_of(geom, q, model.width_max) for geom in range(len(shape.geom_names))]
        for q in postures
    ]
    touches: dict[tuple[str, str], NDArray[np.bool_]] = {}
    for i, j in shape.arrays.pairs:
        pair = (shape.geom_bodies[i], shape.geom_bodies[j])
        near = np.array([_apart(of[i], of[j]) < margin for of in spheres])
        touches[pair] = touches.get(pair, False) | near
    often = {pair for pair, near in touches.items() if near.mean() >= OFTEN}
    return often | {(body.parent, body.name) for body in model.bodies if body.link and body.parent}


def lowest(model: RobotModel) -> float:
    """Return the lowest height of the first link at any angle of its joint, as collisions are judged [m]."""
    shape = RobotShape.of(model)
    first = [geom for geom, link in enumerate(shape.arrays.links) if link == 1]
    turned = np.zeros((8, model.dof))
    turned[:, 0] = np.linspace(max(model.lower[0], -np.pi), min(model.upper[0], np.pi), len(turned))
    spheres = [shape.spheres_of(geom, q, model.width_max) for q in turned for geom in first]
    return float(min((of[:, 2] - of[:, 3]).min() for of in spheres)) if spheres else 0.0


def _apart(one: Float64, other: Float64) -> float:
    """Return the smallest distance between two sets of spheres, (n, 4) [m]."""
    gaps = (
        np.linalg.norm(one[:, None, :3] - other[None, :, :3], axis=2)
        - one[:, None, 3]
        - other[None, :, 3]
    )
    return float(gaps.min())


def reach(
    model: RobotModel, workspace: Workspace, wanted: Mapping[str, Sequence[Float64]]
) -> Reached:
    """Return free postures with the flange at poses T_base_tool0, all near to each other.

    Where the camera observes, the arm itself stands out of its view, or as far out as it can. Of each pose the first of
    its alternatives is taken that can be reached. The posture of the first pose is the one from which most others are
    reached, by the shortest ways.
    """
    world = CollisionWorld.build(model, workspace)
    first, *others = wanted
    best = Reached({}, tuple(wanted))
    least = (len(wanted) + 1, np.inf)
    for q in _free(model, world, first, wanted[first][0])[:TRIED]:
        postures = {first: q}
        far = 0.0
        for name in others:
            near = next(
                (found[0] for T in wanted[name] if len(found := _free(model, world, name, T, q))),
                None,
            )
            if near is not None:
                postures[name] = near
                far += float(np.abs(near - q).max())
        cost = (len(wanted) - len(postures), far)
        if cost < least:
            best = Reached(postures, tuple(name for name in wanted if name not in postures))
            least = cost
    return best


def _free(
    model: RobotModel,
    world: CollisionWorld,
    name: str,
    T_base_tool0: Float64,
    near: Float64 | None = None,
) -> Float64:
    """Return the free postures of a pose: the nearest first, or those far from everything and from their limits.

    Joints are turned by whole turns towards `near`, or towards the middle of their ranges.
    """
    middle = 0.5 * (model.lower + model.upper)
    solutions = inverse_kinematics(
        model, T_base_tool0 @ model.T_tool_tcp, near=middle if near is None else near
    )
    room: Float64 = np.minimum(solutions - model.lower, model.upper - solutions).min(
        axis=1, initial=np.inf
    )
    inside: Float64 = solutions[room >= ROOM]
    if not len(inside):
        return inside
    clear = world.clearances(inside, model.width_max)
    free: Float64 = inside[clear >= 0.0]
    if near is None:
        free = free[np.argsort(-(clear + 0.1 * np.minimum(room[room >= ROOM], 1.0))[clear >= 0.0])]
    if name.startswith(OBSERVE) and len(free):
        shape = RobotShape.of(model)
        seen = np.minimum([view(model, shape, q) for q in free], VIEW)
        free = free[seen >= seen.max()]
    return free


def view(model: RobotModel, shape: RobotShape, q: Float64) -> float:
    """Return the smallest angle between the camera's axis and a part before the hand, in a posture (dof,) [rad]."""
    T_camera_base = inverse(model.fk(q) @ model.frame("camera"))
    parts = [geom for geom, link in enumerate(shape.arrays.links) if link < model.dof]
    spheres = np.vstack([shape.spheres_of(geom, q, model.width_max) for geom in parts])
    centres = spheres[:, :3] @ T_camera_base[:3, :3].T + T_camera_base[:3, 3]
    half = np.arcsin(np.minimum(spheres[:, 3] / np.linalg.norm(centres, axis=1), 1.0))
    return float((np.arctan2(np.hypot(centres[:, 0], centres[:, 1]), centres[:, 2]) - half).min())
