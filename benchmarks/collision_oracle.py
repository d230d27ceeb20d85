"""The sphere model against MuJoCo's exact contacts: it must never miss a contact, and should rarely report a false one.

    python -m benchmarks.collision_oracle [--states 10000] [--robot trees/robots/sia5f_wsg32.xml]

Random postures and gripper openings among random boxes over a table. Both sides judge the same scene in the same run:
covering spheres with all margins zero, and MuJoCo's contacts of the robot's own shapes.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import Box, Workspace
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import rotation_about, transform
from pomona.skills.motion.collision import CollisionWorld, DistanceField, Margins
from pomona.skills.motion.robot import RobotModel

TOUCHING = 1e-6
"""MuJoCo's distances are good to about this [m]."""

_CELL = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A table, boxes in any pose, and cells of a grid: the common input of both sides."""

    workspace: Workspace
    cells: NDArray[np.bool_]
    origin: Float64


@dataclass(frozen=True, slots=True)
class Verdicts:
    """How often the sphere model and the oracle agreed.

    Attributes:
        states: number of postures judged.
        touching: of these in contact by the oracle.
        missed: in contact by the oracle, free by the spheres: must be 0.
        too_careful: free by the oracle, in collision by the spheres.
        greatest_care: largest true distance at which the spheres called a collision [m].
        spheres_us, oracle_us: time of one check [µs].
    """

    states: int
    touching: int
    missed: int
    too_careful: int
    greatest_care: float
    spheres_us: float
    oracle_us: float

    def __str__(self) -> str:
        free = self.states - self.touching
        share = 100.0 * self.too_careful / max(free, 1)
        return (
            f"{self.states} states, {self.touching} touch something: {self.missed} of them missed by the spheres. "
            f"{self.too_careful} of {free} free states called a collision ({share:.1f} %), "
            f"at most {1e3 * self.greatest_care:.1f} mm before contact. "
            f"One check: spheres {self.spheres_us:.1f} µs, MuJoCo {self.oracle_us:.0f} µs, "
            f"{self.oracle_us / self.spheres_us:.0f} x"
        )


def random_scene(seed: int, boxes: int = 4, cells: int = 60, table_z: float = -0.12) -> Scene:
    """Boxes and grid cells around the robot, none of them at its base."""
    rng = np.random.default_rng(seed)
    obstacles = []
    for number in range(boxes):
        angle, radius = rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 0.75)
        centre = [radius * np.cos(angle), radius * np.sin(angle), rng.uniform(table_z, 0.8)]
        axis = rng.normal(size=3)
        R = rotation_about(axis / np.linalg.norm(axis), rng.uniform(0.0, np.pi))
        half = rng.uniform(0.02, 0.10, 3)
        obstacles.append(Box(f"box {number}", transform(R, centre), (half[0], half[1], half[2])))
    origin = np.array([-0.8, -0.8, table_z])
    grid = np.zeros((80, 80, 50), dtype=np.bool_)
    for _ in range(cells):
        angle, radius = rng.uniform(-np.pi, np.pi), rng.uniform(0.3, 0.75)
        place = np.array(
            [radius * np.cos(angle), radius * np.sin(angle), rng.uniform(table_z, 0.8)]
        )
        grid[tuple(((place - origin) / _CELL).astype(int))] = True
    workspace = Workspace(
        table_z, np.array([-1.0, -1.0, -0.2]), np.array([1.0, 1.0, 1.2]), tuple(obstacles)
    )
    return Scene(workspace, grid, origin)


def compare(robot_file: Path, states: int, seed: int) -> Verdicts:
    """Judge random states of one robot in one scene by both sides."""
    robot = RobotModel.load(robot_file)
    scene = random_scene(seed)
    field = DistanceField.of_blocked(scene.cells, scene.origin, _CELL, 0.3)
    world = CollisionWorld.build(
        robot, scene.workspace, field, margins=Margins(0.0, 0.0, 0.0, 0.0, 0.0)
    )
    oracle = Oracle(robot, scene)
    rng = np.random.default_rng(seed + 1)
    postures = rng.uniform(robot.lower, robot.upper, (states, robot.dof))
    width = float(rng.uniform(robot.width_min, robot.width_max)) if robot.width_max else 0.0
    world.free(postures[:1], width)
    began = time.perf_counter()
    free = world.free(postures, width)
    spheres_us = 1e6 * (time.perf_counter() - began) / states
    began = time.perf_counter()
    touching = np.array([oracle.touches(q, width) for q in postures])
    oracle_us = 1e6 * (time.perf_counter() - began) / states
    careful = postures[~free & ~touching]
    distances = [oracle.distance(q, width) for q in careful]
    return Verdicts(
        states, int(touching.sum()), int((free & touching).sum()), len(careful), max(distances, default=0.0),
        spheres_us, oracle_us,
    )  # fmt: skip


class Oracle:
    """The same scene in MuJoCo, with the robot's own geometry."""

    def __init__(self, robot: RobotModel, scene: Scene) -> None:
        spec = mujoco.MjSpec.from_file(str(robot.path))
        spec.compiler.fusestatic = False
        for geom in spec.geoms:
            if geom.contype or geom.conaffinity:
                geom.contype, geom.conaffinity = 2, 3
        for box in scene.workspace.obstacles:
            self._add_box(spec, box.T_base_box, box.half_extents)
        for cell in np.argwhere(scene.cells):
            centre = scene.origin + (cell + 0.5) * _CELL
            self._add_box(spec, transform(translation=centre), (_CELL / 2.0,) * 3)
        table = [0.0, 0.0, (scene.workspace.table_z or 0.0) - 0.5]
        self._add_box(spec, transform(translation=table), (3.0, 3.0, 0.5))
        self.robot = robot
        self.model: Any = spec.compile()
        self.state: Any = mujoco.MjData(self.model)
        self.model.geom_margin[:] = 0.0
        world = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, "world")
        self.obstacles = [
            g for g in range(self.model.ngeom) if self.model.geom_bodyid[g] == max(world, 0)
        ]
        links = {body.name: body.link for body in robot.bodies}
        names = [
            self.model.body(int(self.model.geom_bodyid[g])).name for g in range(self.model.ngeom)
        ]
        self.moving = [g for g in range(self.model.ngeom) if links.get(names[g], 0) > 0]
        self.names, self.links = names, links

    @staticmethod
    def _add_box(spec: Any, T: Float64, half: tuple[float, float, float]) -> None:
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, T[:3, :3].ravel())
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=T[:3, 3],
            quat=quaternion,
            size=half,
            contype=1,
            conaffinity=2,
        )

    def _place(self, q: Float64, width: float) -> None:
        for name, value in zip(self.robot.joint_names, q, strict=True):
            self.state.joint(name).qpos[0] = value
        for joint in range(self.model.njnt):
            if self.model.joint(joint).name.startswith("finger"):
                self.state.qpos[self.model.jnt_qposadr[joint]] = (
                    width - self.robot.width_min
                ) / 2.0
        mujoco.mj_kinematics(self.model, self.state)
        mujoco.mj_comPos(self.model, self.state)

    def touches(self, q: Float64, width: float) -> bool:
        """Whether MuJoCo finds a contact of a moving part of the robot, with the world or another part."""
        self._place(q, width)
        mujoco.mj_collision(self.model, self.state)
        contacts = self.state.contact
        return any(
            distance < -TOUCHING and self._may_meet(int(a), int(b))
            for distance, (a, b) in zip(contacts.dist, contacts.geom, strict=True)
        )

    def distance(self, q: Float64, width: float) -> float:
        """True distance of the moving parts from the obstacles and from each other [m], up to 0.2 m."""
        self._place(q, width)
        nearest = 0.2
        pairs = [(a, b) for a in self.moving for b in self.obstacles]
        pairs += [
            (a, b)
            for a in self.moving
            for b in range(a)
            if b not in self.obstacles and self._may_meet(a, b)
        ]
        for a, b in pairs:
            nearest = min(
                nearest, mujoco.mj_geomDistance(self.model, self.state, a, b, nearest, None)
            )
        return float(nearest)

    def _may_meet(self, a: int, b: int) -> bool:
        """Exclude the base on the table, parts of one link, neighbours, and pairs that the file excludes."""
        if self.links.get(self.names[a], 0) == self.links.get(self.names[b], 0):
            return False
        bodies = (int(self.model.geom_bodyid[a]), int(self.model.geom_bodyid[b]))
        if 0 not in bodies and any(
            self.model.body_parentid[a] == b for a, b in (bodies, bodies[::-1])
        ):
            return False
        return frozenset((self.names[a], self.names[b])) not in self.robot.excluded


def main() -> None:
    """Print the verdicts over some scenes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", type=int, default=10_000)
    parser.add_argument("--scenes", type=int, default=5)
    parser.add_argument("--robot", type=Path, default=Path("trees/robots/sia5f_wsg32.xml"))
    chosen = parser.parse_args()
    for seed in range(chosen.scenes):
        print(f"scene {seed}: {compare(chosen.robot, chosen.states // chosen.scenes, seed)}")


if __name__ == "__main__":
    main()
