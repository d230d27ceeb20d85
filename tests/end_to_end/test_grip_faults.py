"""A lying force sensor on the simulated cell: a handful of what `make bench-grip-faults` runs through."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.grip_faults import FORCE_MAX, Case, run_case

pytestmark = pytest.mark.slow


def test_without_a_fault_the_fruit_hangs_and_the_run_says_so() -> None:
    outcome = run_case(Case("swapped", "preparing"))  # which finger is which matters to nobody
    assert outcome.outcome == "success"
    assert outcome.hung is True
    assert outcome.peak < FORCE_MAX


@pytest.mark.parametrize(
    ("kind", "phase", "within"),
    [
        ("stuck", "lifting", 0.05),
        ("dead_right", "holding", 0.05),
        ("both_press_more", "holding", 0.05),
        ("not_a_number", "lifting", 0.09),
        ("zero", "preparing", 10.0),
    ],
)
def test_a_lie_ends_in_the_safe_state_without_a_false_success(kind: str, phase: str, within: float) -> None:
    outcome = run_case(Case(kind, phase))
    assert outcome.outcome != "success", outcome
    assert "finger" in outcome.message, outcome
    assert not outcome.false_success
    assert not outcome.dropped
    assert outcome.peak < FORCE_MAX
    assert np.isfinite(outcome.found_after)
    assert outcome.found_after <= within
