"""A planner of OMPL's names OMPL where it is not installed."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from pomona.skills.motion.planning.plan import PLANNERS, solve
from pomona.skills.motion.planning.space import BadRequest, Effort


def test_a_planner_of_ompl_names_ompl_where_it_is_not_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(sys.modules, "pomona.skills.motion.planning.ompl_planners", raising=False)
    monkeypatch.setitem(sys.modules, "ompl", None)
    name = next(name for name, offered in PLANNERS.items() if offered.ompl)
    with pytest.raises(BadRequest, match=f"the planner {name} needs OMPL, which is not installed"):
        solve(None, np.zeros(6), np.zeros((1, 6)), name, Effort(1, 0, 0.0))  # type: ignore[arg-type]
