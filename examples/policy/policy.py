"""A learned policy as a skill of a package beside Pomona: `pip install ./examples/policy`.

The network is an ONNX file: one input (1, dof + 3), the joints [rad] and the goal of the tool's point in the base frame
[m], float32; one output (1, dof), the joints to move to [rad]. It learns from `pomona runs export --to lerobot`.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import onnxruntime

from pomona.drivers import (
    Arm,
    BadTrajectory,
    DeviceError,
    MotionRefused,
    MotionState,
    SetPoints,
    StreamedArm,
)
from pomona.executive import TIME, Float64, Length, Port, Skill, Time, Work

WATCHDOG = 0.3  # the arm comes to rest when no set-point arrives for this long [s]
MAX_AGE = 0.15  # joint states older than this are not used [s]
STILL = np.deg2rad(0.5)  # the policy has arrived when no joint is to move further than this [rad]
ARRIVED = 0.5  # for this long [s]


class Policy(Skill):
    """Let a learned policy move the arm: from joints and a goal it repeatedly returns the next set-point.

    The driver keeps the arm's limits for any set-point. No camera watches a motion without a plan: after a person was
    noticed the run refuses it, and `pomona check` names the node. The skill ends when the policy demands no motion;
    the tree must check whether that is the goal.
    """

    devices = (Arm, StreamedArm)
    failures = (
        "REFUSED",
        "MOTION_FAILED",
        "BAD_NETWORK",
        "OUT_OF_LIMITS",
        "STALE_JOINTS",
        "TIMEOUT",
    )

    def run(
        self,
        network: Annotated[str, Port(help="ONNX file of the policy")],
        x: Annotated[Length, Port(help="goal of the tool centre point in the base frame")],
        y: Annotated[Length, Port(help="of the goal")],
        z: Annotated[Length, Port(help="of the goal")],
        rate: Annotated[float, Port(min=5, max=100, help="decisions a second")] = 10.0,
        patience: Annotated[Time, Port(min="1 s", help="time limit")] = TIME("15 s"),
    ) -> Work[None]:
        session = self._load(network)
        try:
            motion = self.device(StreamedArm).stream(WATCHDOG)
        except MotionRefused as refused:
            raise self.failure("REFUSED", f"{refused}; nothing has moved") from refused
        try:
            yield from self._follow(motion, session, np.array([x, y, z]), 1.0 / rate, patience)
        except GeneratorExit:
            motion.stop()
            raise
        except BaseException:  # it failed, or the tree interrupts it: the arm comes to rest first
            yield from self._rest(motion)
            raise
        yield from self._rest(motion)
        return

    def _rest(self, motion: SetPoints) -> Work[None]:
        motion.stop()
        while not motion.settled:
            yield "coming to rest"

    def _load(self, network: str) -> Any:
        try:
            return onnxruntime.InferenceSession(network, providers=["CPUExecutionProvider"])
        except Exception as error:  # ONNX Runtime's errors have no common root
            words = f"{network} cannot be read as ONNX: {type(error).__name__}; nothing has moved"
            raise self.failure("BAD_NETWORK", words) from error

    def _follow(
        self, motion: SetPoints, session: Any, goal: Float64, period: float, patience: float
    ) -> Work[None]:
        """Aim at the policy's rate until it wants to go no further."""
        began = self.context.elapsed()  # it stands still in a pause
        wanted_at = began
        decided_at = -np.inf
        while True:
            now = self.context.elapsed()
            if motion.state not in (MotionState.RUNNING, MotionState.PAUSED):
                raise self.failure("MOTION_FAILED", motion.problem or "the motion was stopped")
            if now - began > patience:
                raise self.failure("TIMEOUT", f"it has not arrived within {patience:g} s")
            if motion.state is MotionState.RUNNING and now - decided_at >= period - 1e-6:
                decided_at = now
                q = self._joints()
                target = self._decide(session, q, goal)
                try:
                    motion.aim(target)
                except BadTrajectory as bad:
                    raise self.failure("OUT_OF_LIMITS", f"the policy's set-point: {bad}") from bad
                if np.abs(target - q).max() > STILL:
                    wanted_at = now
                if now - wanted_at >= ARRIVED:
                    return
            yield f"{now - began:.1f} s"

    def _joints(self) -> Float64:
        try:
            state = self.device(Arm).state()
        except DeviceError as lost:
            raise self.failure("STALE_JOINTS", str(lost)) from lost
        age = self.clock.now() - state.stamp
        if not age <= MAX_AGE:  # this form is True also for NaN
            raise self.failure("STALE_JOINTS", f"the joints are {1e3 * age:.0f} ms old")
        return state.q

    def _decide(self, session: Any, q: Float64, goal: Float64) -> Float64:
        """Return the joints to move to, shape (dof,) [rad]."""
        given = np.concatenate([q, goal]).astype(np.float32)[None]
        try:
            target = np.asarray(session.run(None, {session.get_inputs()[0].name: given})[0], float)
        except Exception as error:  # as above
            words = f"the policy fails on {given.size} values: {type(error).__name__}"
            raise self.failure("BAD_NETWORK", words) from error
        if target.shape != (1, len(q)) or not np.isfinite(target).all():
            words = f"the policy returns {target.tolist()}, expected {len(q)} numbers"
            raise self.failure("BAD_NETWORK", words)
        joints: Float64 = target[0]
        return joints
