"""Errors of an estimate against the world's truth."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.services import estimate_errors


def fruit(x: float, y: float, z: float, *dimensions: float) -> dict[str, object]:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return {"T_base_fruit_at_look": T.tolist(), "dimensions_m": list(dimensions)}


FRUITS = [fruit(0.0, -0.5, -0.08, 0.09, 0.08, 0.09), fruit(0.1, -0.3, -0.09, 0.06, 0.05, 0.06)]


def test_an_estimate_is_judged_by_the_nearest_fruit() -> None:
    errors = estimate_errors(
        {"position_m": np.array([0.1, -0.3, -0.093]), "dimensions_m": [0.062, 0.05, 0.06]}, FRUITS
    )
    assert errors["position_error_mm"] == pytest.approx(3.0)
    assert errors["centroid_error_mm"] == pytest.approx(3.0)
    assert errors["size_error_mm"] == pytest.approx(2.0)
    assert errors["width_error_mm"] == pytest.approx(1.0)


def test_nothing_reported_or_nothing_there_gives_no_errors() -> None:
    assert estimate_errors({}, FRUITS) == {}
    assert estimate_errors({"position_m": [0, 0, 0], "dimensions_m": [1, 1, 1]}, []) == {}
