"""The simulated world: physics stepped by its clock, with hooks for the devices that live in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.cell.device import Device, FaultSwitch
from pomona.executive.cell.errors import DeviceFault
from pomona.executive.values.arrays import Float64
from pomona.tools.simulation.gl import load_mujoco
from pomona.tools.simulation.intruder import Intruder, IntruderSection
from pomona.tools.simulation.layout import gather
from pomona.tools.simulation.scene import TIMESTEP, SimScene
from pomona.tools.simulation.score import Scorer

SETTLING = 1.0  # time for the objects on the table to come to rest before the run starts [s]


class SimClock:
    """The world's time: it stands still unless it is advanced."""

    simulated = True

    def __init__(self, step: Callable[[], None]) -> None:
        self._step = step
        self._owed = 0.0
        self.steps = 0

    def now(self) -> float:
        return self.steps * TIMESTEP

    def advance(self, duration: float) -> None:
        """Step the world; a rest shorter than a step is kept for the next call."""
        self._owed += max(duration, 0.0)
        count = int(self._owed / TIMESTEP + 1e-6)
        self._owed -= count * TIMESTEP
        for _ in range(count):
            self._step()


class PhysicsWorld(Device):
    """MuJoCo's model and state, and the clock that steps them; a robot with its devices lives in it.

    Attributes:
        score: of a subclass; it watches every fifth step, and reports.
        description: the robot's file.
        before_step, after_step: hooks of the devices, called in order around every physics step.
    """

    score: Any

    def __init__(self, model: Any, description: Path, q_start: Float64, seed: int) -> None:
        super().__init__("world")
        self.mujoco = load_mujoco()
        self.description = description
        self.seed = seed
        self.intruder: Intruder | None = None
        self.model: Any = model
        self.state: Any = self.mujoco.MjData(self.model)
        self.before_step: list[Callable[[], None]] = []
        self.after_step: list[Callable[[], None]] = []
        arm = [i for i in range(self.model.nu) if self.model.actuator(i).name != "gripper"]
        self.arm_actuators = np.array(
            sorted(arm, key=lambda i: self.model.actuator_trnid[i, 0])
        )  # from base to tool
        self.arm_joints = self.model.actuator_trnid[self.arm_actuators, 0]
        self._place_robot(q_start)
        self._settle()
        self.clock = SimClock(self._advance_one_step)

    def truth(self) -> Mapping[str, object]:
        """Return the world's own score."""
        return {**self.score.report(), **({} if self.intruder is None else self.intruder.truth())}

    def looked(self) -> None:
        """A camera looks now."""

    def watch(self) -> None:
        """Observe the world, 100 times a second."""
        if self.intruder is not None:
            self.intruder.measure()
        self.score.watch()

    def invite(self, said: IntruderSection | None) -> None:
        """Let a person's hand come, whose body the model has."""
        if said is not None:
            self.intruder = Intruder(
                self.mujoco, self.model, self.state, self.model.jnt_dofadr[self.arm_joints], said
            )
            self.before_step.append(self.intruder.step)

    @property
    def switches(self) -> Mapping[str, FaultSwitch]:
        """Events that can be caused in the world, beside its devices' faults."""
        return {} if self.intruder is None else {"intruder": self.intruder}

    def check(self) -> None:
        """Raise DeviceFault if the physics was unstable: MuJoCo has then put everything back to its beginning."""
        for kind in (self.mujoco.mjtWarning.mjWARN_BADQVEL, self.mujoco.mjtWarning.mjWARN_BADQACC):
            if (bad := self.state.warning[kind]).number:
                raise DeviceFault(
                    "world",
                    "the simulation became unstable at the body "
                    f"'{self.model.body(self.model.dof_bodyid[bad.lastinfo]).name}'; it shows nothing",
                )

    def sensor(self, name: str) -> Float64:
        """Return a live view of a sensor's numbers, as many as it has and in its own units, shape (n,)."""
        sensor = self.model.sensor(name)
        view: Float64 = self.state.sensordata[sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]
        return view

    def _place_robot(self, q_start: Float64) -> None:
        """Arm at its start, fingers three quarters open."""
        addresses = self.model.jnt_qposadr[self.arm_joints]
        self.state.qpos[addresses] = q_start
        self.state.ctrl[self.arm_actuators] = q_start
        opening = 0.75 * self.model.joint("finger_left").range[1]
        self.state.joint("finger_left").qpos[0] = self.state.joint("finger_right").qpos[0] = opening
        self.state.act[:] = opening

    def _settle(self) -> None:
        for _ in range(round(SETTLING / TIMESTEP)):
            self.mujoco.mj_step(self.model, self.state)
        self.state.time = 0.0

    def _advance_one_step(self) -> None:
        for hook in self.before_step:
            hook()
        self.mujoco.mj_step(self.model, self.state)
        self.clock.steps += 1
        for hook in self.after_step:
            hook()
        if self.clock.steps % 5 == 0:
            self.watch()


class SimWorld(PhysicsWorld):
    """The table with fruit on it, and the score that only reports read."""

    def __init__(self, scene: SimScene, description: Path, q_start: Float64, seed: int) -> None:
        self.scene = scene
        super().__init__(scene.model, description, q_start, seed)
        self.score = Scorer(scene, self.state)
        self.invite(scene.intruder)

    def _settle(self) -> None:
        if self.scene.gathering is not None:
            sizes = np.array([fruit.dimensions[:2] for fruit in self.scene.fruits])
            gather(self.mujoco, self.model, self.state, sizes, self.scene.gathering, self.seed)
        super()._settle()

    def looked(self) -> None:
        """A camera looks now: remember where the fruit truly is."""
        self.score.note_look()


class FaultyDevice(Device, FaultSwitch):
    """A simulated device with a switch."""

    def __init__(self, name: str) -> None:
        Device.__init__(self, name)
        FaultSwitch.__init__(self)
