import mujoco
import numpy as np
import pytest

from pomona.applications.harvest.wood import (
    bending_stress,
    hinge_chain,
    second_moment,
    spur_stiffness,
)

from .conftest import branch, build

E, D, L = 1.1e9, 0.010, 0.4
EI = E * np.pi * D**4 / 64.0


def test_a_chain_gives_way_as_the_beam_does_but_for_a_quarter_over_the_squared_count():
    """Σ (L - sₖ)²·h over the middles of n elements is L³/3·(1 - 1/(4n²)): the trapezoid's error, exactly."""
    for count in (3, 6, 12):
        chain = hinge_chain(L, (D, D), E, count)
        tip = chain.deflection(np.array([L]), np.array([L]), np.array([2.0]))[0]
        assert tip == pytest.approx(
            2.0 * L**3 / (3.0 * EI) * (1.0 - 1.0 / (4.0 * count**2)), rel=1e-12
        )


def test_a_tapered_chain_nears_the_integral_over_the_beam():
    ends = (0.014, 0.007)
    s = np.linspace(0.0, L, 20001)
    beam = np.trapezoid(
        (L - s) ** 2 / (E * second_moment(ends[0] + (ends[1] - ends[0]) * s / L)), s
    )
    tip = hinge_chain(L, ends, E, 6).deflection(np.array([L]), np.array([L]), np.array([1.0]))[0]
    assert tip == pytest.approx(beam, rel=0.01)


def test_the_mass_of_a_taper_is_the_cones():
    chain = hinge_chain(L, (0.016, 0.008), E, 6)
    s = np.linspace(0.1, 0.3, 20001)
    assert chain.mass(1000.0, 0.1, 0.3) == pytest.approx(
        1000.0 * np.trapezoid(np.pi / 4 * chain.diameter(s) ** 2, s), rel=1e-6
    )


def test_a_point_mass_on_a_light_chain_swings_with_its_stiffness():
    chain = hinge_chain(L, (D, D), E, 6)
    k = 1.0 / chain.deflection(np.array([L]), np.array([L]), np.array([1.0]))[0]
    assert chain.first_frequency(np.array([L]), np.array([0.2])) == pytest.approx(
        np.sqrt(k / 0.2), rel=1e-12
    )


def test_a_spurs_tip_gives_way_as_a_cantilevers():
    k = spur_stiffness(0.05, 0.005, E)
    assert 0.05**2 / k == pytest.approx(0.05**3 / (3.0 * E * second_moment(0.005)))


def test_bending_stress_is_moment_over_section_modulus():
    assert bending_stress(2.0, D) == pytest.approx(2.0 * (D / 2.0) / second_moment(D))


@pytest.fixture(scope="module")
def bare(numbers):
    return build(branch(numbers, L, D))


def _tip(built, data):
    body = built.model.body("lateral_0_5").id
    end = data.xmat[body].reshape(3, 3) @ [L / 12.0, 0.0, 0.0]
    return data.xpos[body] + end


def _press(built, force, steps):
    """The tip's way under a force across the branch, after some steps."""
    data = mujoco.MjData(built.model)
    mujoco.mj_forward(built.model, data)
    before, body = _tip(built, data).copy(), built.model.body("lateral_0_5").id
    for _ in range(steps):
        lever = _tip(built, data) - data.xipos[body]
        data.xfrc_applied[body] = [*force, *np.cross(lever, force)]
        mujoco.mj_step(built.model, data)
        mujoco.mj_kinematics(built.model, data)
    return _tip(built, data) - before


def test_a_simulated_branch_bends_as_beam_theory_says(bare):
    for axis in (1, 2):
        force = np.zeros(3)
        force[axis] = 0.2
        moved = _press(bare, force, 900)[axis]
        assert moved == pytest.approx(0.2 * L**3 / (3.0 * EI), rel=0.015)


def test_a_loaded_branch_swings_at_the_beams_frequency(bare):
    """√(3EI / ((m + 33/140·m_beam)·L³)): Rayleigh's mass of the beam at its tip."""
    model, load = bare.model, 0.3
    body = model.body("lateral_0_5").id
    kept = (
        model.body_mass[body],
        model.body_ipos[body].copy(),
        model.body_inertia[body].copy(),
        model.dof_damping.copy(),
    )
    own = 1000.0 * np.pi / 4.0 * D**2 * L
    try:
        model.body_mass[body] += load
        model.body_ipos[body] = [L / 12.0, 0.0, 0.0]
        model.dof_damping[:] = 0.0
        model.opt.gravity[:] = 0.0
        model.qpos_spring[:] = model.qpos0
        data = mujoco.MjData(model)
        data.qvel[bare.lateral_dofs[0, 1::2]] = 0.02
        ys = []
        for _ in range(1500):
            mujoco.mj_step(model, data)
            ys.append(_tip(bare, data)[1])
        crossings = np.flatnonzero(np.diff(np.sign(np.array(ys) - ys[0])))
        y = np.array(ys) - np.mean(ys[crossings[0] : crossings[-1]])
        up = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
        times = 0.002 * (up - y[up] / (y[up + 1] - y[up]))
        found = 1.0 / np.diff(times).mean()
    finally:
        (
            model.body_mass[body],
            model.body_ipos[body],
            model.body_inertia[body],
            model.dof_damping[:],
        ) = kept
        model.opt.gravity[:] = [0.0, 0.0, -9.81]
    assert found == pytest.approx(
        np.sqrt(3.0 * EI / ((load + 33.0 / 140.0 * own) * L**3)) / (2.0 * np.pi), rel=0.012
    )
