"""The skill Policy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np

from pomona.applications.policy.policy_network import PolicyNetwork, UnusablePolicy, read_policy
from pomona.drivers import (
    Arm,
    BadTrajectory,
    DeviceError,
    MotionRefused,
    MotionState,
    SetPoints,
    StreamedArm,
)
from pomona.executive import ANGLE, TIME, Angle, Float64, Length, Port, SkillFailure, Time, Work
from pomona.skills import MOTION_FAILURES, MovingSkill


class Policy(MovingSkill):
    """Let a learned policy move the arm: from joints and a goal it repeatedly returns the next target.

    The arm's driver keeps its limits for any target, and comes to rest without one for the `watchdog`'s time. A target
    that is not finite, outside the joints' limits or based on old joints stops the arm. The skill ends when the policy
    demands no motion; the tree must check whether that is the goal. Interrupted, the arm comes to rest within its
    limits.
    """

    devices = (Arm, StreamedArm)
    failures = (
        *MOTION_FAILURES,
        "BAD_WEIGHTS",
        "NOT_FINITE",
        "OUT_OF_LIMITS",
        "STALE_JOINTS",
        "TIMEOUT",
    )

    def prepare(self) -> None:
        weights = self.known("weights")
        if weights:
            self._network(weights)

    def run(
        self,
        weights: Annotated[str, Port(help="file of the policy (.npz)")],
        x: Annotated[Length, Port(help="goal of the tool centre point in the base frame")],
        y: Annotated[Length, Port(help="of the goal")],
        z: Annotated[Length, Port(help="of the goal")],
        patience: Annotated[Time, Port(min="1 s", help="time limit")] = TIME("15 s"),
        watchdog: Annotated[
            Time,
            Port(
                min="50 ms",
                max="2 s",
                help="the arm comes to rest when no set-point arrives for this long",
            ),
        ] = TIME("300 ms"),
        max_age: Annotated[
            Time, Port(min="10 ms", max="1 s", help="joint states older than this are not used")
        ] = TIME("150 ms"),
        still: Annotated[
            Angle,
            Port(
                min="0.01 deg",
                help="the policy has arrived when no joint is to move further than this",
            ),
        ] = ANGLE("0.5 deg"),
    ) -> Work[None]:
        network = self._network(weights)
        try:
            motion = self.device(StreamedArm).stream(watchdog)
        except MotionRefused as refused:
            raise self.failure(
                "REFUSED", f"{refused}; nothing has moved", device=refused.device
            ) from refused
        try:
            yield from self._aim(motion, network, np.array([x, y, z]), patience, max_age, still)
        except GeneratorExit:
            motion.stop()
            raise
        except BaseException:
            motion.stop()
            while not motion.settled:
                yield "stopping"
            raise
        motion.stop()
        while not motion.settled:
            yield "coming to rest"
        return None

    def _network(self, weights: str) -> PolicyNetwork:
        try:
            network = read_policy(Path(weights))
        except UnusablePolicy as bad:
            raise self.failure("BAD_WEIGHTS", f"{bad}; nothing has moved", file=weights) from bad
        dof = self.device(Arm).limits.lower.size
        if len(network.joints) != dof:
            words = f"{weights} moves {len(network.joints)} joints, the arm has {dof}; nothing has moved"
            raise self.failure("BAD_WEIGHTS", words, file=weights)
        return network

    def _aim(
        self,
        motion: SetPoints,
        network: PolicyNetwork,
        goal: Float64,
        patience: float,
        max_age: float,
        still: float,
    ) -> Work[None]:
        """Decide at the policy's rate until it wants to go no further."""
        began, decided_at, wanted_at = self.context.elapsed(), -np.inf, self.context.elapsed()
        while True:
            if motion.state not in (MotionState.RUNNING, MotionState.PAUSED):
                code = "STOPPED" if motion.state is MotionState.STOPPED else "MOTION_FAILED"
                raise self.failure(code, motion.problem or "the motion was stopped before its end")
            now = self.context.elapsed()  # it stands still in a pause
            if motion.state is MotionState.PAUSED:
                wanted_at = now
                yield "paused"
                continue
            if now - decided_at >= 1.0 / network.rate - 1e-6:
                decided_at = now
                way = self._decide(motion, network, goal, max_age)
                wanted_at = now if way > still else wanted_at
                if (
                    now - wanted_at >= 0.5
                ):  # time without a demanded motion after which a policy has arrived [s]
                    return
            if self.context.elapsed() - began > patience:
                raise self.failure(
                    "TIMEOUT", f"it has not arrived within {patience:g} s", patience_s=patience
                )
            yield f"{self.context.elapsed() - began:.1f} s"

    def _decide(
        self, motion: SetPoints, network: PolicyNetwork, goal: Float64, max_age: float
    ) -> float:
        """Aim once; the farthest that any joint shall go [rad]."""
        try:
            state = self.device(Arm).state()
        except DeviceError as lost:
            raise self.failure(
                "STALE_JOINTS", f"{lost}: there are no joints to decide on"
            ) from lost
        age = self.clock.now() - state.stamp
        if not age <= max_age:  # this form is True also for NaN
            raise self.failure(
                "STALE_JOINTS",
                f"the joints are {1e3 * age:.0f} ms old: too old to decide on",
                age_s=age,
            )
        wanted = network.set_point(state.q, goal)
        if not np.isfinite(wanted).all():
            raise self._no_number(wanted)
        try:
            motion.aim(wanted)
        except BadTrajectory as bad:
            joint = None if bad.joint is None else bad.joint + 1
            raise self.failure(
                "OUT_OF_LIMITS", f"the policy leaves the limits: {bad}", joint=joint
            ) from bad
        return float(np.abs(wanted - state.q).max())

    def _no_number(self, wanted: Float64) -> SkillFailure:
        joint = int(np.argmin(np.isfinite(wanted))) + 1
        return self.failure(
            "NOT_FINITE", f"the policy returns {wanted[joint - 1]} for joint {joint}", joint=joint
        )
