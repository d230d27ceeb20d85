"""A force sensor that lies, in every way and in every phase of a grip, on the simulated cell.

    python -m benchmarks.grip_faults [--seed 1] [--kinds stuck_left zero …] [--phases lifting …]

Each case puts the open fingers around a fruit, grips, feels its friction, lifts, holds and puts down, and lets the
fingers lie from somewhere in one phase on, for good or for 0.3 s. What the run says is compared with the simulator's
truth: a success that is none, a force above the limit, a fruit dropped, and how long it took until the run ended.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.sim.arm import SimArm
from drivers.sim.finger_faults import LIES
from drivers.sim.fingers import SimFingers
from drivers.sim.world import SimWorld
from executive.execute import RunOrder, execute
from executive.files import find_cell
from executive.running.events import Event, NodeChanged, SafeStopped
from executive.running.runner import Runner
from skills.geometry import rot_z, transform
from skills.motion.robot import RobotModel
from skills.motion.robot.inverse_kinematics import inverse_kinematics

TREE = Path(__file__).with_suffix(".yaml")
PHASES = {
    "preparing": ("SlipAvoidGrasp", -1.0),
    "closing": ("SlipAvoidGrasp", 0.25),
    "pressing": ("FeelFriction", 0.02),
    "feeling": ("FeelFriction", 0.5),
    "lifting": ("Lift", 0.25),
    "holding": ("Lift", 1.1),
    "releasing": ("Release", 0.1),
}
"""In which phase a fault begins: so many seconds after this node's start, or before the run."""

AWHILE = 0.3
"""How long a passing fault lasts [s]."""

HUNG = 0.05
"""A fruit this far above where it stood hangs when Lift has ended [m]; it was lifted by twice as much."""

FORCE_MAX = 14.0
"""What the tree allows for both fingers together [N]."""


@dataclass(frozen=True, slots=True)
class Case:
    """One fault in one phase; `lasting` 0 for good [s]."""

    kind: str
    phase: str
    lasting: float = 0.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a case.

    Attributes:
        outcome, code, message: as the run says.
        hung: the fruit hung between the fingers when Lift said so; None where Lift did not succeed.
        dropped: a fruit that hung fell.
        peak: largest force, both fingers together [N].
        found_after: from the fault's beginning to the safe stop [s]; NaN where the run went on.
    """

    outcome: str
    code: str
    message: str
    hung: bool | None
    dropped: bool
    peak: float
    found_after: float

    @property
    def false_success(self) -> bool:
        """Lift said that the fruit hangs, and it did not."""
        return self.hung is False


class _Injector:
    """Steps with the world: begins and ends the fault, and notes the truth."""

    def __init__(self, runner: Runner, case: Case, world: SimWorld, fingers: SimFingers) -> None:
        self._runner, self._case, self._world, self._fingers = runner, case, world, fingers
        self._node, self._after = PHASES[case.phase]
        self._started: dict[str, float] = {}
        self.began = self.stopped = np.nan
        self.peak = 0.0
        self.hung: bool | None = None
        self._wrenches = [world.sensor(f"wrench_{pad}") for pad in ("pad_left", "pad_right")]
        self._rest = float(world.state.body("fruit_0").xpos[2])
        world.after_step.insert(0, self._step)

    def on_event(self, event: Event) -> None:
        """Learn from the run's events when nodes start and end, and when the cell is stopped."""
        if isinstance(event, SafeStopped) and np.isnan(self.stopped):
            self.stopped = self._world.clock.now()
        if isinstance(event, NodeChanged):
            node = event.path.rsplit("/", 1)[-1]
            if event.status == "RUNNING":
                self._started.setdefault(node, self._world.clock.now())
            if node == "Lift" and event.status == "SUCCESS":
                self.hung = float(self._world.state.body("fruit_0").xpos[2]) - self._rest > HUNG

    def _step(self) -> None:
        now = self._world.clock.now()
        self.peak = max(self.peak, sum(float(np.linalg.norm(view[:3])) for view in self._wrenches))
        start = 0.0 if self._after < 0.0 else self._started.get(self._node, np.inf)
        if np.isnan(self.began) and now >= start + max(self._after, 0.0):
            self._fingers.inject_fault(self._case.kind)
            self.began = now
        if self._case.lasting and now > self.began + self._case.lasting and self._fingers.fault is not None:
            self._fingers.clear_fault()


def run_case(case: Case, seed: int = 1, fruit: str = "apple_4") -> Outcome:
    """Run one case on a fresh simulated cell."""
    injectors: list[_Injector] = []

    def on_ready(runner: Runner) -> None:
        cell: Any = runner._cell  # the simulated one, with its devices by name
        world, fingers = cell.devices["world"], cell.devices["fingers"]
        _put_fingers_around(world, cell.devices["arm"])
        injectors.append(_Injector(runner, case, world, fingers))

    def on_event(event: Event) -> None:
        if injectors:
            injectors[0].on_event(event)

    settings = {"fruit": fruit, "place": "2", "distractors": "0"}
    text = TREE.read_text()
    if case.phase != "releasing":  # what plans takes long to prepare
        text = "\n".join(line for line in text.splitlines() if "- Release" not in line)
    order = RunOrder(TREE, find_cell("sim"), seed, settings, texts={str(TREE): text})
    executed = execute(order, [on_event], on_ready=on_ready)
    result, injector = executed.result, injectors[0]
    reason, truth = result.reason, result.truth or {}
    return Outcome(
        outcome=result.outcome,
        code=reason.code if reason else "",
        message=reason.message if reason else "",
        hung=injector.hung,
        dropped=bool(truth.get("drops", 0)),
        peak=injector.peak,
        found_after=injector.stopped - injector.began,
    )


def _put_fingers_around(world: SimWorld, arm: SimArm) -> None:
    """The arm stands, with open fingers, where an approach would have left it."""
    robot = RobotModel.load(arm.description)
    centre = world.state.body("fruit_0").xpos - [0.0, 0.0, 0.004]
    q_before = arm.state().q
    for angle in np.linspace(0.0, np.pi, 16, endpoint=False):
        T_base_tcp = transform(rot_z(angle) @ np.diag([1.0, -1.0, -1.0]), centre)
        solutions = inverse_kinematics(robot, T_base_tcp, near=q_before)
        if len(solutions):
            break
    q = solutions[0]
    state = world.state
    state.qpos[world.model.jnt_qposadr[world.arm_joints]] = q
    state.ctrl[world.arm_actuators] = q
    arm._set_point[:] = q
    opening = world.model.joint("finger_left").range[1]
    for finger in ("finger_left", "finger_right"):
        state.joint(finger).qpos[0] = opening
    state.act[:] = opening
    world.mujoco.mj_forward(world.model, state)


def all_cases() -> list[Case]:
    """Every way to lie in every phase for good, and the passing ones that a driver may show for a while."""
    lasting = [Case(kind, phase) for kind in LIES for phase in PHASES]
    passing = [
        Case(kind, phase, AWHILE)
        for kind in ("stuck_left", "zero", "not_a_number", "old")
        for phase in ("closing", "feeling", "lifting")
    ]
    return lasting + passing


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="*", choices=tuple(LIES))
    parser.add_argument("--phases", nargs="*", choices=tuple(PHASES))
    arguments = parser.parse_args()
    cases = [
        case
        for case in all_cases()
        if (not arguments.kinds or case.kind in arguments.kinds)
        and (not arguments.phases or case.phase in arguments.phases)
    ]
    print(f"{'fault':18}{'phase':12}{'outcome':10}{'hung':6}{'peak N':>7}{'ended ms':>9}  reason")
    outcomes = []
    for case in cases:
        outcome = run_case(case, arguments.seed)
        outcomes.append(outcome)
        kind = case.kind + (" 0.3 s" if case.lasting else "")
        hung = {None: "–", True: "yes", False: "NO"}[outcome.hung]
        ended = f"{1e3 * outcome.found_after:9.0f}" if np.isfinite(outcome.found_after) else f"{'–':>9}"
        print(
            f"{kind:18}{case.phase:12}{outcome.outcome:10}{hung:6}{outcome.peak:7.1f}{ended}  "
            f"{outcome.code} {outcome.message}"[:200],
            flush=True,
        )
    peaks = [outcome.peak for outcome in outcomes]
    found = [1e3 * outcome.found_after for outcome in outcomes if np.isfinite(outcome.found_after)]
    print(
        f"\n{len(cases)} cases: {sum(o.false_success for o in outcomes)} false successes, "
        f"{sum(peak > FORCE_MAX for peak in peaks)} above {FORCE_MAX:.0f} N (the most was {max(peaks):.1f} N), "
        f"{sum(o.dropped for o in outcomes)} dropped; ended in the safe state {len(found)} times"
        + (f", after {np.median(found):.0f} ms at the median, {max(found):.0f} at most" if found else "")
    )


if __name__ == "__main__":
    main()
