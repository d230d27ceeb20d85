"""The simulated arm: follows joint trajectories with velocity feed-forward, stops and pauses on its path."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.drivers.errors import (
    BadTrajectory,
    DeviceError,
    DeviceFault,
    DeviceLost,
    MotionRefused,
)
from pomona.drivers.interfaces import (
    Arm,
    ArmLimits,
    ArmState,
    Motion,
    MotionState,
    SetPoints,
    StreamedArm,
    Trajectory,
)
from pomona.drivers.motion_supervisor import MotionSupervisor, Supervision
from pomona.drivers.path_motion import PathMotion, Phase
from pomona.drivers.streamed_motion import StreamedMotion
from pomona.drivers.trajectory import START_TOLERANCE, check_trajectory
from pomona.executive.values.arrays import Float64
from pomona.tools.simulation.scene import TIMESTEP
from pomona.tools.simulation.world import FaultyDevice, PhysicsWorld

AT_REST = 5e-3  # no joint moves faster than this when the arm rests [rad/s]
PRESSES_BEYOND = START_TOLERANCE / 2.0
"""Distance to the set-point of a stop beyond which the arm presses on an obstacle [rad]: half of the tolerance at the
start of the next motion, since a pressed arm moves on a little as the obstacle yields (after a slow approach onto a
fruit 2.0 mrad were left, and the path back was refused).
"""
LIES = ("nan", "wild", "jump", "frozen")  # faults of the arm's feedback, not of its motion
JUMP = 0.6  # step that the fault `jump` adds to the first joint's position [rad]


class SimArm(FaultyDevice):
    """The robot's arm joints, from base to tool.

    Faults: `alarm` (the controller decelerates and reports a fault), `lost` (the same, and no answer), `nan`, `wild`,
    `jump` (implausible feedback), `frozen` (the same feedback for ever), `stuck` (the joints stand still at any
    command), `stall` (the controller interrupts a motion without a report).
    """

    interfaces = (Arm, StreamedArm)
    known_faults = ("alarm", "lost", "nan", "wild", "jump", "frozen", "stuck", "stall")

    def __init__(
        self, world: PhysicsWorld, description: Path, supervision: Supervision | None = None
    ) -> None:
        super().__init__("arm")
        self.description = description
        self._world = world
        model = world.model
        self._actuators = world.arm_actuators
        self._qpos = model.jnt_qposadr[world.arm_joints]
        self._qvel = model.jnt_dofadr[world.arm_joints]
        kp = model.actuator_gainprm[self._actuators, 0]
        kv = -model.actuator_biasprm[self._actuators, 2]
        self._feed_forward = kv / kp
        ranges = model.jnt_range[world.arm_joints]
        self.limits = ArmLimits(
            ranges[:, 0].copy(),
            ranges[:, 1].copy(),
            *(
                model.numeric(f"arm_{name}").data.copy()
                for name in ("velocity", "acceleration", "jerk")
            ),
        )
        self._set_point: Float64 = world.state.ctrl[self._actuators].copy()
        self._motion: PathMotion | StreamedMotion | None = None
        self._speed = 1.0
        self._steps = 0
        self._gives_way = False
        self._rests_since = np.inf
        self._latched: str | None = None
        self._supervisor = MotionSupervisor(self.name, self.limits, supervision or Supervision())
        self._state = self._measure()
        world.before_step.append(self._command)
        world.after_step.append(self._watch)

    def state(self) -> ArmState:
        """Reported state of its joints; if that is implausible, the last plausible one."""
        measured = self._measure()
        if self.fault not in LIES and np.isfinite(measured.q).all():
            self._state = measured
        return self._state

    def follow(self, trajectory: Trajectory) -> Motion:
        self._need_ready()
        try:
            check_trajectory(trajectory, self.limits, self.state().q)
        except BadTrajectory as bad:
            raise MotionRefused(self.name, bad.problem) from bad
        self._supervisor.end()
        self._gives_way = False
        self._motion = PathMotion(trajectory, self.limits, TIMESTEP, self._speed, self._set_point)
        return self._motion

    def stream(self, watchdog: float) -> SetPoints:
        self._need_ready()
        self._supervisor.end()
        self._gives_way = False
        now = self._world.clock.now
        motion = self._motion = StreamedMotion(
            self._set_point, self.limits, TIMESTEP, watchdog, self._speed, now
        )
        return motion

    def _need_ready(self) -> None:
        if self._latched is not None:
            raise MotionRefused(self.name, f"latched in the safe state ({self._latched})")
        if self._problem is not None or self.fault in ("alarm", "lost"):
            raise MotionRefused(
                self.name, f"not ready: {self._problem.message if self._problem else self.fault}"
            )
        if self._motion is not None and not self._motion.settled:
            raise MotionRefused(
                self.name, "still moves; stop the motion and wait until it has settled"
            )

    def _wrong(self) -> DeviceError | None:
        if self.fault == "lost":
            return DeviceLost(self.name, "does not answer")
        if self.fault == "alarm":
            return DeviceFault(self.name, "the controller reports an alarm")
        return self._problem

    def inject_fault(self, kind: str) -> None:
        self._state = self._measure()
        super().inject_fault(kind)
        if self._motion is not None and kind in ("alarm", "lost"):
            self._motion.fail(f"the arm's controller stopped: {kind}")

    def safe_stop(self, reason: str) -> None:
        self._latched = reason
        if self._motion is not None:
            self._motion.stop()

    def acknowledge(self) -> None:
        """Release the latch. Raises DeviceLost: the feedback is still implausible."""
        if self.fault in LIES:
            raise DeviceLost(
                self.name,
                f"is still lost: {self._problem.message if self._problem else self.fault}",
            )
        self._supervisor.forget()
        self._latched = self._problem = None

    def pause(self) -> None:
        if self._motion is not None:
            self._motion.pause()

    def resume(self) -> None:
        if self._motion is not None:
            self._motion.resume()

    def go_at(self, speed: float) -> None:
        self._speed = speed
        if self._motion is not None:
            self._motion.set_speed(speed)

    def settled(self) -> bool:
        motion = self._motion
        return motion is None or motion.settled or (motion.at_rest and self._rests())

    def _rests(self) -> bool:
        return bool(np.abs(self._world.state.qvel[self._qvel]).max() < AT_REST)

    def _command(self) -> None:
        motion = self._motion
        if motion is not None and not (motion.settled or self._gives_way) and self.fault != "stall":
            q, qd = motion.step()
            self._steps += 1
            self._set_point = q
            if self.fault != "stuck":
                self._world.state.ctrl[self._actuators] = q + self._feed_forward * qd

    def _measure(self) -> ArmState:
        state = self._world.state
        q = state.qpos[self._qpos].copy()
        qd = state.qvel[self._qvel].copy()
        return ArmState(self._world.clock.now(), q, qd, not self.settled())

    def _said(self) -> tuple[Float64, Float64]:
        """Return positions and velocities as the arm reports them, with injected faults."""
        measured = self._measure()
        match self.fault:
            case "nan":
                return np.full_like(measured.q, np.nan), measured.qd
            case "wild":
                return np.full_like(measured.q, 1e30), measured.qd
            case "jump":
                return measured.q + JUMP * (np.arange(measured.q.size) == 0), measured.qd
            case "frozen":
                return self._state.q, self._state.qd
        return measured.q, measured.qd

    def _supervise(self, motion: PathMotion | StreamedMotion | None) -> None:
        now = self._world.clock.now()
        try:
            if motion is not None and not motion.settled:
                self._supervisor.command(now, self._set_point)
            self._supervisor.on_feedback(now, *self._said())
            if motion is not None and not motion.settled and motion.state is not MotionState.FAILED:
                self._supervisor.look(now, motion, self._steps)
            elif self._problem is None and (motion is None or motion.settled):
                self._supervisor.end()
                self._supervisor.look_at_rest(self._said()[0])
        except DeviceLost as error:
            self._problem = self._problem or error
            if motion is not None:
                motion.fail(error.message)  # braking on the path needs no feedback
        except DeviceFault as error:
            self._problem = self._problem or error
            if motion is not None and not motion.problem:
                motion.fail(error.message)  # an encoder may be wrong, too
            elif motion is not None and not motion.settled:  # its controller does not brake either
                motion.abandon(motion.problem)
                self._hold_here()

    def _hold_here(self) -> None:
        """Move the set-point to the arm's position, as a controller does at a stop."""
        self._gives_way = True
        self._set_point = self._measure().q
        self._world.state.ctrl[self._actuators] = self._set_point

    def _watch(self) -> None:
        motion = self._motion
        if self._supervisor.due(self._world.clock.now()):
            self._supervise(motion)
        if motion is not None and not motion.settled and motion.set_point_rests:
            self._rests_since = min(self._rests_since, self._world.clock.now())
            # time beside the set-point of a stop after which the arm presses on an obstacle [s]
            self._settle(motion, self._world.clock.now() - self._rests_since > 0.05)
        else:
            self._rests_since = np.inf

    def _settle(self, motion: PathMotion | StreamedMotion, long: bool) -> None:
        """Bring the arm to rest at a resting set-point, `long` or recent; release a stop's obstacle."""
        state = self._world.state
        beside = float(np.abs(state.qpos[self._qpos] - self._set_point).max())
        resting = self._rests()
        presses = motion.phase is Phase.BRAKING and beside > PRESSES_BEYOND
        motion.look(resting and not presses, beside, float(state.time))
        if presses and long:
            self._hold_here()  # repeatedly: an elastic obstacle moves it on
            self._rests_since = np.inf
