"""A scripted picker with known poses: it proves the simulated cell, and knows nothing of skills."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pomona.drivers.interfaces import (
    Arm,
    ArmLimits,
    ForceSensor,
    Gripper,
    Motion,
    Trajectory,
    WrenchSample,
)
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.executive.values.arrays import Float64
from pomona.tools.simulation.gl import load_mujoco
from pomona.tools.simulation.world import SimWorld

TICK = 0.02
SIM = Path(__file__).resolve().parents[4] / "trees" / "cells" / "sim.yaml"


def rest_to_rest(waypoints: Float64, limits: ArmLimits, share: float = 0.6) -> Trajectory:
    """A quintic in path time through joint waypoints (n, dof), within a share of the limits."""
    points = np.asarray(waypoints, np.float64)
    s = np.linspace(0.0, 1.0, len(points))
    fine = np.linspace(0.0, 1.0, 400)
    path = np.column_stack([np.interp(fine, s, points[:, j]) for j in range(points.shape[1])])
    if len(points) > 2:
        spline = CubicSpline(s, points, axis=0)
        path, first, second = spline(fine), spline(fine, 1), spline(fine, 2)
    else:
        first = np.broadcast_to(points[1] - points[0], path.shape)
        second = np.zeros_like(path)
    duration = 0.05
    while True:
        x = np.linspace(0.0, 1.0, 400)
        w = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        wd = 30.0 * x**2 * (1.0 - x) ** 2 / duration
        wdd = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / duration**2
        lookup = [
            np.column_stack([np.interp(w, fine, a[:, j]) for j in range(a.shape[1])])
            for a in (first, second)
        ]
        qd = lookup[0] * wd[:, None]
        qdd = lookup[1] * wd[:, None] ** 2 + lookup[0] * wdd[:, None]
        qddd = np.diff(qdd, axis=0) / (x[1] * duration)
        load = max(
            (np.abs(qd) / limits.velocity).max(),
            (np.abs(qdd) / limits.acceleration).max(),
            (np.abs(qddd) / limits.jerk).max(),
        )
        if load <= share:
            break
        duration *= 1.05
    q = np.column_stack([np.interp(w, fine, path[:, j]) for j in range(path.shape[1])])
    return Trajectory(x * duration, q, qd, qdd)


def solve_ik(model: Any, q: Float64, T_base_tcp: Float64) -> Float64:
    """Damped least squares from a near configuration; asserts that it converged."""
    mujoco = load_mujoco()
    state = mujoco.MjData(model)
    site = model.site("tcp").id
    q = q.copy()
    jacobian = np.zeros((6, model.nv))
    for _ in range(300):
        state.qpos[:7] = q
        mujoco.mj_kinematics(model, state)
        mujoco.mj_comPos(model, state)
        rotation = state.site_xmat[site].reshape(3, 3)
        twist = T_base_tcp[:3, :3] @ rotation.T
        axis = 0.5 * np.array(
            [twist[2, 1] - twist[1, 2], twist[0, 2] - twist[2, 0], twist[1, 0] - twist[0, 1]]
        )
        error = np.concatenate([T_base_tcp[:3, 3] - state.site_xpos[site], axis])
        if np.abs(error).max() < 1e-6 and np.trace(twist) > 2.9:
            return q
        mujoco.mj_jacSite(model, state, jacobian[:3], jacobian[3:], site)
        J = jacobian[:, :7]
        q = q + J.T @ np.linalg.solve(J @ J.T + 1e-5 * np.eye(6), error)
    raise AssertionError("no inverse kinematics for the probe's pose")


def tool_down(position: Float64, azimuth: float, tilt: float = 0.0) -> Float64:
    """T_base_tcp: approach axis down, tilted about the fingers' axis, `azimuth` turns the fingers [rad]."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    ct, st = np.cos(tilt), np.sin(tilt)
    T = np.eye(4)
    T[:3, :3] = (
        np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        @ np.array([[ct, 0.0, st], [0.0, 1.0, 0.0], [-st, 0.0, ct]])
        @ np.diag([1.0, -1.0, -1.0])
    )
    T[:3, 3] = position
    return T


class Probe:
    """Moves a simulated cell tick by tick; force control runs in the sensor's stream."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        world = cell.devices["world"]
        assert isinstance(world, SimWorld)
        self.world = world
        self.arm, self.gripper = cell.device(Arm), cell.device(Gripper)
        self.force_wanted = 0.0
        self.samples: list[WrenchSample] = []
        self.lower, self.upper = self.arm.limits.lower, self.arm.limits.upper
        self._bias = np.zeros((2, 6))
        self._subscription = cell.device(ForceSensor).subscribe(self._on_sample)
        self._count = 0
        self._gripping = False

    def run(self, motion: Motion, limit: float = 20.0) -> Motion:
        self.wait(lambda: motion.settled, limit)
        return motion

    def wait(self, done: Callable[[], bool], limit: float = 20.0) -> None:
        end = self.cell.clock.now() + limit
        while not done():
            assert self.cell.clock.now() < end, "the probe waited too long"
            self.cell.check()
            self.cell.clock.advance(TICK)

    def go_down_to(self, position: Float64) -> Motion:
        """Above a position, then down to it with the tool pointing down; the motion down is returned running."""
        above, line, _ = _reachable_grasp(self, np.asarray(position), 0.05)
        self.run(
            self.arm.follow(rest_to_rest(np.array([self.set_point(), above]), self.arm.limits))
        )
        return self.arm.follow(rest_to_rest(line, self.arm.limits))

    def set_point(self) -> Float64:
        point: Float64 = self.world.state.ctrl[self.world.arm_actuators].copy()
        return point

    def take_bias(self) -> None:
        self.samples.clear()
        self.wait(lambda: len(self.samples) >= 100)
        self._bias = np.mean([sample.wrenches for sample in self.samples], axis=0)

    def grip(self, force: float) -> None:
        """Close until both fingers feel the fruit, then hold `force` on each."""
        self.force_wanted, self._gripping = force, True
        self.wait(lambda: bool(np.all(self.forces() > 0.9 * force)))
        end = self.cell.clock.now() + 0.5
        self.wait(lambda: self.cell.clock.now() >= end)

    def let_go(self) -> None:
        """End force control."""
        self._gripping = False

    def forces(self) -> Float64:
        recent = np.mean([sample.wrenches for sample in self.samples[-10:]], axis=0) - self._bias
        forces: Float64 = -recent[:, 2]
        return forces

    def fruit_centre(self) -> Float64:
        centre: Float64 = self.world.state.body("fruit_0").xpos.copy()
        return centre

    def _on_sample(self, sample: WrenchSample) -> None:
        self.samples.append(sample)
        self._count += 1
        if self._gripping and self._count % 10 == 0:
            force = float(self.forces().min())
            speed = -20.0 * (self.force_wanted - force) / 4000.0
            if force < 0.4:
                speed = -0.024
            self.gripper.set_speed(2.0 * max(speed, -0.012) if force >= 0.4 else speed)


def pick(probe: Probe, height: float = 0.12, force: float | None = None) -> None:
    """Open → above the fruit → down → grip → up, with the first azimuth that the arm can reach."""
    centre = probe.fruit_centre() - np.array([0.0, 0.0, 0.004])
    probe.run(probe.gripper.move(0.101, 0.1))
    probe.run(probe.go_down_to(centre))
    lift = _reachable_grasp(probe, centre, height)[2]
    lift[0] = probe.set_point()
    probe.take_bias()
    mass = probe.world.scene.fruits[0].mass
    probe.grip(force or max(2.2, 1.5 * mass * 9.81 / probe.world.scene.pads.friction))
    probe.run(probe.arm.follow(rest_to_rest(lift, probe.arm.limits, share=0.25)))
    end = probe.cell.clock.now() + 0.5
    probe.wait(lambda: probe.cell.clock.now() >= end)


def _reachable_grasp(
    probe: Probe, centre: Float64, height: float
) -> tuple[Float64, Float64, Float64]:
    """Joints above the fruit, and waypoints down to it and up again."""
    for azimuth in np.linspace(0.0, np.pi, 8, endpoint=False):
        grasp = tool_down(centre, azimuth)
        above, up = grasp.copy(), grasp.copy()
        above[2, 3] += 0.12
        up[2, 3] += height
        try:
            q = [solve_ik(probe.world.model, probe.set_point(), above)]
            for pose in (*_between(above, grasp), *_between(grasp, up)):
                q.append(solve_ik(probe.world.model, q[-1], pose))
        except AssertionError:
            continue
        joints = np.array(q)
        if np.all(joints > probe.lower + 0.02) and np.all(joints < probe.upper - 0.02):
            return joints[0], joints[:11], joints[10:]
    raise AssertionError("the probe finds no way to the fruit")


def _between(start: Float64, end: Float64) -> list[Float64]:
    return [start + s * (end - start) for s in np.linspace(0.1, 1.0, 10)]


@pytest.fixture
def open_cell() -> Iterator[Callable[..., Cell]]:
    """Open the shipped simulated cell; options as keywords."""
    opened: list[Cell] = []

    def open_with(seed: int = 0, **options: str) -> Cell:
        opened.append(load_cell(SIM, seed=seed, overrides={"distractors": "0", **options}))
        return opened[-1]

    yield open_with
    for cell in opened:
        cell.close()


@pytest.fixture
def probe_of() -> type[Probe]:
    return Probe


@pytest.fixture
def pick_with() -> Callable[..., None]:
    return pick


@pytest.fixture
def plan_rest_to_rest() -> Callable[..., Trajectory]:
    return rest_to_rest
