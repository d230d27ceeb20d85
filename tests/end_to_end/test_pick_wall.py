"""Apples of a simulated fruit wall are picked into the bin by the experimental tree, with both arms."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell

pytestmark = pytest.mark.slow

TREE = Path(__file__).parents[2] / "trees" / "experimental" / "pick_tree.yaml"


@pytest.mark.parametrize(
    ("cell", "most"),
    [
        pytest.param("orchard", 1, marks=pytest.mark.landmark),
        ("orchard_ur5e", 1),
        pytest.param("orchard", 3, marks=pytest.mark.long),
    ],
)
def test_apples_are_picked_from_the_wall(cell: str, most: int) -> None:
    settings = {
        "leaves": "0",
        "behind": "0",
        "friction": "0.8",
        "most": str(most),
        "looks": "9" if most > 1 else "3",
    }
    executed = execute(RunOrder(TREE, find_cell(cell), 4, settings))
    assert executed.result.outcome == "success", executed.result.reason
    truth = executed.result.truth
    assert truth is not None
    assert (truth["picked"], truth["knocked_off"], truth["stems_torn"]) == (most, 0, 0)
