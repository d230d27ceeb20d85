"""Random tables to plan on: fruit of many sizes, clutter, and the map that a camera would make of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import Box, Frame, Intrinsics, Workspace
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import rot_z, rotation_about, transform
from pomona.skills.motion.collision import CollisionWorld, Convex, DistanceField, Margins
from pomona.skills.motion.planning.arm_space import TARGET, ArmSpace
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.measured_fruit import MeasuredFruit

TABLE_Z = -0.12
CELL = 0.01
LOWER, UPPER = np.array([-0.60, -0.80, TABLE_Z]), np.array([0.60, 0.20, 0.70])
OBSERVE = np.array([-1.36, -0.316, -0.264, -0.234, 0.065, -1.294, 0.048])
"""Where the arm stands when it plans: the observe pose of the simulated cell."""

PEDESTAL = Box("pedestal", transform(None, [0.0, 0.0, -0.06]), (0.08, 0.08, 0.06))
WORKSPACE = Workspace(TABLE_Z, LOWER, UPPER, (PEDESTAL,))
UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
FIELD_LIMIT = 0.3
ARM = 0.13
"""Distance from the base's axis within which the arm always is [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanningScene:
    """One table.

    Attributes:
        target: the fruit to be picked.
        fruits: the others.
        boxes: clutter.
        blocked: cells of the map that fruits and clutter block, shape (nx, ny, nz).
    """

    target: MeasuredFruit
    fruits: tuple[MeasuredFruit, ...]
    boxes: tuple[Box, ...]
    blocked: NDArray[np.bool_]

    def space(self, robot: RobotModel, margins: Margins | None = None) -> ArmSpace:
        """Collision checks as the skills build them."""
        field = DistanceField.of_blocked(self.blocked, LOWER, CELL, FIELD_LIMIT)
        world = CollisionWorld.build(
            robot, WORKSPACE, field, (Convex.of_fruit(self.target, TARGET),), margins
        )
        return ArmSpace(world.allowing(TARGET, "fingers"), robot.width_max)


def random_scene(seed: int, obstructed: bool = False) -> PlanningScene:
    """1 to 8 fruits in reach of the arm, the first one the target, and up to four boxes or posts between them.

    Obstructed, there is also a common obstacle of a straight joint motion: a wall, a shelf over the table, posts, or a
    crate around the target.
    """
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 9))
    fruits: list[MeasuredFruit] = []
    for _ in range(400):
        width, height = rng.uniform(0.060, 0.094), rng.uniform(0.75, 0.97)
        place = rng.uniform([-0.26, -0.56], [0.24, -0.30])
        if np.hypot(*place) > 0.57:
            continue
        fruit = _standing(
            np.array([width, width * height, width]), place, rng.uniform(-np.pi, np.pi)
        )
        if all(_apart(fruit, other) > 0.006 for other in fruits):
            fruits.append(fruit)
        if len(fruits) == count:
            break
    grid = np.zeros(np.ceil((UPPER - LOWER) / CELL).astype(int), dtype=np.bool_)
    for fruit in fruits[1:]:
        _block(grid, Convex.of_fruit(fruit))
    boxes: list[Box] = []
    for _ in range(int(rng.integers(0, 5))):
        half = np.array([rng.uniform(0.01, 0.05), rng.uniform(0.01, 0.05), rng.uniform(0.02, 0.12)])
        place = rng.uniform([-0.35, -0.62], [0.35, -0.22])
        away = np.linalg.norm(place - fruits[0].T_base_fruit[:2, 3]) - np.hypot(half[0], half[1])
        if away < fruits[0].dimensions[0] / 2.0 + 0.015 or np.linalg.norm(place) < 0.2:
            continue
        R = rotation_about((0.0, 0.0, 1.0), rng.uniform(0.0, np.pi))
        box = Box(
            f"clutter {len(boxes)}",
            transform(R, [*place, TABLE_Z + half[2]]),
            (half[0], half[1], half[2]),
        )
        boxes.append(box)
    if obstructed:
        boxes += _obstruction(fruits[0], np.random.default_rng([seed, 1]))
    for box in boxes:
        _block(grid, Convex.of_box(box))
    return PlanningScene(fruits[0], tuple(fruits[1:]), tuple(boxes), grid)


def _obstruction(target: MeasuredFruit, rng: np.random.Generator) -> list[Box]:
    """A wall, a shelf, posts or a crate by the target, none of it where the arm stands."""
    while True:
        boxes = _somewhere(target, rng)
        if all(
            Convex.of_box(box).distance([[0.0, 0.0, z] for z in (0.0, 0.15, 0.3)]).min() > ARM
            for box in boxes
        ):
            return boxes


def _somewhere(target: MeasuredFruit, rng: np.random.Generator) -> list[Box]:
    x, y = target.T_base_fruit[:2, 3]
    turn = rng.uniform(0.0, np.pi)
    R = rotation_about((0.0, 0.0, 1.0), turn)
    kind = rng.choice(["wall", "shelf", "posts", "crate"])

    def box(
        name: str, offset: tuple[float, float], low: float, half: tuple[float, float, float]
    ) -> Box:
        """`offset` from the target in the obstruction's own axes, `low` above the table."""
        dx, dy = R[:2, :2] @ offset
        return Box(name, transform(R, [x + dx, y + dy, TABLE_Z + low + half[2]]), half)

    if kind == "wall":
        return [
            box("wall", (0.0, rng.uniform(0.09, 0.14)), 0.0, (0.25, 0.008, rng.uniform(0.10, 0.20)))
        ]
    if kind == "shelf":
        return [
            box(
                "shelf",
                (0.0, rng.uniform(0.17, 0.24)),
                rng.uniform(0.18, 0.30),
                (0.20, 0.12, 0.008),
            )
        ]
    if kind == "posts":
        angles = turn + np.arange(6) * np.pi / 3.0 + rng.uniform(-0.3, 0.3, 6)
        away = rng.uniform(0.10, 0.20, 6)
        tops = rng.uniform(0.10, 0.20, 6)
        return [
            box(f"post {k}", (d * np.cos(a), d * np.sin(a)), 0.0, (0.010, 0.010, h))
            for k, (a, d, h) in enumerate(zip(angles, away, tops, strict=True))
        ]
    inside, height = rng.uniform(0.085, 0.11), rng.uniform(0.025, 0.045)
    sides = (
        (inside, 0.0, 0.005, inside),
        (-inside, 0.0, 0.005, inside),
        (0.0, inside, inside, 0.005),
        (0.0, -inside, inside, 0.005),
    )
    return [
        box(f"crate {k}", (dx, dy), 0.0, (hx, hy, height))
        for k, (dx, dy, hx, hy) in enumerate(sides)
    ]


def _block(grid: NDArray[np.bool_], shape: Convex) -> None:
    """Block the cells that a shape reaches into."""
    centre, radius = shape.bound[:3], shape.bound[3] + CELL
    first = np.maximum(((centre - radius - LOWER) / CELL).astype(int), 0)
    last = np.minimum(((centre + radius - LOWER) / CELL).astype(int) + 1, grid.shape)
    cells = np.argwhere(np.ones(np.maximum(last - first, 0))) + first
    reached = cells[shape.distance(LOWER + (cells + 0.5) * CELL) < 0.5 * CELL]
    grid[reached[:, 0], reached[:, 1], reached[:, 2]] = True


def _standing(dimensions: Float64, place: Float64, yaw: float) -> MeasuredFruit:
    """A fruit on the table, measured with a standard deviation of 1 mm in everything."""
    centre = [place[0], place[1], TABLE_Z + dimensions[1] / 2.0]
    look = Frame(
        0.0,
        0,
        np.zeros((1, 1, 3), np.uint8),
        None,
        Intrinsics(1.0, 1.0, 0.0, 0.0, 1, 1),
        None,
        np.eye(4),
    )
    return MeasuredFruit(
        fruit=load_fruit("apple"),
        T_base_fruit=transform(rot_z(yaw) @ UPRIGHT, centre),
        T_base_camera=np.eye(4),
        dimensions=dimensions,
        mu=1.0,
        sigma=0.0,
        covariance=np.eye(6) * 1e-6,
        inlier_ratio=1.0,
        residual=0.0,
        contour=np.empty((0, 2)),
        frame=look,
        method="scene",
    )


def table_look() -> tuple[Frame, Float64]:
    """A depth image of an empty table from the observe pose's height, and where the camera is (T_base_camera)."""
    lens = Intrinsics(610.6, 610.6, 317.7, 238.1, 640, 480)
    T_base_camera = transform(np.diag([1.0, -1.0, -1.0]), [0.0, -0.45, 0.60])
    rng = np.random.default_rng(0)
    depth = (0.60 - TABLE_Z + rng.normal(0.0, 1e-3, (480, 640))).astype(np.float32)
    depth[180:300, 250:400] -= 0.08
    return Frame(
        0.0, 0, np.zeros((480, 640, 3), np.uint8), depth, lens, None, T_base_camera
    ), T_base_camera


def _apart(one: MeasuredFruit, other: MeasuredFruit) -> float:
    """Air between two fruits, about [m]."""
    distance = np.linalg.norm(one.T_base_fruit[:3, 3] - other.T_base_fruit[:3, 3])
    return float(distance - (one.dimensions[0] + other.dimensions[0]) / 2.0)
