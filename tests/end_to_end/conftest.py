"""Configuration of whole picks."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from pomona.executive.running import compute


@pytest.fixture(autouse=True, scope="package")
def workers_stay_warm() -> Iterator[None]:
    """As in a campaign: starting a worker, its imports and kernels, takes longer than most of these picks."""
    if compute._spare is not None:  # a campaign before has said so for the whole process
        yield
        return
    compute.keep_workers_warm()
    yield
    for worker in compute._spare or []:
        worker.kill()
    compute._spare = None
