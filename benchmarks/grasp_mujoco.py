"""The same grasp in MuJoCo: soft pads on springs, elliptic cones with torsional friction, a fruit with a flat foot.

Its contact is the ellipsoidal limit surface with tau_max linear in the normal force; physics settings are those of the
simulated cell. It has the interface of `grasp_patch.PatchGrasp`.
"""

from __future__ import annotations

import numpy as np

from benchmarks.grasp_patch import GRAVITY, Fruit
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.limit_surface import SoftContact, xi_nu
from pomona.tools.simulation.gl import load_mujoco

TORSION = 0.003
"""Torsional friction of the pads [m]."""


def cone_contact(mu: float, radius: float) -> SoftContact:
    """Return the contact with tau_max = radius * f_n: MuJoCo's elliptic cone with the friction (mu, radius)."""
    return SoftContact(mu, radius / (2.0 * mu * xi_nu(4.0)), 0.0, 4.0, ellipsoid=True)


_SCENE = """
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" cone="elliptic" impratio="1000" solver="Newton" integrator="implicitfast" tolerance="1e-10"/>
  <default>
    <default class="pad">
      <joint type="slide" range="-0.0005 0.020" stiffness="2000" damping="4" solreflimit="0.004 1"/>
      <geom type="box" size="0.010 0.0025 0.010" contype="1" conaffinity="0" condim="4" priority="1"
            friction="{mu} {torsion} 0.0001" solref="0.004 1" solimp="0.95 0.99 0.0005"/>
    </default>
  </default>
  <worldbody>
    <geom name="table" type="plane" size="1 1 .1" priority="1" contype="2" conaffinity="0" condim="6"
          friction="0.3 0.005 0.0005"/>
    <body name="carriage" gravcomp="1" pos="0 0 {grip}">
      <inertial pos="0 0 0" mass="2" diaginertia=".01 .01 .01"/>
      <joint name="up" type="slide" axis="0 0 1" damping="10"/>
      <body name="finger_left" gravcomp="1">
        <inertial pos="0 0 0" mass="0.080" diaginertia=".0001 .0001 .0001"/>
        <joint name="finger_left" type="slide" axis="0 1 0" damping="5" armature="0.5" range="0 0.08"/>
        <body name="pad_left" pos="0 0.0025 0" gravcomp="1">
          <inertial pos="0 0 0" mass="0.015" diaginertia="2e-6 1e-6 1e-6"/>
          <joint class="pad" axis="0 1 0"/>
          <geom name="pad_left" class="pad"/>
          <site name="pad_left" pos="0 -0.0025 0" xyaxes="0 0 -1 1 0 0"/>
        </body>
      </body>
      <body name="finger_right" gravcomp="1">
        <inertial pos="0 0 0" mass="0.080" diaginertia=".0001 .0001 .0001"/>
        <joint name="finger_right" type="slide" axis="0 -1 0" damping="5" armature="0.5" range="0 0.08"/>
        <body name="pad_right" pos="0 -0.0025 0" gravcomp="1">
          <inertial pos="0 0 0" mass="0.015" diaginertia="2e-6 1e-6 1e-6"/>
          <joint class="pad" axis="0 -1 0"/>
          <geom name="pad_right" class="pad"/>
          <site name="pad_right" pos="0 0.0025 0" xyaxes="0 0 -1 -1 0 0"/>
        </body>
      </body>
    </body>
    <body name="fruit" pos="0 {off_centre} {grip}">
      <freejoint/>
      <inertial pos="{x} 0 {z}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
      <geom name="skin" type="sphere" size="{radius}" contype="0" conaffinity="1"/>
      <geom name="foot" type="box" size="0.02 0.02 0.002" pos="0 0 {foot}" contype="0" conaffinity="2"/>
    </body>
  </worldbody>
  <equality>
    <joint joint1="finger_right" joint2="finger_left" polycoef="0 1 0 0 0" solref="0.004 1"/>
  </equality>
  <actuator>
    <position name="up" joint="up" kp="40000" kv="1200"/>
    <intvelocity name="gripper" joint="finger_left" kp="20000" kv="219" actrange="0 0.08" forcerange="-60 60"/>
  </actuator>
  <sensor>
    <contact name="left" geom1="pad_left" geom2="skin" num="1" reduce="netforce" data="force torque pos"/>
    <contact name="right" geom1="pad_right" geom2="skin" num="1" reduce="netforce" data="force torque pos"/>
    <contact name="table" geom1="table" geom2="foot" num="1" data="found"/>
  </sensor>
</mujoco>
"""


class MujocoGrasp:
    """See `PatchGrasp`; `fruit.delta`, `gamma` and `k` are not used."""

    def __init__(self, fruit: Fruit, opening: float | None = None, sample: float = 0.002) -> None:
        if opening is not None or sample != 0.002:
            raise ValueError("the scene has one opening and one time step")
        self._mujoco = load_mujoco()
        radius = 0.5 * fruit.width
        self._grip = radius + 0.004
        self.model = self._mujoco.MjModel.from_xml_string(
            _SCENE.format(
                mu=fruit.mu,
                torsion=TORSION,
                grip=self._grip,
                off_centre=fruit.off_centre,
                x=fruit.offset[0],
                z=fruit.offset[1],
                mass=fruit.mass,
                inertia=fruit.inertia,
                radius=radius,
                foot=-(radius + 0.002),
            )
        )
        self.state = self._mujoco.MjData(self.model)
        opening = 0.5 * fruit.width + 0.006
        for finger in ("finger_left", "finger_right"):
            self.state.joint(finger).qpos[0] = opening
        self.state.act[:] = opening
        for _ in range(250):
            self._mujoco.mj_step(self.model, self.state)
        self.height = self.climb = self.acceleration = 0.0
        self.pull = (0.0, 0.0)
        self.command = 0.0
        self.wrenches = np.zeros((2, 6))
        self._body = self.model.body("fruit").id
        self._rest = float(self.state.body("fruit").xpos[2])

    def step(self) -> Float64:
        """2 ms pass; the true wrenches, shape (2, 6), in the pads' frames."""
        state = self.state
        self.climb += self.acceleration * 0.002
        self.height += self.climb * 0.002
        state.ctrl[0] = self.height + 1200.0 / 40000.0 * self.climb
        state.ctrl[1] = 0.5 * self.command
        state.xfrc_applied[self._body, 0], state.xfrc_applied[self._body, 2] = self.pull
        self._mujoco.mj_step(self.model, state)
        for i, side in enumerate(("left", "right")):
            contact = state.sensor(side).data
            site = state.site(f"pad_{side}")
            R = site.xmat.reshape(3, 3)
            force = -contact[:3]
            torque = -contact[3:6] + np.cross(contact[6:9] - site.xpos, force)
            self.wrenches[i, :3], self.wrenches[i, 3:] = R.T @ force, R.T @ torque
        return self.wrenches

    @property
    def width(self) -> float:
        """Opening between the pads' faces [m]."""
        return float(
            self.state.joint("finger_left").qpos[0] + self.state.joint("finger_right").qpos[0]
        )

    @property
    def f_n(self) -> float:
        """True grasp force, twice the smaller finger's [N]."""
        return 2.0 * float(-self.wrenches[:, 2].max())

    @property
    def place(self) -> tuple[float, float]:
        """The middle of the fruit on the pads, (across, up) [m]."""
        at = self.state.body("fruit").xpos - self.state.body("carriage").xpos
        return float(at[0]), float(at[2])

    @property
    def turn(self) -> float:
        """How far the fruit has turned about the fingers' axis [rad]."""
        R = self.state.body("fruit").xmat.reshape(3, 3)
        return float(np.arctan2(R[0, 2], R[2, 2]))

    @property
    def off_table(self) -> bool:
        return float(self.state.body("fruit").xpos[2]) - self._rest > 0.002


def least_grasp_force_of_cone(fruit: Fruit) -> float:
    """Theoretical least grasp force in the elliptic cone of a fruit that hangs still [N]."""
    weight = fruit.mass * GRAVITY
    return float(np.hypot(weight / fruit.mu, weight * fruit.offset[0] / TORSION))
