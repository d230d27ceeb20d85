"""scripts/without_leaves.py takes a leaf out with its dependents, tests and entry points."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "without_leaves", ROOT / "scripts" / "without_leaves.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    texts = {
        "executive/pomona/tools/ink/__init__.py": "",
        "executive/pomona/tools/ink/pen.py": "import pomona.tools.paper\n",
        "executive/pomona/tools/paper/__init__.py": "",
        "executive/pomona/tools/papers/__init__.py": "",
        "drivers/pomona/devices/hand/__init__.py": "    from pomona.tools.ink import pen\n",
        "tests/executive/tools/paper/test_paper.py": "",
        "tests/executive/tools/papers/test_papers.py": "",
        "pyproject.toml": '[project.entry-points."pomona.commands"]\n'
        'write = "pomona.tools.paper.command:add"  # on paper\n'
        'file = "pomona.tools.papers.command:add"\n'
        'hold = "pomona.devices.hand:HOLD"\n'
        'modules = ["pomona.tools.paper", "pomona.tools.papers"]\n',
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_with_a_leaf_go_those_that_import_it(script: ModuleType, checkout: Path) -> None:
    assert script.with_dependents(checkout, "tools/paper") == [
        "tools/paper",
        "tools/ink",
        "devices/hand",
    ]
    assert script.with_dependents(checkout, "devices/hand") == ["devices/hand"]


def test_what_is_taken_out_leaves_the_rest(script: ModuleType, checkout: Path) -> None:
    script.take_out(checkout, ["tools/paper", "devices/hand"])
    assert set(script.leaves(checkout)) == {"tools/ink", "tools/papers"}
    assert not (checkout / "tests/executive/tools/paper").exists()
    assert (checkout / "tests/executive/tools/papers/test_papers.py").exists()
    assert (checkout / "pyproject.toml").read_text() == (
        '[project.entry-points."pomona.commands"]\n'
        '# taken out: write = "pomona.tools.paper.command:add"  # on paper\n'
        'file = "pomona.tools.papers.command:add"\n'
        '# taken out: hold = "pomona.devices.hand:HOLD"\n'
        'modules = ["pomona.tools.papers"]\n'
    )


def test_what_failed_is_named(script: ModuleType) -> None:
    output = "...F\nFAILED tests/a.py::test_b - assert\n1 failed"
    assert list(script.failures(output)) == ["FAILED tests/a.py::test_b - assert"]
    assert list(script.failures("no tests\n")) == ["no tests"]
