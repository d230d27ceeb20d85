"""Random trees with leaves that take time and claim devices do, tick by tick, what the language page says."""

from __future__ import annotations

import pytest
from py_trees.common import Status

from executive.nodes.behaviours import Branch
from executive.nodes.parallel import Parallel
from tests.executive.language import reference


@pytest.mark.parametrize("part", range(10))
def test_random_trees_do_what_the_reference_interpreter_does(part):
    told = [differs for number in range(250) if (differs := reference.differs(f"ci/{part}/{number}"))]
    assert told == []


def test_the_comparison_notices_a_parallel_that_goes_on_after_a_failure(monkeypatch):
    def stop(self, new_status=Status.INVALID):
        self.status = new_status  # what still runs below is not interrupted

    monkeypatch.setattr(Parallel, "stop", stop)
    assert any(reference.differs(f"ci/0/{number}") for number in range(250))
    assert Branch.stop is not stop
