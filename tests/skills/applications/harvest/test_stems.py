import mujoco
import numpy as np
import pytest

from pomona.applications.harvest.model import SEGMENTS
from pomona.applications.harvest.stems import AT_SPUR, HANGS, TORN, Stems
from pomona.applications.harvest.strength import Strength
from pomona.applications.harvest.wall import draw_wall
from pomona.applications.harvest.wind import Wind

from .conftest import STRONG, branch, build, hanging, one_fruit

WEIGHT = 0.17 * 9.81


class Pulled:
    """One fruit, with a slowly growing load at its stem's seat on the spur."""

    def __init__(self, built):
        self.built, self.data = built, mujoco.MjData(built.model)
        mujoco.mj_forward(built.model, self.data)
        self.stems = Stems(built, self.data)
        self.body = int(built.fruit_bodies[0])
        self.fruit = built.wall.fruits[0]

    def until_broken(self, force=(0, 0, 0), moment=(0, 0, 0), rate=1.0, limit=4.0):
        """The share of force [N] and moment [N·m] at the break; both in the base frame, held in the stem's seat."""
        share, force, moment = 0.0, np.array(force, float), np.array(moment, float)
        while share < limit:
            share += rate * 0.002
            R = self.data.xmat[self.body].reshape(3, 3)
            lever = (
                R @ [0.0, -self.fruit.lever, 0.0]
                + self.data.xpos[self.body]
                - self.data.xipos[self.body]
            )
            self.data.xfrc_applied[self.body] = [
                *(share * force),
                *(share * moment + np.cross(lever, share * force)),
            ]
            mujoco.mj_step(self.built.model, self.data)
            if self.stems.look() >= 0:
                return share
        raise AssertionError("it did not break")


def only(**strength):
    """A stem that gives way to one kind of load; stiff, so that it does not swing away."""
    bears = {"pull": 1e6, "twist": 1e6, "bend": 1e6, "tear": 1e6, "stiffness": 2.0}
    return Strength(**{**bears, **strength})


def test_a_pull_breaks_the_stem_at_its_strength_less_the_fruits_weight(numbers):
    pulled = Pulled(one_fruit(numbers, only(pull=20.0)))
    share = pulled.until_broken(force=(0.0, 0.0, -10.0))
    assert 10.0 * share + WEIGHT == pytest.approx(20.0, rel=0.01)
    assert pulled.stems.state[0] == AT_SPUR
    assert pulled.stems.peak[0] == pytest.approx(20.0, rel=0.01)


def test_a_twist_breaks_it_at_its_strength(numbers):
    pulled = Pulled(one_fruit(numbers, only(twist=0.15)))
    share = pulled.until_broken(moment=(0.0, 0.0, -0.1))
    assert 0.1 * share == pytest.approx(0.15, rel=0.015)


def test_a_bend_breaks_it_at_its_strength_though_the_fruits_weight_helps_to_hold(numbers):
    """The moment in the stem is the applied one, less the weight's lever arm at the bending angle."""
    pulled = Pulled(one_fruit(numbers, only(bend=0.12)))
    share = pulled.until_broken(moment=(0.05, 0.0, 0.0))
    angle = 0.12 / 2.0
    assert 0.05 * share - WEIGHT * pulled.fruit.lever * np.sin(angle) == pytest.approx(
        0.12, rel=0.02
    )


def test_a_stem_that_sits_loosely_in_its_fruit_is_torn_out_and_stays_at_the_spur(numbers):
    built = one_fruit(numbers, only(pull=40.0, tear=15.0))
    pulled = Pulled(built)
    assert 10.0 * pulled.until_broken(force=(0.0, 0.0, -10.0)) + WEIGHT == pytest.approx(
        15.0, rel=0.01
    )
    assert pulled.stems.state[0] == TORN
    assert built.model.geom("fruit_0_torn").rgba[3] == 1.0
    assert built.model.geom("fruit_0_stem").rgba[3] == 0.0


def test_a_fruit_that_came_off_falls_freely_and_the_branch_springs_back(numbers):
    built = build(branch(numbers, fruits=(hanging(),)))
    data = mujoco.MjData(built.model)
    mujoco.mj_forward(built.model, data)
    stems, body, tip = (
        Stems(built, data),
        int(built.fruit_bodies[0]),
        built.model.body("lateral_0_5").id,
    )
    before, rest = data.xpos[body].copy(), data.xpos[tip, 2]
    stems.state[0] = AT_SPUR
    stems.release(0)
    highest = rest
    for _ in range(75):
        mujoco.mj_step(built.model, data)
        highest = max(highest, data.xpos[tip, 2])
    mujoco.mj_kinematics(built.model, data)
    assert before[2] - data.xpos[body, 2] == pytest.approx(0.5 * 9.81 * 0.15**2, rel=0.03)
    assert np.abs(data.xpos[body, :2] - before[:2]).max() < 1e-3
    assert highest > rest + 0.01


def test_the_drawn_wall_is_in_equilibrium(numbers):
    built = build(draw_wall(numbers, 2, fruit=5, leaves=0.1))
    data = mujoco.MjData(built.model)
    mujoco.mj_step(built.model, data, 500)
    assert np.abs(data.qpos - built.model.qpos0).max() < 1e-6
    assert np.abs(data.qvel).max() < 1e-6


def test_a_swinging_fruit_only_ever_loses_energy(numbers):
    built = build(branch(numbers, fruits=(hanging(),)))
    model = built.model
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    data.qvel[built.swing[0]] = data.qvel[built.swing[0] + 2] = 2.0
    energies = []
    for _ in range(1000):
        mujoco.mj_step(model, data)
        energies.append(data.energy.sum())
    energies = np.array(energies)
    lost = energies[0] - energies[-1]
    assert lost > 0.0
    assert np.diff(energies).max() < 1e-3 * lost  # the integrator's ripple


def test_a_minute_of_wind_leaves_finite_numbers_and_a_swing_as_the_source_says(numbers):
    built = build(branch(numbers, fruits=(hanging(),)))
    data = mujoco.MjData(built.model)
    mujoco.mj_forward(built.model, data)
    wind, ys = Wind(built, data, 1.0), []
    for k in range(6000):
        wind.blow(0.01 * k)
        mujoco.mj_step(built.model, data, 5)
        ys.append(data.xpos[built.fruit_bodies[0], 1])
    assert np.isfinite(data.qpos).all()
    assert np.isfinite(data.qvel).all()
    assert 0.015 < np.quantile(np.abs(np.array(ys) - ys[0]), 0.99) < 0.09


def test_two_stems_do_not_break_in_one_step(numbers):
    built = build(draw_wall(numbers, 1, fruit=3, leaves=0.0))
    built.strengths[:, 0] = 1e-3
    data = mujoco.MjData(built.model)
    mujoco.mj_forward(built.model, data)
    stems = Stems(built, data)
    assert [stems.look() >= 0 for _ in range(4)] == [True, True, True, False]
    assert (stems.state != HANGS).all()
    assert len(built.lateral_dofs[0]) == 2 * SEGMENTS
    assert STRONG.pull > 1e5
