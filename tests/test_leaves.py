"""Every leaf has one shape: public names, a README of one page, entry points, tests in its place."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest

from tests.taken_out import is_here, taken_words

ROOT = Path(__file__).resolve().parents[1]
KINDS = (
    "executive/pomona/tools",
    "drivers/pomona/tools",
    "drivers/pomona/devices",
    "skills/pomona/tools",
)
LEAVES = sorted(
    folder
    for kind in (*KINDS, "skills/pomona/applications")
    for folder in (ROOT / kind).iterdir()
    if folder.is_dir() and folder.name != "__pycache__"
)
EMULATORS = {"emulators", "laboratory_emulators"}  # devices that stand in for real ones
PAGE = 90  # lines of a README of one page: the longest lists 46 files


@pytest.fixture(params=LEAVES, ids=lambda folder: f"{folder.parent.name}/{folder.name}")
def leaf(request: pytest.FixtureRequest) -> Path:
    found: Path = request.param
    return found


def test_there_are_leaves_of_each_kind() -> None:
    assert {folder.parent.name for folder in LEAVES} == {"tools", "devices", "applications"}
    assert len(LEAVES) >= 20
    assert not list(ROOT.glob("*/pomona/tools/__init__.py")), (
        "a namespace, to which other distributions add"
    )


def test_a_leaf_has_a_docstring_and_a_readme_of_one_page(leaf: Path) -> None:
    assert ast.get_docstring(ast.parse((leaf / "__init__.py").read_text("utf-8")))
    page = (leaf / "README.md").read_text("utf-8")
    assert page.startswith("# ")
    assert page.count("\n") <= PAGE
    listed = set(re.findall(r"^\| (\w+\.py) \|", page, re.MULTILINE))
    assert listed in (set(), {path.name for path in leaf.glob("*.py")} - {"__init__.py"})
    for target in re.findall(r"\]\(([^)#]+)", page):
        path = (leaf / target).resolve()
        assert target.startswith("https:") or path.exists() or not is_here(f"{path}/"), target


CORE_PAGES = sorted(
    page
    for folder in ("executive/pomona/executive", "skills/pomona/skills", "drivers/pomona/drivers")
    for page in (ROOT / folder).rglob("README.md")
)
ARCHITECTURE = ROOT / "docs" / "architecture.md"


@pytest.mark.parametrize("page", CORE_PAGES, ids=lambda page: page.parent.name)
def test_a_readme_of_the_core_names_files_that_exist(page: Path) -> None:
    named = set(re.findall(r"(?<![\w/`.])((?:\w+/)*\w+\.py)", page.read_text("utf-8")))
    places = (page.parent, page.parents[1], page.parents[1] / "tools", ROOT)
    missing = [
        name
        for name in filter(is_here, named)
        if not any((place / name).is_file() for place in places)
    ]
    assert missing == []


def test_the_page_of_the_architecture_names_files_that_exist() -> None:
    if taken_words() is not None:
        pytest.skip("a leaf was taken out, and the page names its files")
    named = set(re.findall(r"(?<![\w/`.])`?((?:\w+/)*\w+\.py)", ARCHITECTURE.read_text("utf-8")))
    folders = [ROOT / name for name in ("executive", "skills", "drivers", "tests")]
    files = [f"/{path.relative_to(ROOT)}" for folder in folders for path in folder.rglob("*.py")]
    assert len(named) > 30
    assert {one for one in named if not any(file.endswith(f"/{one}") for file in files)} == set()


def test_a_leaf_has_tests_in_its_place(leaf: Path) -> None:
    floor, _, kind, name = leaf.relative_to(ROOT).parts
    assert list((ROOT / "tests" / floor / kind / name).rglob("test_*.py"))


def test_no_device_of_a_real_cell_may_import_a_simulated_one() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    real = next(
        each["source_modules"]
        for each in contracts
        if each["name"].startswith("Nothing that runs on a real")
    )
    devices = {folder.name for folder in LEAVES if folder.parent.name == "devices"}
    assert {name for name in real if name.startswith("pomona.devices.")} == {
        f"pomona.devices.{name}" for name in devices - EMULATORS
    }


def test_a_leaf_is_found_by_entry_point(leaf: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    module = f"pomona.{leaf.parent.name}.{leaf.name}."
    assert any(
        target.startswith(module)
        for group in project["entry-points"].values()
        for target in group.values()
    )
