"""The reference by the probability of slip: its load filter and quantile against closed forms, and one lift."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from benchmarks.bench_grasp import NOISE, draw_tasks, settings_for
from benchmarks.compare_grasp import CASES, figures, lift, summary
from benchmarks.grasp_patch import PatchGrasp
from benchmarks.grasp_probability import (
    CALM,
    HIT,
    MOVE,
    LoadState,
    ProbabilityController,
    ProbabilityReference,
    ProbabilitySettings,
    advance_load,
    least_distribution,
    smallest_force,
    unknown_load,
)
from benchmarks.grasp_trial import Lifting, run_trial
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.estimate import GripEstimate
from pomona.skills.grip.limit_surface import SoftContact, least_force, surface_table
from pomona.skills.grip.settings import ForceLaw, GripSettings

PERIOD = 0.002
SETTINGS = ProbabilitySettings()
NOISE_VARIANCE = np.array([0.08, 0.08, 4e-6])
CONTACT = SoftContact(mu=0.6)
TABLE = surface_table(CONTACT)


def follow(
    loads: Float64, state: LoadState | None = None, is_carried: bool = True, **changes: float
) -> LoadState:
    """Let the filter take measured loads, shape (n, 3)."""
    state = unknown_load() if state is None else state
    for load in loads:
        state = advance_load(
            state, load, NOISE_VARIANCE, PERIOD, is_carried, SETTINGS._replace(**changes)
        )
    return state


def standing(force: float, moment: float = 0.0, variance: float = 0.0) -> LoadState:
    """A load that is known and calm."""
    state = unknown_load()
    state.mean[:, 0, 0], state.mean[:, 2, 0] = force, moment
    state.variance[:] = variance
    return state


def force_for(state: LoadState, s_mu: float = 0.0, reserve: float = 0.0, **changes: float) -> float:
    return float(
        smallest_force(
            state, TABLE, (s_mu, 1e-9, 0.0), reserve, SETTINGS._replace(**changes), 80.0
        )[1]
    )


def test_there_are_at_most_25_constants() -> None:
    assert len(SETTINGS) <= 25


@pytest.mark.slow
def test_a_calm_load_has_the_variance_of_the_steady_kalman_filter() -> None:
    """P = (Q + sqrt(Q² + 4 Q R)) / 2 before a sample of a random walk, and P R / (P + R) after it."""
    state = follow(np.tile([2.0, -1.0, 0.004], (4000, 1)), move_rate=0.0, hit_rate=0.0)
    Q = SETTINGS.q_calm**2 * PERIOD
    R = NOISE_VARIANCE[0]
    before = 0.5 * (Q + math.sqrt(Q * Q + 4.0 * Q * R))
    assert state.variance[CALM, 0, 0] == pytest.approx(before * R / (before + R), rel=1e-3)
    assert state.mean[CALM, :, 0] == pytest.approx([2.0, -1.0, 0.004], rel=1e-3)


def test_weights_are_probabilities_and_noise_alone_is_calm() -> None:
    rng = np.random.default_rng(3)
    loads = np.array([2.0, 0.0, 0.0]) + rng.normal(0.0, 1.0, (2000, 3)) * np.sqrt(NOISE_VARIANCE)
    state = follow(loads[:200])
    for load in loads[200:]:
        state = follow(load[None], state)
        assert state.weight.sum() == pytest.approx(1.0)
        assert state.weight[CALM] > 0.9


def test_a_load_that_jumps_is_noticed_at_its_first_sample_and_calm_again_afterwards() -> None:
    state = follow(np.tile([2.0, 0.0, 0.0], (500, 1)))
    hit = follow(np.array([[7.0, 0.0, 0.0]]), state)
    assert hit.weight[HIT] + hit.weight[MOVE] > 0.99
    later = follow(np.tile([7.0, 0.0, 0.0], (200, 1)), hit)
    assert later.weight[CALM] > 0.9
    assert later.mean[CALM, 0, 0] == pytest.approx(7.0, abs=0.1)


def test_a_rising_load_is_extrapolated() -> None:
    rising = np.zeros((20, 3))
    rising[:, 0] = 60.0 * PERIOD * np.arange(1, 21)
    state = follow(rising, follow(np.zeros((200, 3))), is_carried=False)
    now = least_distribution(state, 0.0, TABLE, SETTINGS)[MOVE, 0]
    assert state.weight[CALM] < 0.2
    assert least_distribution(state, SETTINGS.horizon, TABLE, SETTINGS)[MOVE, 0] > 1.2 * now


def test_the_minimum_force_is_that_of_the_limit_surface() -> None:
    state = standing(2.4, 0.006)
    expected = 2.0 * float(least_force(1.2, 0.003, CONTACT))
    assert least_distribution(state, 0.0, TABLE, SETTINGS)[CALM] == pytest.approx(
        [expected, 0.0], abs=1e-9
    )


@pytest.mark.parametrize("s_mu", [0.0, 0.08])
@pytest.mark.parametrize("eps", [0.001, 0.01, 0.1])
def test_the_force_for_a_known_load_is_the_quantile_of_the_friction(
    s_mu: float, eps: float
) -> None:
    state = standing(2.4)
    least = 2.4 / CONTACT.mu
    quantile = 1.0 + float(norm.ppf(1.0 - eps)) * math.hypot(s_mu, SETTINGS.s_model)
    assert force_for(state, s_mu, eps=eps) == pytest.approx(least * quantile, rel=1e-4)


def test_errors_of_the_load_cost_force() -> None:
    assert (
        force_for(standing(2.4, variance=0.01))
        > force_for(standing(2.4, variance=0.001))
        > force_for(standing(2.4))
    )


def test_a_reserve_that_the_load_has_used_up_costs_nothing_more() -> None:
    alone = force_for(standing(5.0))
    assert force_for(standing(5.0), reserve=1.0) == pytest.approx(alone, rel=1e-6)
    assert force_for(standing(1.0), reserve=5.0 / CONTACT.mu) == pytest.approx(alone, rel=1e-4)


def carry(
    reference: ProbabilityReference, load: float, until: float, longest: float = 8.0
) -> float:
    """Carry a load [N] with the reference's force until that is below a bound [N]; return the time [s]."""
    least = load / CONTACT.mu
    for count in range(round(longest / PERIOD)):
        estimate = GripEstimate(
            f_n=max(reference.f_ref, 0.1), f_t=load, load=(load, 0.0), f_least=least, f_cautious=least, f_coulomb=least,
            unfiltered=np.array([0.5 * load, 0.0, -0.5 * reference.f_ref, 0.0, 0.0, 0.0]),
        )  # fmt: skip
        reference.observe(estimate, 1)
        reference.follow(estimate, reference.f_ref, PERIOD)
        if reference.is_carried and reference.f_ref < until:
            return count * PERIOD
    return longest


def carrying() -> ProbabilityReference:
    reference = ProbabilityReference(GripSettings(contact=CONTACT, initial_force=8.0))
    reference.calibrate(0.01 * np.array([1.0, 1.0, 1.0, 2.5e-5, 2.5e-5, 2.5e-5]))
    reference.begin(8.0)
    reference.ramp(10.0)
    reference.stand((0.0, 0.0))
    return reference


def test_the_force_falls_slowly_where_the_friction_has_not_been_tested() -> None:
    reference, near = carrying(), 1.2 * 2.4 / CONTACT.mu
    untested = carry(reference, 2.4, near)
    carry(reference, 2.4, 0.0)
    carry(reference, 4.8, 0.0, 0.3)
    tested = carry(reference, 2.4, near)
    assert tested < 0.6 * untested
    carry(reference, 4.8, 0.0, 0.3)
    reference.take_contact(CONTACT)
    assert carry(reference, 2.4, near) > 1.5 * tested


def test_a_frozen_probable_reference_never_falls_below_its_lasting_part() -> None:
    reference = carrying()
    carry(reference, 4.8, 0.0, 3.0)
    before = reference.f_ref
    reference.freeze("because")
    carry(reference, 1.0, 0.0, 3.0)
    assert reference.f_ref >= 0.99 * before


def test_a_light_fruit_is_lifted_and_held_near_its_minimum() -> None:
    task = next(task for task in draw_tasks(20, 7)[0] if 0.2 < task.fruit.mass < 0.3)
    settings = settings_for(task, PatchGrasp, ForceLaw.SLIP_AVOIDANCE, False, 0.0)
    lifting = Lifting(acceleration=task.acceleration)
    result = run_trial(
        task.fruit, settings, lifting, NOISE, task.seed, control=ProbabilityController
    )
    assert result.held
    assert 1.0 < result.steady / result.least < 1.3
    assert result.slip < 1e-3
    row = figures(task, CASES["known"], PatchGrasp, lifting, result, [True] * len(result.trace.t))
    assert row.steady == pytest.approx(result.steady / result.least)
    assert row.peak >= row.steady


def test_a_push_that_makes_the_fruit_slide_is_answered_by_force() -> None:
    task = draw_tasks(4, 7)[0][0]
    row = lift(task, CASES["unexpected"], PatchGrasp, ProbabilityController)
    assert row.lost == 0.0
    assert row.slip < 8.0


def test_a_summary_counts_lost_fruit_of_both() -> None:
    ours = np.array([[1, 1.2, 2, 2, 0.1, 1]] * 3 + [[0, 1.2, 2, 2, 0.1, 1]] * 3, float)
    theirs = np.array([[0, 1.1, 2, 2, 0.1, 1]] * 6, float)
    assert "lost 3 / 0 of 6 (p 0.25)" in summary("case", ours, theirs)
