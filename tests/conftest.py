"""What holds for all tests."""

from __future__ import annotations

import gc

import pytest


def pytest_collection_finish() -> None:
    """What was imported and collected stays: looking through it again at each collection of garbage took 6 % of the
    time of all tests, half a second at once in the middle of whichever test came then.
    """
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What needs a browser or is a whole pick is slow, whatever it says. Tutorials come first: they take up to a minute
    each, and whichever test comes last is waited for by one of two workers alone.
    """
    for item in items:
        if item.get_closest_marker("browser") is not None or "end_to_end" in item.path.parts:
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: item.path.stem != "test_tutorials")
