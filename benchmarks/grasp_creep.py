"""Creep of a held fruit in MuJoCo: how fast contacts below the friction limit slide, and which options reduce it.

    python -m benchmarks.grasp_creep

Two pads press on a sphere with a constant force and hold it against gravity. MuJoCo's friction has no memory of where
a contact began: its constraint has the reference acceleration -b·v, so a held load needs a velocity. With the row's
regulariser R and its damping b the steady velocity is v = R·f_t / b, which is printed beside the simulated one.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np

from pomona.tools.simulation.gl import load_mujoco

GRAVITY = 9.81
SCENE = """
<mujoco>
  <option timestep="{timestep}" cone="{cone}" impratio="{impratio}" noslip_iterations="{noslip}" solver="Newton"
          integrator="implicitfast" tolerance="1e-12"/>
  <default>
    <geom friction="{mu} 0.003 0.0001" condim="4" solref="{timeconst} 1" solimp="{impedance} 0.0005"/>
  </default>
  <worldbody>
    <body gravcomp="1" pos="0 0.0425 0">
      <joint name="left" type="slide" axis="0 -1 0"/>
      <geom name="left" type="box" size="0.01 0.0025 0.01" mass="0.6" priority="1"/>
    </body>
    <body gravcomp="1" pos="0 -0.0425 0">
      <joint name="right" type="slide" axis="0 1 0"/>
      <geom name="right" type="box" size="0.01 0.0025 0.01" mass="0.6" priority="1"/>
    </body>
    <body name="fruit">
      <freejoint/>
      <geom name="fruit" type="sphere" size="0.04" mass="{mass}"/>
    </body>
  </worldbody>
  <equality><joint joint1="right" joint2="left" polycoef="0 1 0 0 0" solref="0.004 1"/></equality>
  <actuator><motor joint="left"/><motor joint="right"/></actuator>
</mujoco>
"""


class Options(NamedTuple):
    """Options of the engine and of the contact."""

    cone: str = "elliptic"
    impratio: float = 1000.0
    noslip: int = 0
    timestep: float = 0.002  # [s]
    timeconst: float = 0.004  # of the contact [s]
    impedance: str = "0.95 0.99"  # smallest and largest


def creep(
    options: Options, mass: float, mu: float, ratio: float, duration: float = 1.0
) -> tuple[float, float]:
    """Return the velocity at which a held fruit slides [m/s]: simulated, and by the rows of its contacts.

    Args:
        mass: of the fruit [kg].
        ratio: force of a pad over the minimum grip force.
    """
    mujoco = load_mujoco()
    model = mujoco.MjModel.from_xml_string(SCENE.format(mass=mass, mu=mu, **options._asdict()))
    state = mujoco.MjData(model)
    state.ctrl[:] = ratio * mass * GRAVITY / (2.0 * mu)
    body = model.body("fruit").id
    closing = round(0.4 / options.timestep)
    for step in range(closing + round(duration / options.timestep)):
        state.xfrc_applied[body, 2] = (
            mass * GRAVITY if step < closing // 2 else 0.0
        )  # no load until the pads press
        mujoco.mj_step(model, state)
        if step == closing:
            began = float(state.xpos[body, 2])
    expected = [_by_row(mujoco, model, state, contact) for contact in state.contact]
    return (began - float(state.xpos[body, 2])) / duration, float(np.mean(expected))


def _by_row(mujoco: Any, model: Any, state: Any, contact: Any) -> float:
    """Return R·f/b of the vertical friction of one contact [m/s]; not a number for a pyramidal cone."""
    if contact.dim < 3 or model.opt.cone != mujoco.mjtCone.mjCONE_ELLIPTIC:
        return float("nan")
    rows = [contact.efc_address + 1, contact.efc_address + 2]
    return float(
        np.hypot(
            *(state.efc_R[row] * state.efc_force[row] / state.efc_KBIP[row][1] for row in rows)
        )
    )


def main() -> None:
    """Print the velocities."""
    print(
        "| options | creep, median of 12 [mm/s] | most | R·f/b, median [mm/s] | 3 s in the hand, median [mm] |"
    )
    print("|---|--:|--:|--:|--:|")
    cases = tuple(itertools.product((0.05, 0.2, 0.4), (0.3, 0.9), (1.1, 2.0)))
    for words, options in {
        "as the cell: elliptic, impratio 1000": Options(),
        "impratio 100": Options(impratio=100.0),
        "impratio 10": Options(impratio=10.0),
        "impratio 1 (MuJoCo's default)": Options(impratio=1.0),
        "impratio 1, pyramidal (MuJoCo's default)": Options("pyramidal", 1.0),
        "impratio 1, 10 iterations without slip": Options(impratio=1.0, noslip=10),
        "time step 1 ms, impratio 1000": Options(timestep=0.001),
        "impedance 0.9 to 0.95, impratio 1000": Options(impedance="0.90 0.95"),
        "time constant 20 ms (default), impratio 1000": Options(timeconst=0.02),
    }.items():
        found = np.array([creep(options, *case) for case in cases]) * 1e3
        measured, expected = np.abs(found[:, 0]), found[:, 1]
        print(f"| {words} | {np.median(measured):.3g} | {measured.max():.3g} | {np.median(expected):.3g} "
              f"| {3.0 * np.median(measured):.2g} |")  # fmt: skip


if __name__ == "__main__":
    main()
