"""scripts/size.py counts lines, docstrings, parameters and words."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "size.py"


@pytest.fixture(scope="module")
def size() -> ModuleType:
    spec = importlib.util.spec_from_file_location("size", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_module_is_counted(size: ModuleType) -> None:
    text = (
        '"""One.\n\nTwo."""\nLIMIT = 1\n"""Three [m]."""\n_LOW: int = 2\nname = 3\n\n\n'
        "def f(self, a, b, c, d, e, *, g, h):\n    return 1  # fmt: skip\n\n\n"
        "def k(a, b, c, d, e, f, g, *, h):\n    pass\n"
    )
    texts: list[str] = []
    counted = size.of_module(text, texts)
    assert counted == {
        "lines": 15, "short modules": 1, "fmt: skip": 1, "docstring lines": 4, "long parameter lists": 1,
        "module constants": 2, "comments": 1,
    }  # fmt: skip
    assert sorted(texts) == ["# fmt: skip", "One.\n\nTwo.", "Three [m]."]


def test_a_module_counts_for_its_core_or_for_its_leaf(size: ModuleType) -> None:
    text = (
        "from pomona.tools.groot import names\n\n\ndef run(self, a, b, c, d, e, f, g, h, i): ...\n"
    )
    core = size.of_part(Path("skills/pomona/skills/lift.py"), text)
    assert core["core: lines"] == core["skills: lines"] == 4
    assert core["core: imports of leaves"] == 1
    assert core["skills with more than 8 inputs"] == 1
    assert (
        size.of_part(Path("skills/pomona/skills/grip/hold.py"), text)[
            "skills with more than 8 inputs"
        ]
        == 0
    )
    leaf = size.of_part(Path("executive/pomona/tools/groot/names.py"), text)
    assert leaf == {"tools/groot: lines": 4}


@pytest.mark.parametrize(
    ("text", "rates"),
    [
        ("What it says is told to nobody.", (1, 2, 1)),
        ("A report of the force.", (0, 0, 0)),
        ("Whatever tells it", (1, 1, 0)),
    ],
)
def test_vague_words_are_counted(size: ModuleType, text: str, rates: tuple[int, ...]) -> None:
    assert tuple(len(pattern.findall(text)) for pattern in size.WORDS.values()) == rates


def test_a_figure_above_its_bound_fails_the_check(
    size: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(size, "BOUNDS", tmp_path / "size.json")
    monkeypatch.setattr(size, "figures", lambda: {"lines": 10, "what": 1.5})
    assert size.main(["--lower"]) == 0
    assert size.main(["--check"]) == 0
    monkeypatch.setattr(size, "figures", lambda: {"lines": 11, "what": 0.5})
    assert size.main(["--check"]) == 1
    assert "above its bound" in capsys.readouterr().out
    size.main(["--lower"])
    assert size.main(["--check"]) == 1  # a bound never rises
    monkeypatch.setattr(size, "figures", lambda: {"lines": 10, "what": 0.6})
    assert size.main(["--check"]) == 1
