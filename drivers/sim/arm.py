"""The simulated arm: follows joint trajectories with velocity feed-forward, stops and pauses on its path."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drivers.errors import BadTrajectory, DeviceFault, DeviceLost, MotionRefused
from drivers.interfaces import Arm, ArmLimits, ArmState, Float64, Motion, Trajectory
from drivers.path_motion import PathMotion
from drivers.sim.faults import FaultyDevice
from drivers.sim.scene import TIMESTEP
from drivers.sim.world import SimWorld
from drivers.trajectory import check_trajectory

AT_REST = 5e-3
"""No joint moves faster than this when the arm rests [rad/s]."""


class SimArm(FaultyDevice):
    """The robot's arm joints, in the order of the robot file's actuators.

    Faults: `alarm` (the controller decelerates and reports a fault), `lost` (the same, and no answer).
    """

    interfaces = (Arm,)
    known_faults = ("alarm", "lost")

    def __init__(self, world: SimWorld, description: Path) -> None:
        super().__init__("arm")
        self.description = description
        self._world = world
        model = world.model
        self._actuators = world.arm_actuators
        self._qpos = model.jnt_qposadr[world.arm_joints]
        self._qvel = model.jnt_dofadr[world.arm_joints]
        kp, kv = model.actuator_gainprm[self._actuators, 0], -model.actuator_biasprm[self._actuators, 2]
        self._feed_forward = kv / kp
        ranges = model.jnt_range[world.arm_joints]
        self.limits = ArmLimits(
            ranges[:, 0].copy(),
            ranges[:, 1].copy(),
            *(model.numeric(f"arm_{name}").data.copy() for name in ("velocity", "acceleration", "jerk")),
        )
        self._set_point: Float64 = world.state.ctrl[self._actuators].copy()
        self._motion: PathMotion | None = None
        self._latched: str | None = None
        world.before_step.append(self._command)
        world.after_step.append(self._watch)

    def state(self) -> ArmState:
        state = self._world.state
        return ArmState(
            self._world.clock.now(), state.qpos[self._qpos].copy(), state.qvel[self._qvel].copy(), not self.settled()
        )

    def follow(self, trajectory: Trajectory) -> Motion:
        if self._latched is not None:
            raise MotionRefused(self.name, f"latched in the safe state ({self._latched})")
        if self.fault is not None:
            raise MotionRefused(self.name, f"not ready: {self.fault}")
        if self._motion is not None and not self._motion.settled:
            raise MotionRefused(self.name, "still moves; stop the motion and wait until it has settled")
        try:
            check_trajectory(trajectory, self.limits, self._set_point)
        except BadTrajectory as bad:
            raise MotionRefused(self.name, bad.problem) from bad
        self._motion = PathMotion(trajectory, self.limits, TIMESTEP)
        return self._motion

    def check(self) -> None:
        if self.fault == "lost":
            raise DeviceLost(self.name, "does not answer")
        if self.fault == "alarm":
            raise DeviceFault(self.name, "the controller reports an alarm")

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        if self._motion is not None:
            self._motion.fail(f"the arm's controller stopped: {kind}")

    def safe_stop(self, reason: str) -> None:
        self._latched = reason
        if self._motion is not None:
            self._motion.stop()

    def acknowledge(self) -> None:
        self._latched = None

    def pause(self) -> None:
        if self._motion is not None:
            self._motion.pause()

    def resume(self) -> None:
        if self._motion is not None:
            self._motion.resume()

    def settled(self) -> bool:
        return self._motion is None or self._motion.at_rest

    def _command(self) -> None:
        motion = self._motion
        if motion is not None and not motion.settled:
            q, qd = motion.step()
            self._set_point = q
            self._world.state.ctrl[self._actuators] = q + self._feed_forward * qd

    def _watch(self) -> None:
        motion = self._motion
        if motion is not None and not motion.settled and motion.set_point_rests:
            state = self._world.state
            beside = float(np.abs(state.qpos[self._qpos] - self._set_point).max())
            motion.look(bool(np.abs(state.qvel[self._qvel]).max() < AT_REST), beside, float(state.time))
