"""Hands in the simulated cell: they hold the target between the pads and pull it, as a person does at a real one."""

from __future__ import annotations

import numpy as np

from pomona.drivers.interfaces import Hands, HandTask
from pomona.executive.cell.device import Device
from pomona.executive.values.arrays import Float64
from pomona.tools.simulation.layout import PADS
from pomona.tools.simulation.scene import TIMESTEP
from pomona.tools.simulation.world import SimWorld

# of a hand that holds on [N/m] and against turning [N·m/rad]
STIFFNESS = 1500.0
TURNING_STIFFNESS = 0.5
# speeds of a pull [m/s], a twist [rad/s], and a pull in a twist [m/s]
PULL = 0.002
TWIST = 0.08
TWIST_PULL = 0.0003
FARTHEST = 0.005  # they do not pull farther than this: the fruit stays between the pads [m]
GRAVITY = 9.81


class SimHands(Device):
    """Springs between the target fruit and where the hands want it. They let it lie until they are asked to hold it."""

    interfaces = (Hands,)

    def __init__(self, world: SimWorld) -> None:
        super().__init__("hands")
        self._world = world
        self._body = world.model.body("fruit_0").id
        self._address = int(world.model.joint("fruit_0").qposadr[0])
        self._dof = int(world.model.joint("fruit_0").dofadr[0])
        self._mass = float(world.model.body_mass[self._body])
        self._inertia = float(world.model.body_inertia[self._body].min())
        self._holding = False
        self._p, self._R = np.zeros(3), np.eye(3)
        self._pull = 0.0
        self._twist = 0.0
        self._pulled = 0.0
        self._way = 1.0
        world.before_step.append(self._act)

    def do(self, task: HandTask) -> None:
        self._pull = self._twist = 0.0
        if task is HandTask.HOLD:
            self._take()
        elif task in (HandTask.PULL, HandTask.TWIST) and self._holding:
            self._p, self._R = self._pose()  # no strain is left from the pull before
            self._way = -self._way
            self._pulled = 0.0
            self._pull = TWIST_PULL if task is HandTask.TWIST else PULL
            self._twist = TWIST if task is HandTask.TWIST else 0.0

    def _take(self) -> None:
        """Put the fruit's middle between the pads, standing as it would when it is picked."""
        state = self._world.state
        first, second = (state.site(pad) for pad in PADS)
        approach, closing = (first.xmat.reshape(3, 3)[:, i] for i in (0, 2))
        self._R = np.stack([np.cross(closing, -approach), closing, -approach], axis=1)
        self._p = 0.5 * (first.xpos + second.xpos)
        state.qpos[self._address : self._address + 3] = self._p
        quaternion = np.zeros(4)
        self._world.mujoco.mju_mat2Quat(quaternion, self._R.ravel())
        state.qpos[self._address + 3 : self._address + 7] = quaternion
        state.qvel[self._dof : self._dof + 6] = 0.0
        self._world.mujoco.mj_forward(self._world.model, state)
        self._holding = True

    def _pose(self) -> tuple[Float64, Float64]:
        body = self._world.state.body("fruit_0")
        return np.array(body.xpos), np.array(body.xmat.reshape(3, 3))

    def _act(self) -> None:
        """The springs' force and moment for this step."""
        if not self._holding:
            return
        pad = self._world.state.site(PADS[0]).xmat.reshape(3, 3)
        if self._pulled < FARTHEST:
            self._p = self._p + self._way * self._pull * TIMESTEP * pad[:, 0]
            self._pulled += self._pull * TIMESTEP
            self._R = _turned(pad[:, 2], self._twist * TIMESTEP) @ self._R
        p, R = self._pose()
        body = self._world.state.body("fruit_0")
        speed = body.cvel[3:]
        turning = body.cvel[:3]
        error = 0.5 * sum((np.cross(R[:, i], self._R[:, i]) for i in range(3)), start=np.zeros(3))
        damping = 2.0 * np.sqrt(STIFFNESS * self._mass)
        turning_damping = 2.0 * np.sqrt(TURNING_STIFFNESS * self._inertia)
        force = STIFFNESS * (self._p - p) - damping * speed + [0.0, 0.0, self._mass * GRAVITY]
        self._world.state.xfrc_applied[self._body, :3] = force
        self._world.state.xfrc_applied[self._body, 3:] = (
            TURNING_STIFFNESS * error - turning_damping * turning
        )


def _turned(axis: Float64, angle: float) -> Float64:
    x, y, z = axis * angle
    return np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
