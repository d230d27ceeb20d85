"""The robot's collision geometry as arrays for the kernels: spheres, support points, pairs that may meet, reaches."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pomona.executive.values.arrays import Float64, Int64
from pomona.executive.values.read_only import ReadOnly
from pomona.skills.motion.collision.cover import Cover, cover, cover_points
from pomona.skills.motion.robot import Body, RobotModel

FEW_SPHERES = 3  # spheres of one body that are kept apart; more of them become one shape


class RobotArrays(NamedTuple):
    """Arrays for the kernels, each geom in the frame of its link, fingers closed. g geoms, n spheres."""

    steps: Float64  # steps, sliding: the chain, shapes (dof, 3, 4) and (dof,)
    sliding: NDArray[np.bool_]
    bounds: Float64  # one sphere around each geom, shape (g, 4) [m]
    links: Int64  # link of each geom, shape (g,)
    slides: Float64  # shift of each geom per metre of opening beyond `closed`, shape (g, 3)
    # the covers, shape (n, 4) [m], of all geoms, and `sphere_start`, shape (g + 1,), where each begins
    spheres: Float64
    sphere_start: Int64
    support: Float64  # support points and rounding, shape (k, 4) [m], and `support_start`, shape (g + 1,)
    support_start: Int64
    pairs: Int64  # geoms that may collide with each other, shape (p, 2), the one nearer to the base first
    # upper bound of the distance of a geom's points from a joint's axis, shape (dof, g) [m] (1 for a sliding joint); 0
    # where the joint does not move the geom
    reach: Float64
    closed: float  # opening of the gripper to which the geometry refers [m]


@dataclass(frozen=True, slots=True, eq=False)
class RobotShape(ReadOnly):
    """A robot's collision geometry, by name and as arrays."""

    model: RobotModel  # the robot model
    arrays: RobotArrays  # for the kernels
    # geom_names, geom_bodies, geom_groups: of each geom: its name, its body's name, its group ("arm", "gripper",
    # "fingers" or "held")
    geom_names: tuple[str, ...]
    geom_bodies: tuple[str, ...]
    geom_groups: tuple[str, ...]

    @staticmethod
    def of(model: RobotModel) -> RobotShape:
        """Return the shape of a robot; computed once for a model."""
        return _shape_of(model)

    def spheres_of(self, geom: int, q: ArrayLike, width: float) -> Float64:
        """Return the covering spheres of a geom at joints q, (dof,) [rad], in the base frame, shape (n, 4) [m]."""
        return self._spheres(geom, self.model.link_poses(q), width)

    def spheres(self, q: ArrayLike, width: float) -> Float64:
        """Covering spheres of the whole robot in the base frame, shape (n, 4) [m]."""
        links = self.model.link_poses(q)
        return np.vstack(
            [self._spheres(geom, links, width) for geom in range(len(self.geom_names))]
        )

    def _spheres(self, geom: int, links: Float64, width: float) -> Float64:
        arrays = self.arrays
        own = arrays.spheres[arrays.sphere_start[geom] : arrays.sphere_start[geom + 1]]
        T = links[arrays.links[geom]]
        shift = arrays.slides[geom] * (width - arrays.closed)
        return np.column_stack(((own[:, :3] + shift) @ T[:3, :3].T + T[:3, 3], own[:, 3]))

    def holding(self, points_tcp: Float64) -> RobotShape:
        """Return the robot with an object between its fingers: the hull of points in the TCP's frame, shape (n, 3) [m].

        The object collides with the arm's links and with the world, not with the gripper that holds it.
        """
        T_link_tcp = self.model.T_link_tcp
        held = cover_points(points_tcp @ T_link_tcp[:3, :3].T + T_link_tcp[:3, 3])
        arrays = self.arrays
        last = self.model.dof
        number = len(self.geom_names)
        pairs = [(g, number) for g in range(number) if arrays.links[g] < last - 1]
        grown = RobotArrays(
            steps=arrays.steps,
            sliding=arrays.sliding,
            bounds=np.vstack((arrays.bounds, _bounding_sphere(held.spheres))),
            links=np.append(arrays.links, last),
            slides=np.vstack((arrays.slides, np.zeros(3))),
            spheres=np.vstack((arrays.spheres, held.spheres)),
            sphere_start=np.append(arrays.sphere_start, len(arrays.spheres) + len(held.spheres)),
            support=np.vstack((arrays.support, _support_of(held))),
            support_start=np.append(arrays.support_start, len(arrays.support) + len(held.support)),
            pairs=np.vstack((arrays.pairs, np.array(pairs, dtype=np.int64).reshape(-1, 2))),
            reach=np.column_stack((arrays.reach, _reach(self.model, last, held.spheres))),
            closed=arrays.closed,
        )
        return replace(
            self,
            arrays=grown,
            geom_names=(*self.geom_names, "held fruit"),
            geom_bodies=(*self.geom_bodies, "held fruit"),
            geom_groups=(*self.geom_groups, "held"),
        )


@lru_cache(maxsize=16)
def _shape_of(model: RobotModel) -> RobotShape:
    parts = _parts(model)
    covers = [part.cover for part in parts]
    bodies = [part.body for part in parts]
    # A finger is covered where it is when closed, and shifted in the kernel; its reach must hold for every opening.
    travel = model.width_max - model.width_min
    swept = [
        np.vstack((c.spheres, c.spheres + np.append(body.slide * travel, 0.0)))
        for c, body in zip(covers, bodies, strict=True)
    ]
    pairs = [
        (i, j) if bodies[i].link <= bodies[j].link else (j, i)
        for i in range(len(bodies))
        for j in range(i + 1, len(bodies))
        if _may_meet(model, bodies[i], bodies[j])
    ]
    arrays = RobotArrays(
        steps=model.steps,
        sliding=model.sliding,
        bounds=np.array([_bounding_sphere(c.spheres) for c in covers]),
        links=np.array([body.link for body in bodies]),
        slides=np.array([body.slide for body in bodies]),
        spheres=np.vstack([c.spheres for c in covers]),
        sphere_start=np.cumsum([0] + [len(c.spheres) for c in covers]),
        support=np.vstack([_support_of(c) for c in covers]),
        support_start=np.cumsum([0] + [len(c.support) for c in covers]),
        pairs=_without_overlapping(model, bodies, covers, pairs),
        reach=np.column_stack(
            [_reach(model, b.link, s) for b, s in zip(bodies, swept, strict=True)]
        ),
        closed=model.width_min,
    )
    return RobotShape(
        model,
        arrays,
        tuple(part.name for part in parts),
        tuple(body.name for body in bodies),
        tuple(body.group for body in bodies),
    )


class _Part(NamedTuple):
    """A geom of the kernels: its name, its body, its cover in the link's frame, fingers closed."""

    name: str
    body: Body
    cover: Cover


def _parts(model: RobotModel) -> list[_Part]:
    """Return the model's geoms; a body of many spheres is one part: each costs every proof of a step."""
    parts: list[_Part] = []
    for number, body in enumerate(model.bodies):
        own = [geom for geom in model.geoms if geom.body == number]
        spheres = [geom for geom in own if geom.kind == "sphere"]
        covers = {geom.name: _in_link(cover(geom), geom.T_link_geom) for geom in own}
        if len(spheres) > FEW_SPHERES:
            members = [covers.pop(geom.name) for geom in spheres]
            whole = Cover(
                np.vstack([c.spheres for c in members]),
                np.concatenate([c.inner for c in members]),
                np.vstack([c.support for c in members]),
                np.concatenate([np.broadcast_to(c.rounding, len(c.support)) for c in members]),
            )
            parts.append(_Part(f"{body.name}'s spheres", body, whole))
        parts += [_Part(name, body, shape) for name, shape in covers.items()]
    return parts


def _in_link(shape: Cover, T_link_geom: Float64) -> Cover:
    """Return the cover in the link's frame."""
    R = T_link_geom[:3, :3]
    p = T_link_geom[:3, 3]
    spheres = np.column_stack((shape.spheres[:, :3] @ R.T + p, shape.spheres[:, 3]))
    return Cover(spheres, shape.inner, shape.support @ R.T + p, shape.rounding)


def _bounding_sphere(spheres: Float64) -> Float64:
    """Return a sphere around spheres, shape (4,)."""
    lower = (spheres[:, :3] - spheres[:, 3:]).min(axis=0)
    upper = (spheres[:, :3] + spheres[:, 3:]).max(axis=0)
    centre = (lower + upper) / 2.0
    return np.append(
        centre, np.max(np.linalg.norm(spheres[:, :3] - centre, axis=1) + spheres[:, 3])
    )


def _support_of(shape: Cover) -> Float64:
    return np.column_stack((shape.support, np.broadcast_to(shape.rounding, len(shape.support))))


def _reach(model: RobotModel, link: int, spheres: Float64) -> Float64:
    """Return an upper bound of the distance of spheres from every joint's axis, shape (dof,).

    In its own link's frame the axis is z. For an earlier joint the links between are added to the next joint's offset.
    """
    reach = np.zeros(model.dof)
    from_axis = float(np.max(np.hypot(spheres[:, 0], spheres[:, 1]) + spheres[:, 3]))
    from_origin = float(np.max(np.linalg.norm(spheres[:, :3], axis=1) + spheres[:, 3]))
    for joint in range(link - 1, -1, -1):
        reach[joint] = 1.0 if model.sliding[joint] else from_axis
        step = model.steps[joint][:, 3]
        stroke = (
            max(abs(model.lower[joint]), abs(model.upper[joint])) if model.sliding[joint] else 0.0
        )
        from_axis = float(np.hypot(step[0], step[1])) + from_origin + stroke
        from_origin = float(np.linalg.norm(step)) + from_origin + stroke
    return reach


def _may_meet(model: RobotModel, one: Body, other: Body) -> bool:
    """Return False for parts of one rigid assembly, for parent and child, and for pairs that the file excludes."""
    if one.link == other.link:
        return False
    if frozenset((one.name, other.name)) in model.excluded:
        return False
    return other.parent != one.name and one.parent != other.name


def _without_overlapping(
    model: RobotModel, bodies: list[Body], covers: list[Cover], pairs: list[tuple[int, int]]
) -> Int64:
    """Return the pairs of geoms without those of bodies that overlap in every posture: their contact is meaningless.

    Overlap is judged by spheres *inside* the shapes, so a pair is left out only when it truly overlaps each time.
    """
    rng = np.random.default_rng(0)
    # random postures in which a pair of bodies must overlap, every time, to count as always overlapping
    postures = np.vstack(
        (np.zeros(model.dof), rng.uniform(model.lower, model.upper, (64, model.dof)))
    )
    by_bodies: dict[tuple[str, str], list[tuple[int, int]]] = defaultdict(list)
    for i, j in pairs:
        by_bodies[bodies[i].name, bodies[j].name].append((i, j))
    overlapping = set(by_bodies)
    for q in postures:
        if not overlapping:
            break
        links = model.link_poses(q)
        for key in sorted(overlapping):
            if not any(_inner_overlap(links, bodies, covers, i, j) for i, j in by_bodies[key]):
                overlapping.discard(key)
    kept = [
        pair for key, members in by_bodies.items() if key not in overlapping for pair in members
    ]
    return np.array(kept, dtype=np.int64).reshape(-1, 2)


def _inner_overlap(links: Float64, bodies: list[Body], covers: list[Cover], i: int, j: int) -> bool:
    centres = [
        covers[g].spheres[:, :3] @ links[bodies[g].link][:3, :3].T + links[bodies[g].link][:3, 3]
        for g in (i, j)
    ]
    distances = np.linalg.norm(centres[0][:, None] - centres[1][None], axis=2)
    return bool(np.any(distances < covers[i].inner[:, None] + covers[j].inner[None]))
