"""What holds for all tests."""

from __future__ import annotations

import gc
from collections.abc import Iterable

import pytest


def pytest_collection_finish() -> None:
    """What was imported and collected stays: looking through it again at each collection of garbage took 6 % of the
    time of all tests, half a second at once in the middle of whichever test came then.
    """
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items: Iterable[pytest.Item]) -> None:
    """What needs a browser or is a whole pick is slow, whatever it says."""
    for item in items:
        if item.get_closest_marker("browser") is not None or "end_to_end" in item.path.parts:
            item.add_marker(pytest.mark.slow)
