"""Slip is measured by the fruit's contact and tilt, independent of the configured friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.grasp_patch import Fruit
from benchmarks.grasp_trial import Lifting, run_trial
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.force_loop import ForceLoopSettings
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.settings import ForceLaw, GripSettings

HEAVY = Fruit(mass=0.31, width=0.08, mu=0.62, offset=(0.0, 0.011))
APPLE = Fruit(mass=0.24, width=0.075, mu=0.5, offset=(0.004, 0.004))


def lift(fruit: Fruit, told: float, **changes: object) -> tuple:
    """Lift a fruit whose configured friction is `told` times too high: result, controller, reports and their times."""
    contact = SoftContact(told * fruit.mu, fruit.delta, fruit.gamma, fruit.k)
    settings = GripSettings(
        contact=contact, mu_uncertainty=0.15, offset=0.015, initial_force=4.0, loop=ForceLoopSettings(max_force=40.0)
    )
    seen: dict[str, float] = {}
    last: list[GripController] = []

    def watch(t: float, controller: GripController, _grasp: object) -> None:
        if controller.problem is not None:
            seen.setdefault(controller.problem.code, t)
        last[:] = [controller]

    settings = replace(settings, **changes)  # type: ignore[arg-type]
    return run_trial(fruit, settings, Lifting(), noise=0.2, seed=6, watch=watch), last[0], seen


@pytest.mark.parametrize("fruit", [HEAVY, APPLE], ids=["heavy", "apple"])
@pytest.mark.parametrize("told", [1.3, 1.5])
def test_friction_that_was_configured_too_high_is_corrected_by_the_slip_that_it_causes(
    fruit: Fruit, told: float
) -> None:
    result, controller, _ = lift(fruit, told)
    assert result.held
    assert result.slip < 0.004
    assert 1.0 < result.steady / result.least < 1.6
    assert controller.settings.contact.mu < 1.15 * fruit.mu


def test_the_fruit_is_lost_when_slip_is_not_watched() -> None:
    """The same lift under the paper's static law, which uses the configured friction."""
    result, _, seen = lift(HEAVY, 1.5, law=ForceLaw.STATIC)
    assert not result.held
    assert "SLIPPED" in seen or "LOST" in seen


def test_friction_that_is_right_is_left_alone() -> None:
    for fruit in (HEAVY, APPLE):
        result, controller, seen = lift(fruit, 1.0, mu_uncertainty=0.0)
        assert result.held
        assert controller.friction_share == pytest.approx(1.0)
        assert seen == {}


def test_the_contact_points_give_the_slid_distance() -> None:
    result, controller, _ = lift(HEAVY, 1.5)
    assert controller.slipped == pytest.approx(result.slip, abs=5e-4)
    assert np.isfinite(controller.slipped)
