"""Configuration of all tests: which are slow, as measured, and which need a leaf that was taken out."""

from __future__ import annotations

import gc
import inspect
import os
import re
import signal
from collections.abc import Generator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings

from tests.taken_out import LEAF_IMPORT, leaves, taken_words

# The same examples every time, and none is wrong because the machine is busy or compiles something first.
settings.register_profile(
    "pomona",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
# The same without looking for the simplest example: scripts/mutate.py asks only whether there is one.
settings.register_profile(
    "found", settings.get_profile("pomona"), phases=[Phase.explicit, Phase.generate]
)
settings.load_profile("pomona")

# A shell's background job and nohup ignore these signals, and commands keep it so; tests raise the signals.
for _number, _action in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _action)

ROOT = Path(__file__).resolve().parents[1]
SLOW_TESTS = ROOT / "tests" / "slow_tests.txt"
"""Tests of 0.3 s of processor time and more, written by `make test-times`: slow, as if marked."""

SLOW_FILE = re.compile(r"^pytestmark = pytest\.mark\.(?:slow|browser)$", re.MULTILINE)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files that import a leaf that was taken out, and files that have no test of those that are asked for:
    importing all of them takes half a minute of processor time.
    """
    if collection_path.suffix != ".py":
        return None
    if not is_mine(collection_path, config):
        return True
    text = collection_path.read_text("utf-8")
    if not leaves().issuperset(LEAF_IMPORT.findall(text)):
        return True
    asked: str = config.option.markexpr
    if "slow" not in asked or "end_to_end" in collection_path.parts:
        return None
    if "not slow" in asked:
        return True if SLOW_FILE.search(text) and "landmark" not in text else None
    name = collection_path.relative_to(ROOT).as_posix()
    return None if "slow" in text or "browser" in text or name in measured_files() else True


def is_mine(path: Path, config: pytest.Config) -> bool:
    """Return False for a file of tests that another worker runs.

    With `--dist each` a worker imports its own files alone. Where each imports all, that takes a third of all time.
    """
    run: dict[str, Any] = getattr(config, "workerinput", {"mainargv": ()})
    if "each" not in run["mainargv"]:
        return True
    worker = int(run["workerid"].removeprefix("gw")) % run["workercount"]
    return shares(run["workercount"]).get(path, worker) == worker


@cache
def shares(workers: int) -> dict[Path, int]:
    """Return which worker runs a file of tests: the largest first, each to the worker with the least text so far."""
    sizes = {path: path.stat().st_size for path in (ROOT / "tests").rglob("test_*.py")}
    share: dict[Path, int] = {}
    loads = [0] * workers
    for path in sorted(sizes, key=lambda path: (-sizes[path], path)):
        share[path] = loads.index(min(loads))
        loads[share[path]] += sizes[path]
    return share


@cache
def measured() -> frozenset[str]:
    """Return the names of tests that were measured to be slow."""
    return frozenset(SLOW_TESTS.read_text("utf-8").splitlines())


@cache
def measured_files() -> frozenset[str]:
    """Return the files that have tests that were measured to be slow."""
    return frozenset(name.partition("::")[0] for name in measured())


def pytest_collection_finish() -> None:
    """Exclude imported and collected objects from garbage collection: scans of them took 6 % of the time of all tests,
    half a second at once in the middle of a random test.
    """
    gc.collect()
    gc.freeze()


def needs_taken(item: pytest.Item) -> bool:
    """Return True for a test that names a word of a leaf that was taken out: itself, its values, fixtures or helpers."""
    words = taken_words()
    if words is None or not isinstance(item, pytest.Function):
        return False
    fixtures = item._fixtureinfo.name2fixturedefs.values()
    code = [item.function, *(each.func for found in fixtures for each in found)]
    texts = [str(getattr(item, "callspec", ""))]
    if hasattr(item, "callspec"):
        for value in item.callspec.params.values():
            with suppress(RecursionError):  # objects that hold each other
                texts.append(repr(value))
    for each in code:  # grows
        module = inspect.getmodule(each)
        if (
            module is None
            or ROOT / "tests" not in Path(getattr(module, "__file__", None) or "").parents
        ):
            continue
        text = inspect.getsource(each)
        texts.append(text)
        for name in set(re.findall(r"\w+", text)) & vars(module).keys():
            value = vars(module)[name]
            if inspect.isfunction(value) or inspect.isclass(value):
                code += [value] if value not in code else []
            elif not inspect.ismodule(value):
                with suppress(RecursionError):
                    texts.append(repr(value))
    return any(words.search(text) for text in texts)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, None]:
    """Leave out a test that fails and needs a leaf that was taken out."""
    report = (yield).get_result()
    if report.failed and needs_taken(item):
        report.outcome = "skipped"
        report.longrepr = (str(item.path), 0, "a leaf that it needs was taken out")


@pytest.hookimpl(hookwrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, Any, None]:
    """Leave out a file whose helpers import a leaf that was taken out."""
    report = (yield).get_result()
    text = str(report.longrepr) if report.failed else ""
    missing = re.findall(
        r"No module named '(?:pomona|tests\.\w+)\.(tools|devices|applications)\.(\w+)", text
    )
    # A helper whose own import has failed stays loaded, half of it.
    is_half = taken_words() is not None and "ImportError: cannot import name" in text
    if is_half or not leaves().issuperset(missing):
        report.outcome = "skipped"
        report.longrepr = (str(collector.path), 0, "a leaf that it needs was taken out")


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests with a browser, a whole pick or much processor time as slow. Tutorials come first, then whole picks:
    they take up to three minutes each, and one worker would wait for a late one.
    """
    for item in items:
        names = {item.nodeid, item.nodeid.partition("[")[0]}
        is_browser = item.get_closest_marker("browser") is not None
        if is_browser or "end_to_end" in item.path.parts or not measured().isdisjoint(names):
            item.add_marker(pytest.mark.slow)
    items.sort(
        key=lambda item: (item.path.stem != "test_tutorials", "end_to_end" not in item.path.parts)
    )
    if os.environ.get("TEST_ORDER") == "backwards":
        items.reverse()


# `make test-times` sets TEST_TIMES to a folder: each process of pytest writes the processor time of its tests there.
TIMES = os.environ.get("TEST_TIMES", "")
_shared = 0.0  # processor time of fixtures of a module or more, in the test that is running [s]


def processor_time() -> float:
    """Return the processor time of this process and of its children that have ended [s]."""
    return sum(os.times()[:4])


@pytest.hookimpl(hookwrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Generator[None, None, None]:
    """Set the time of a fixture that tests share apart: it belongs to its file, not to the first test."""
    global _shared
    began = processor_time()
    yield
    if TIMES and fixturedef.scope != "function":
        spent = processor_time() - began
        _shared += spent
        _write(spent, f"shared {fixturedef.baseid or 'tests'}")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, None, None]:
    """Note the processor time of a test."""
    global _shared
    began, _shared = processor_time(), 0.0
    yield
    if TIMES:
        _write(processor_time() - began - _shared, item.nodeid)


def _write(spent: float, name: str) -> None:
    with (Path(TIMES) / f"{os.getpid()}.txt").open("a", encoding="utf-8") as file:
        file.write(f"{spent:.3f} {name}\n")
