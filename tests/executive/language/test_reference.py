"""Random trees with leaves that take time and claim devices follow the language page, tick by tick."""

from __future__ import annotations

import pytest
from py_trees.common import Status

from pomona.executive.language.read import read
from pomona.executive.nodes.behaviours import Branch, Parallel
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.groot.import_xml import import_groot
from tests.executive.language import reference


@pytest.mark.parametrize("part", range(10))
def test_random_trees_behave_as_in_the_reference_interpreter(part):
    told = [
        differs for number in range(250) if (differs := reference.differs(f"ci/{part}/{number}"))
    ]
    assert told == []


@pytest.mark.slow
def test_random_trees_mean_the_same_after_an_export_and_an_import():
    shared = []

    def round_trip(text: str) -> str:
        """Through XML and back; a tree with words that BehaviorTree.CPP lacks stays as it is."""
        back, findings = import_groot(export_groot(read(text, "t.yaml"), reference.JOBS), "t.xml")
        assert bool(back) == (findings == []), text
        shared.append(back)
        return back or text

    told = [
        differs
        for number in range(600)
        if (differs := reference.differs(f"xml/{number}", round_trip))
    ]
    assert told == []
    assert sum(map(bool, shared)) >= 100


def test_the_comparison_notices_a_parallel_that_goes_on_after_a_failure(monkeypatch):
    def stop(self, new_status=Status.INVALID):
        self.status = new_status  # what still runs below is not interrupted

    monkeypatch.setattr(Parallel, "stop", stop)
    assert any(reference.differs(f"ci/0/{number}") for number in range(250))
    assert Branch.stop is not stop
