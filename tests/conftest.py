"""Configuration of all tests."""

from __future__ import annotations

import gc
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# The same examples every time, and none is wrong because the machine is busy or compiles something first.
settings.register_profile(
    "pomona",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("pomona")

# A shell's background job and nohup ignore these signals, and commands keep it so; tests raise the signals.
for _number, _action in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _action)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Where only slow tests are asked for, files that have none are not even imported: all of them take a minute."""
    asked: str = config.option.markexpr
    if "slow" not in asked or "not slow" in asked or collection_path.suffix != ".py":
        return None
    text = collection_path.read_text("utf-8")
    return (
        None
        if "end_to_end" in collection_path.parts or "slow" in text or "browser" in text
        else True
    )


def pytest_collection_finish() -> None:
    """Exclude imported and collected objects from garbage collection: scans of them took 6 % of the time of all tests,
    half a second at once in the middle of a random test.
    """
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests with a browser or a whole pick as slow. Tutorials come first, then whole picks: they take up to three
    minutes each, and one worker would wait for a late one.
    """
    for item in items:
        if item.get_closest_marker("browser") is not None or "end_to_end" in item.path.parts:
            item.add_marker(pytest.mark.slow)
    items.sort(
        key=lambda item: (item.path.stem != "test_tutorials", "end_to_end" not in item.path.parts)
    )
