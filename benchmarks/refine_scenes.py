"""The paper's five apples, seen from anywhere around them: in the simulated cell, and as stretched models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from benchmarks.synthetic_depth import as_d435i, looking_at, standing, true_depth
from pomona.drivers.interfaces import Frame, Intrinsics
from pomona.executive.cell.connect import load_cell
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import apply, inverse, rot_y, transform
from pomona.skills.perception.detection.detection import DetectorOptions
from pomona.skills.perception.detection.instances import cuboid_keypoints
from pomona.skills.perception.fruit import FruitModel
from pomona.skills.shared.looking import find_in_frame
from pomona.tools.simulation.gl import in_gl_thread, load_mujoco, open_renderer
from pomona.tools.simulation.world import SimWorld

CAMERA = Intrinsics(610.6, 610.6, 319.5, 239.5, 640, 480)
ROBOT_GROUP = 1
DETECTOR_WIDTH = 320


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A look at one apple.

    Attributes:
        apple: its name in the cell file.
        depth: as a D435i measures it.
        T_base_camera, table_z: pose of the camera, height of the table [m].
        T_camera_detected: pose by the detector; None when it did not find this apple.
        T_camera_true, dimensions: truth.
        elevation: of the camera above the table [deg].
    """

    apple: str
    depth: NDArray[np.float32]
    T_base_camera: Float64
    table_z: float
    T_camera_detected: Float64 | None
    T_camera_true: Float64
    dimensions: Float64
    elevation: float


def cell_views(
    cell_file: Path, fruit: FruitModel, elevations: tuple[float, ...], seeds: range, detector: bool
) -> list[View]:
    """Look at each of the five apples of the simulated cell from each elevation [deg], in one scene per seed."""
    found = []
    for seed in seeds:
        cell = load_cell(cell_file, seed=seed, overrides={"others": "4", "distractors": "2"})
        try:
            world = cell.devices["world"]
            assert isinstance(world, SimWorld)
            found += _views_of(
                world, fruit, elevations, detector, np.random.default_rng([seed, 77])
            )
        finally:
            cell.close()
    return found


def _views_of(
    world: SimWorld,
    fruit: FruitModel,
    elevations: tuple[float, ...],
    detector: bool,
    rng: np.random.Generator,
) -> list[View]:
    table_z = world.scene.table_z
    found = []
    world.looked()
    truths: Any = world.truth()["fruits"]
    for apple in truths:
        T_base_fruit = np.array(apple["T_base_fruit_at_look"])
        for elevation in elevations:
            target = T_base_fruit[:3, 3] + rng.normal(0.0, 0.02, 3)
            T_base_camera = looking_at(
                target, 0.6, np.radians(elevation), rng.uniform(-np.pi, np.pi)
            )
            colour, ideal = in_gl_thread(partial(_render, world, T_base_camera))
            noisy = colour + rng.normal(0.0, 2.0, colour.shape)
            colour = np.clip(cv2.GaussianBlur(noisy, (0, 0), 0.6), 0, 255).astype(np.uint8)
            depth = as_d435i(ideal.astype(np.float64), rng, CAMERA)
            T_true = inverse(T_base_camera) @ T_base_fruit
            dimensions = np.array(apple["dimensions_m"])
            if detector:
                frame = Frame(0.0, 0, colour, depth, CAMERA, None, T_base_camera)
                T_detected = _detect(frame, fruit, T_true)
            else:
                T_detected = _simulated_detection(T_true, dimensions, fruit, rng)
            found.append(
                View(
                    apple["name"],
                    depth,
                    T_base_camera,
                    table_z,
                    T_detected,
                    T_true,
                    dimensions,
                    elevation,
                )
            )
    return found


def stretched_views(
    fruit: FruitModel,
    apples: Mapping[str, tuple[Any, ...]],
    elevations: tuple[float, ...],
    seeds: range,
) -> list[View]:
    """The model stretched to each apple's dimensions [mm], alone on a table, from each elevation [deg]."""
    found = []
    for index, (name, (size, *_)) in enumerate(apples.items()):
        for elevation in elevations:
            for seed in seeds:
                rng = np.random.default_rng([index, int(elevation), seed])
                tilt, azimuth = rng.uniform(0.0, np.radians(15.0)), rng.uniform(-np.pi, np.pi)
                apple = standing(fruit, np.array(size) / 1e3, tilt=tilt, azimuth=azimuth)
                target = apple.T_base_object[:3, 3] + rng.normal(0.0, 0.02, 3)
                T_base_camera = looking_at(target, 0.6, np.radians(elevation))
                depth = as_d435i(true_depth([apple], T_base_camera, CAMERA), rng, CAMERA)
                T_true = inverse(T_base_camera) @ apple.T_base_object
                T_detected = _simulated_detection(T_true, apple.dimensions, fruit, rng)
                found.append(
                    View(
                        name,
                        depth,
                        T_base_camera,
                        0.0,
                        T_detected,
                        T_true,
                        apple.dimensions,
                        elevation,
                    )
                )
    return found


def leaf_over(view: View, share: float = 0.5) -> View:
    """The same look with a flat leaf, 20 mm in front of the apple, over a share of its width; the pose stays."""
    rng = np.random.default_rng(int(1e6 * view.T_camera_true[0, 3] % 1e5))
    centre, radius = view.T_camera_true[:3, 3], 0.5 * float(view.dimensions.mean())
    direction = rng.uniform(0.0, 2.0 * np.pi)
    v, u = np.indices(view.depth.shape)
    middle = CAMERA.K @ (centre / centre[2])
    across = (u - middle[0]) * np.cos(direction) + (v - middle[1]) * np.sin(direction)
    along = (v - middle[1]) * np.cos(direction) - (u - middle[0]) * np.sin(direction)
    reach = CAMERA.fx * radius / centre[2]
    inside = (2.0 * share - 1.0) * reach
    leaf = (across < inside) & (across > -1.6 * reach) & (np.abs(along) < 1.6 * reach)
    surface = centre[2] - radius - 0.02 + 1e-4 * across
    noise = gaussian_filter(rng.normal(0.0, 1.0, view.depth.shape), 1.0)
    return replace(
        view,
        depth=np.where(leaf, surface + 1e-3 * noise / noise.std(), view.depth).astype(np.float32),
    )


def _simulated_detection(
    T_true: Float64, dimensions: Float64, fruit: FruitModel, rng: np.random.Generator
) -> Float64:
    """The pose that PnP finds with the CAD cuboid for the true cuboid's corners, seen with 1.5 px of error."""
    towards = T_true[:3, :3].T @ -T_true[:3, 3]
    facing = T_true @ transform(
        rot_y(np.arctan2(towards[0], towards[2]) + np.pi + rng.normal(0.0, 0.1))
    )
    corners = apply(facing, cuboid_keypoints(dimensions))
    pixels = corners[:, :2] / corners[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]
    pixels += rng.normal(0.0, 1.5, pixels.shape)
    model = cuboid_keypoints(fruit.dimensions)
    _, turn, shift = cv2.solvePnP(model, pixels, CAMERA.K, None, flags=cv2.SOLVEPNP_EPNP)
    turn, shift = cv2.solvePnPRefineLM(model, pixels, CAMERA.K, None, turn, shift)
    return transform(cv2.Rodrigues(turn)[0], shift[:, 0])


def _detect(frame: Frame, fruit: FruitModel, T_true: Float64) -> Float64 | None:
    """The detector's pose of the apple at T_true: the instance whose centre lies in its direction, within 2 degrees."""
    ray = T_true[:3, 3] / np.linalg.norm(T_true[:3, 3])
    best, least = None, np.cos(np.radians(2.0))
    for instance in find_in_frame(frame, fruit, DetectorOptions(working_width=DETECTOR_WIDTH)):
        if instance.T_camera_object is None or instance.score < 0.5:
            continue
        p = instance.T_camera_object[:3, 3]
        if p @ ray / np.linalg.norm(p) > least:
            best, least = instance.T_camera_object, p @ ray / np.linalg.norm(p)
    return best


def _render(
    world: SimWorld, T_base_camera: Float64
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Colour and ideal z-depth from a free camera, without the robot."""
    mujoco = load_mujoco()
    world.model.vis.global_.fovy = np.degrees(2.0 * np.arctan(0.5 * CAMERA.height / CAMERA.fy))
    forward = T_base_camera[:3, 2]
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.distance = 0.6
    camera.lookat[:] = T_base_camera[:3, 3] + 0.6 * forward
    camera.azimuth = np.degrees(np.arctan2(forward[1], forward[0]))
    camera.elevation = np.degrees(np.arcsin(forward[2]))
    shown = mujoco.MjvOption()
    shown.geomgroup[ROBOT_GROUP] = 0
    renderer = open_renderer(world.model, CAMERA.height, CAMERA.width)
    try:
        renderer.update_scene(world.state, camera=camera, scene_option=shown)
        colour = renderer.render().copy()
        renderer.enable_depth_rendering()
        renderer.update_scene(world.state, camera=camera, scene_option=shown)
        depth = renderer.render().copy()
    finally:
        renderer.close()
    depth[depth > 5.0] = 0.0
    return colour, depth
