"""A run begins with its permit only, which a stop in another process may take first."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from pomona.executive.running.starting import Permit, Starting


@pytest.fixture
def permit() -> Iterator[Permit]:
    permit = Permit.create()
    yield permit
    permit.close()


def test_a_permit_is_taken_once_by_the_first_caller(permit: Permit) -> None:
    elsewhere = Permit(permit.read_fd)
    assert not permit.take()
    permit.issue()
    assert elsewhere.take()
    assert not permit.take()
    permit.issue()
    permit.issue()  # permits do not add up
    assert permit.take()
    assert not elsewhere.take()


def test_a_run_without_its_permit_is_cancelled_when_it_begins(permit: Permit) -> None:
    allowed = Starting(permit=permit)
    allowed.begin()
    assert allowed.cancelled == ""
    refused = Starting(permit=permit)
    assert Permit(permit.read_fd).take()
    refused.reach("preparing a skill", 2, 9)
    refused.begin()
    assert refused.cancelled == "safe stop on the page during the preparation"


def test_the_run_after_a_recovery_needs_a_permit_of_its_own(permit: Permit) -> None:
    starting = Starting(permit=permit)
    starting.begin()  # the recovery
    starting.reach("connecting the cell")
    assert Permit(permit.read_fd).take()
    starting.begin()
    assert starting.cancelled


def test_a_closed_permit_permits_nothing() -> None:
    permit = Permit.create()
    permit.issue()
    permit.close()
    permit.close()
    permit.issue()
    assert not permit.take()
