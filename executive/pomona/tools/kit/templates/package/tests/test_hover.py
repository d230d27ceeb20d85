"""Hover, driven without a tree, a runner or a cell."""

from __future__ import annotations

import pytest

from my_package.hover import Hover
from pomona.executive import drive


def test_it_adds_to_the_least_height() -> None:
    outcome = drive(Hover(), {"above": 0.2, "limit": 1.0, "settle": 0.1})
    assert outcome.outputs["height"] == pytest.approx(0.3)
    assert outcome.duration == pytest.approx(0.1, abs=0.05)


def test_it_says_why_it_fails() -> None:
    outcome = drive(Hover(), {"above": 2.0, "limit": 1.0, "settle": 0.0})
    assert outcome.reason is not None
    assert outcome.reason.code == "TOO_HIGH"
