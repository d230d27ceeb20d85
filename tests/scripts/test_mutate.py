"""scripts/mutate.py: a mistake is small, stands in one place, and is found by the tests that reach it."""

from __future__ import annotations

import ast
import importlib.util
import math
import signal
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "mutate.py"


@pytest.fixture(scope="module")
def mutate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("mutate", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["mutate"] = module  # its dataclasses ask for it
    spec.loader.exec_module(module)
    return module


def texts(mutate: ModuleType, source: str) -> set[str]:
    """A module with each of its mistakes."""
    path, tree = Path("module.py"), ast.parse(source)
    found = set()
    for place in mutate.places(path, tree):
        for new in place.mistakes:
            found.add(ast.unparse(mutate.Put(place.node, new).visit(tree)))
            mutate.Put(new, place.node).visit(tree)
    assert ast.unparse(tree) == ast.unparse(ast.parse(source))
    return found


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("a + b", {"a - b"}),
        ("a += b", {"a -= b"}),
        ("a < b", {"a <= b", "a >= b"}),
        ("a == b", {"a != b"}),
        ("a and b", {"a or b"}),
        ("not a", {"a"}),
        ("-a", {"a"}),
        ("True", {"False"}),
        ("3", {"4"}),
        ("0.25", {"0.5"}),
        ("0.0", {"1.0"}),
        ("x.min", {"x.max"}),
        ("any", {"all"}),
        ("f(a, b, c)", {"f(b, a, c)", "pass"}),
        ("x = f(a, a)", set()),
        ("x = max(a, b)", {"x = min(a, b)"}),
        ("x = f(*a, b)", set()),
        ("x.y = z", {"pass"}),
        ("x.y += z", {"pass", "x.y -= z"}),
        ("x = y if z else w", {"x = y if not z else w"}),
        ("x = [y for y in z if y.w]", {"x = [y for y in z if not y.w]"}),
        ("def f():\n    return a", {"def f():\n    return None"}),
        ("def f():\n    return None", set()),
    ],
)
def test_a_mistake_is_one_small_change(mutate: ModuleType, right: str, wrong: set[str]) -> None:
    assert texts(mutate, right) == wrong


@pytest.mark.parametrize(
    "source",
    [
        "x: f(1, 2)",
        "x = Annotated[y, f(1, 2)]",
        "raise Error(1, 2)",
        "assert a < 1",
        "x = f'{1 + 2}'",
        "x = 'text'",
        "self._logger.warning('%d', 1 + 2)",
        "logging.getLogger('a').info(1, 2)",
        "def __repr__(self):\n    return 1 + 2",
        "if TYPE_CHECKING:\n    x = 1",
        "@f(1, 2)\ndef g() -> f(1, 2):\n    ...",
    ],
)
def test_no_mistake_is_made_where_none_shows_in_a_result(mutate: ModuleType, source: str) -> None:
    assert texts(mutate, source) == set()


def test_a_place_is_reached_by_its_statement_and_outside_of_functions_by_its_name(
    mutate: ModuleType,
) -> None:
    source = (
        "LIMIT = 3\n"
        "class A:\n"
        "    share: float = 0.5\n"
        "    def f(self, x=1):\n"
        '        """Text."""\n'
        "        if x > 2:\n"
        "            y = g(\n"
        "                4)\n"
    )
    found = mutate.places(Path("module.py"), ast.parse(source))
    reached = {ast.unparse(place.node): (place.lines, place.name) for place in found}
    assert reached["3"] == (range(0), "LIMIT")
    assert reached["0.5"] == (range(0), "share")
    assert reached["1"][0] == range(5, 9)
    assert reached["x > 2"][0] == range(6, 7)
    assert reached["4"][0] == range(7, 9)


def test_a_draw_takes_each_place_of_the_core_once_and_repeats_with_its_seed(
    mutate: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.py").write_text("x = 1\ny = 2.0\nz = x < y\n", encoding="utf-8")
    monkeypatch.setattr(mutate, "ROOT", tmp_path)
    monkeypatch.setattr(mutate, "CORE", (".",))

    def drawn(most: int, seed: int) -> list[tuple[str, str, str]]:
        return [
            (place.path.name, ast.unparse(place.node), ast.unparse(new))
            for place, new, _code in mutate.draw(most, seed)
        ]

    assert sorted(place[:2] for place in drawn(99, 1)) == [
        (name, was) for name in ("a.py", "b.py") for was in ("1", "2.0", "x < y")
    ]
    assert len(drawn(4, 1)) == 4
    assert drawn(6, 1) == drawn(6, 1) != drawn(6, 2)


@pytest.fixture
def small(mutate: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script over a core of one module with a test of one of its functions."""
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "grown.py").write_text(
        "def f(a, b):\n    return a - b\n\n\ndef g(a, b):\n    return a + b\n", encoding="utf-8"
    )
    tests = "from grown import f\n\n\ndef test_f():\n    assert f(3, 1) == 2\n"
    (tmp_path / "test_grown.py").write_text(tests, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    folder = tmp_path / "map"
    folder.mkdir()
    for name, value in {
        "ROOT": tmp_path,
        "CORE": (".",),
        "TESTS": (".",),
        "UNCOMPILED": (),
        "MAP": folder,
    }.items():
        monkeypatch.setattr(mutate, name, value)
    return mutate


@pytest.mark.slow  # six processes of pytest
def test_mistakes_in_tested_functions_are_found_and_no_others(small: ModuleType) -> None:
    with pytest.raises(SystemExit, match="make mutate-map"):
        small.Reached(is_compiled=True)
    assert small.make_map(math.inf) == 0
    reached = small.Reached(is_compiled=True)
    found = {
        (place.node.lineno, ast.unparse(new)): reached.finds(place, code)
        for place, new, code in small.draw(99, 1)
        if place.path.name == "grown.py"
    }
    assert found == {
        (2, "a + b"): True,
        (2, "return None"): True,
        (6, "a - b"): False,
        (6, "return None"): False,
    }
    (place,) = [place for place, new, _code in small.draw(99, 1) if ast.unparse(new) == "a + b"]
    unchanged = compile((small.ROOT / "grown.py").read_text(), place.path, "exec")
    assert not reached.finds(place, unchanged)


@pytest.mark.slow  # a process of pytest for each piece
def test_a_map_is_made_in_pieces_and_again_only_where_a_file_that_was_run_has_changed(
    small: ModuleType,
) -> None:
    (small.ROOT / "test_other.py").write_text("def test_nothing():\n    pass\n", encoding="utf-8")
    assert small.make_map(-math.inf) == 2
    assert small.make_map(math.inf) == 0

    def missing() -> list[str]:
        small.digest.cache_clear()
        return [piece.tests.name for piece in small.pieces(True) if piece.read() is None]

    assert missing() == []
    with (small.ROOT / "grown.py").open("a") as file:
        file.write("# a comment\n")
    assert missing() == ["test_grown.py"]


def test_work_that_does_not_end_is_ended_although_it_sets_timers(small: ModuleType) -> None:
    def endless() -> int:
        signal.signal(signal.SIGALRM, signal.SIG_IGN)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        while True:
            time.sleep(1.0)

    assert small.fork(endless, 0.1) == -signal.SIGKILL
    assert small.fork(lambda: 3, 5.0) == 3
