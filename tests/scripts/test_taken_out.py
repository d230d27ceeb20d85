"""Which texts name a leaf that was taken out: those are left out of a trial without it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import taken_out

PROJECT = """
[project.entry-points."pomona.drivers"]
# taken out: crane = "pomona.devices.crane.connect:connect"
# taken out: Hoist = "pomona.devices.crane.hoist:Hoist"
belt = "pomona.devices.belt.connect:connect"
"""


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    texts = {
        "pyproject.toml": PROJECT,
        "drivers/pomona/devices/belt/__init__.py": "",
        "trees/cells/yard.yaml": "devices:\n  lift:\n    driver: crane\n",
        "trees/cells/shed.yaml": "include: yard.yaml\n",
        "trees/cells/hall.yaml": "devices: {belt: {driver: belt}}\n",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(taken_out, "ROOT", tmp_path)
    for kept in (taken_out.leaves, taken_out.taken_words):
        monkeypatch.setattr(taken_out, kept.__name__, kept.__wrapped__)
    return tmp_path


@pytest.mark.parametrize(
    ("text", "is_named"),
    [
        ("driver('crane')", True),
        ("devices: {a: {driver: crane}}", True),
        ("pomona crane --help", True),
        ('load(CELLS / "yard.yaml")', True),
        ("read('shed')", True),  # includes a cell with the driver
        ("new cell --lift crane --into DIR", True),
        ("run tree --cell shed", True),
        ("run tree --cell hall", False),
        ("only Hoist writes one", True),
        ("Hoisted", False),
        ("read('hall')", False),
        ("driver: belt", False),
        ("a crane stands here", False),
        ("driver: cranes", False),
    ],
)
def test_a_text_names_drivers_and_cells_of_a_leaf_that_was_taken_out(
    checkout: Path, text: str, is_named: bool
) -> None:
    words = taken_out.taken_words()
    assert words is not None
    assert (words.search(text) is not None) == is_named


def test_without_a_leaf_taken_out_there_are_no_words(checkout: Path) -> None:
    (checkout / "pyproject.toml").write_text(PROJECT.replace("# taken out: ", ""))
    assert taken_out.taken_words() is None


@pytest.mark.parametrize(
    ("text", "is_here"),
    [
        ("from pomona.devices.belt import Belt", True),
        ("from pomona.devices import crane", False),
        ("entry point pomona.drivers crane of pomona.devices.crane", False),
        ("drivers/pomona/devices/crane/connect.py", False),
        ("devices/belt/connect.py", True),
        ("motion_supervisor.py", True),
    ],
)
def test_modules_and_files_of_a_leaf_that_was_taken_out_are_not_here(
    checkout: Path, text: str, is_here: bool
) -> None:
    assert taken_out.is_here(text) == is_here
