"""MotionBenchMaker's problems: MoveIt's scene and request YAML of boxes and cylinders, for any robot.

A set is a folder with `scene0001.yaml`, `request0001.yaml` and so on; a folder of such folders holds several sets.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from pomona.drivers.interfaces import Box
from pomona.executive.values.arrays import Float64
from pomona.executive.values.plain_text import read_plain_text
from pomona.skills.geometry import transform
from pomona.skills.motion.collision import CollisionWorld, Convex, Margins, RobotShape
from pomona.skills.motion.planning.space import PlanningError
from pomona.skills.motion.robot import RobotModel

_NUMBER = re.compile(r"request(\d+)\.yaml$")
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class BadProblem(PlanningError):
    """A file of a planning benchmark that cannot be used."""

    def __init__(self, path: Path, problem: str) -> None:
        self.path, self.problem = path, problem
        super().__init__(f"{path} {problem}")


@dataclass(frozen=True, slots=True, eq=False)
class PlanningProblem:
    """One planning problem."""

    name: str  # set and number
    world: CollisionWorld  # robot and obstacles; margins are zero
    q_start: Float64  # q_start, q_goal: shape (dof,) [rad or m]
    q_goal: Float64


def problem_sets(folder: Path) -> tuple[Path, ...]:
    """Return the folders with requests in them: this one, or those inside; BadProblem if there is none."""
    sets = tuple(sorted({request.parent for request in folder.rglob("request*.yaml")}))
    if not sets:
        raise BadProblem(folder, "holds no request*.yaml of MotionBenchMaker")
    return sets


def read_problems(folder: Path, robot: RobotModel, limit: int = 0) -> Iterator[PlanningProblem]:
    """Yield the problems of one set for a robot, in order, at most `limit` of them; 0 for all.

    Raises BadProblem: a file that cannot be read, a joint that the request lacks, a shape that is not known.
    """
    requests = sorted(path for path in folder.iterdir() if _NUMBER.match(path.name))
    shapes: dict[
        frozenset[frozenset[str]], RobotShape
    ] = {}  # one for all scenes that allow the same contacts
    for request in requests[: limit or None]:
        scene = request.with_name(request.name.replace("request", "scene"))
        yield _problem(f"{folder.name} {request.stem[-4:]}", robot, request, scene, shapes)


def _problem(
    name: str,
    robot: RobotModel,
    request_file: Path,
    scene_file: Path,
    shapes: dict[frozenset[frozenset[str]], RobotShape],
) -> PlanningProblem:
    request, scene = _read(request_file), _read(scene_file)
    try:
        state = request["start_state"]["joint_state"]
        start = dict(zip(state["name"], state["position"], strict=True))
        goal = start | {
            joint["joint_name"]: joint["position"]
            for joint in request["goal_constraints"][0]["joint_constraints"]
        }
        q_start = _joints(robot, start)
        q_goal = _joints(robot, goal)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise BadProblem(
            request_file, f"does not state start and goal of every joint: {error}"
        ) from error
    try:
        obstacles = tuple(_obstacles(scene))
        allowed = _allowed(scene)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise BadProblem(scene_file, f"does not describe boxes and cylinders: {error}") from error
    if allowed not in shapes:
        shapes[allowed] = RobotShape.of(replace(robot, excluded=robot.excluded | allowed))
    world = CollisionWorld.build(
        shapes[allowed], obstacles=obstacles, margins=Margins(0.0, 0.0, 0.0, 0.0, 0.0)
    )
    return PlanningProblem(name, world, q_start, q_goal)


def _joints(robot: RobotModel, values: Mapping[str, Any]) -> Float64:
    """Return joints by name as an array; rounding beyond a limit is taken back, which planners would refuse."""
    q = np.array([float(values[joint]) for joint in robot.joint_names])
    within = np.clip(q, robot.lower, robot.upper)
    # how far a file's joint may lie beyond its limit [rad or m]: files round, and limits too
    return np.where(np.abs(within - q) < 1e-3, within, q)


def _read(path: Path) -> Mapping[str, Any]:
    try:
        content = yaml.load(read_plain_text(path), _LOADER)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise BadProblem(path, f"cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise BadProblem(path, "is no mapping")
    return content


def _obstacles(scene: Mapping[str, Any]) -> Iterator[Convex]:
    for thing in scene["world"]["collision_objects"]:
        T_base_thing = _pose(thing["pose"]) if "pose" in thing else np.eye(4)
        for shape, pose in zip(thing["primitives"], thing["primitive_poses"], strict=True):
            T, size = T_base_thing @ _pose(pose), [float(value) for value in shape["dimensions"]]
            if shape["type"] == "box":
                yield Convex.of_box(
                    Box(thing["id"], T, (size[0] / 2.0, size[1] / 2.0, size[2] / 2.0))
                )
            elif shape["type"] == "cylinder":
                yield Convex.of_cylinder(thing["id"], T, radius=size[1], length=size[0])
            else:
                raise ValueError(f"'{thing['id']}' is a {shape['type']}")


def _pose(pose: Mapping[str, Any]) -> Float64:
    return transform(Rotation.from_quat(pose["orientation"]).as_matrix(), pose["position"])


def _allowed(scene: Mapping[str, Any]) -> frozenset[frozenset[str]]:
    """Return pairs of links that may touch each other."""
    matrix = scene.get("allowed_collision_matrix")
    if matrix is None:
        return frozenset()
    names = matrix["entry_names"]
    return frozenset(
        frozenset((names[i], names[j]))
        for i, row in enumerate(matrix["entry_values"])
        for j, may in enumerate(row)
        if may and i != j
    )
