"""Presses on fruit by every body that touches it, in a small world of its own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import mujoco
import pytest

from pomona.drivers.fruit_body import HARD_MODULUS, PAD_MODULUS, bruising_force
from pomona.tools.simulation.bruises import Presses, press_figures

BALLS = """
<mujoco><option cone="elliptic"/>
 <worldbody>
  <body name="fixed_crate"><geom type="box" size=".2 .2 .01" pos="0 0 -.01"/>
   <geom type="box" size=".01 .2 .1" pos=".048 0 .1"/></body>
  <body name="fruit_0" pos="0 0 .038"><freejoint/><geom type="sphere" size=".038" mass="1"/></body>
  <body name="fruit_1" pos="0 0 .114"><joint type="slide" axis="0 0 1"/>
   <geom type="sphere" size=".038" mass="{mass}"/></body>
  <body name="finger" pos="-.048 0 .038"><joint type="slide" axis="1 0 0"/>
   <geom name="{pad}" type="box" size=".01 .01 .01" mass="1"/>
   <geom name="{spare}" type="box" size=".01 .01 .01" pos="-.1 0 0" mass="1"/>
   <geom name="pad_right" type="box" size=".01 .01 .01" pos="-.2 0 0" mass="1"/></body>
 </worldbody>
</mujoco>
"""
HARD = bruising_force(100e3, 0.038, HARD_MODULUS)


def pressed(
    seconds: float = 0.5, push: float = 0.0, pad: str = "edge", mass: float = 0.0
) -> Presses:
    """Return what was watched while a finger pushes the lower ball of 1 kg against the crate's wall [N]."""
    spare = "edge" if pad == "pad_left" else "pad_left"
    model = mujoco.MjModel.from_xml_string(BALLS.format(pad=pad, spare=spare, mass=mass or 1e-6))
    state = mujoco.MjData(model)
    state.xfrc_applied[model.body("finger").id] = [push, 0.0, 0.0, 0.0, 0.0, 0.0]
    fruits: list[Any] = [SimpleNamespace(name=name) for name in ("apple_1", "apple_2")]
    shapes: list[Any] = 2 * [SimpleNamespace(pressure=100e3, dimensions=(0.076, 0.076, 0.076))]
    presses = Presses(SimpleNamespace(model=model, fruits=fruits, shapes=shapes), state)
    for step in range(round(seconds / 0.002)):
        mujoco.mj_step(model, state)
        if step % 5 == 0:
            presses.watch()
    return presses


def test_a_fruit_that_lies_is_pressed_by_its_weight() -> None:
    told = press_figures(pressed().largest)
    assert told["largest_press"] == pytest.approx(9.81 / HARD, rel=0.02)
    assert told["pressed"] == "apple_1 by crate"
    assert told["bruised"] == 1
    assert press_figures([]) == {"bruised": 0, "largest_press": 0.0, "pressed": ""}


def test_a_fruit_on_another_presses_it() -> None:
    below, above = pressed(mass=2.0).largest
    assert below[1] == "apple_1 by crate"
    assert above == (pytest.approx(2.0 * 9.81 / HARD, rel=0.02), "apple_2 by apple_1")


def test_a_wall_presses_beside_the_floor_and_the_sum_is_of_no_contact() -> None:
    both = pressed(push=30.0)
    assert both.largest[0][0] == pytest.approx(30.0 / HARD, rel=0.05)


def test_a_soft_pad_may_press_more_than_an_edge() -> None:
    ratio = (HARD_MODULUS / PAD_MODULUS) ** 2
    presses = pressed(push=30.0, pad="pad_left")
    assert presses.largest[0][0] == pytest.approx(30.0 / HARD, rel=0.05), "the wall is hard"
    pads = presses._mean / presses._limits
    assert pads[0].max() == pytest.approx(
        ratio * pads[0][presses._names.index("pad_left")], rel=0.05
    )


def test_a_force_that_lasts_bruises_and_a_short_peak_does_not() -> None:
    lasting = pressed(0.5, 20.0)
    short = pressed(0.02, 20.0)
    assert lasting.largest[0][0] > 1.5 * short.largest[0][0]
