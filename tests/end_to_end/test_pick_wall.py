"""Three apples of a simulated fruit wall are picked into the bin by the experimental tree."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell

pytestmark = pytest.mark.slow

TREE = Path(__file__).parents[2] / "trees" / "experimental" / "pick_tree.yaml"


def test_three_apples_are_picked_from_the_wall() -> None:
    settings = {"leaves": "0", "behind": "0", "friction": "0.8", "most": "3"}
    executed = execute(RunOrder(TREE, find_cell("orchard"), 4, settings))
    assert executed.result.outcome == "success", executed.result.reason
    truth = executed.result.truth
    assert truth is not None
    assert (truth["picked"], truth["knocked_off"], truth["stems_torn"]) == (3, 0, 0)
