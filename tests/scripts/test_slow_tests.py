"""scripts/slow_tests.py finds slow tests from times that were written by two runs."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("slow_tests", ROOT / "scripts" / "slow_tests.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_time_of_a_shared_fixture_is_spread_over_its_file(
    script: ModuleType, tmp_path: Path
) -> None:
    (tmp_path / "1.txt").write_text(
        "4.000 shared tests/test_a.py\n0.100 tests/test_a.py::test_b\n0.200 tests/test_a.py::test_c[x y]\n"
    )
    (tmp_path / "2.txt").write_text("0.050 tests/test_d.py::test_e\n")
    assert script.read(tmp_path) == pytest.approx(
        {
            "tests/test_a.py::test_b": 2.1,
            "tests/test_a.py::test_c[x y]": 2.2,
            "tests/test_d.py::test_e": 0.05,
        }
    )


def test_the_smaller_of_two_times_counts_and_a_function_stands_for_all_its_cases(
    script: ModuleType,
) -> None:
    forwards = {
        "a::first": 9.0,
        "a::slow[1]": 0.3,
        "a::slow[2]": 1.0,
        "a::part[1]": 0.5,
        "a::part[2]": 0.1,
    }
    backwards = {"a::first": 0.1, "a::slow[1]": 0.4, "a::slow[2]": 0.9, "a::part[1]": 0.6}
    assert script.slow([forwards, backwards]) == ["a::part[1]", "a::slow"]


def test_the_list_names_tests_that_exist() -> None:
    names = (ROOT / "tests" / "slow_tests.txt").read_text("utf-8").splitlines()
    assert names == sorted(names)
    for name in names:
        file, _, function = name.partition("::")
        if not (ROOT / file).is_file():
            continue  # its leaf was taken out
        if function.endswith("::runTest"):
            continue  # a state machine of hypothesis
        found = (ROOT / file).read_text("utf-8")
        test = function.partition("[")[0].rpartition("::")[2]
        assert f"def {test}(" in found or f"\n{test} = " in found, name  # a suite that is called
