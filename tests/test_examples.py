"""Each script in examples/ runs as it stands and prints its result."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
LINES = 60
PRINTED = {
    "one_skill": ("SUCCESS after 0.2 s: 0.200 kg", "FAILURE: SENSOR_STALE"),
    "one_driver": ("camera: frame 1, (48, 64) pixels, 0.40 m, ok",),
    "refine_depth": ("scale 0.9000 (true 0.9)",),
    "plan_path": ("gripper at",),
    "grip_wrenches": ("HOLDING", "minimum grip force of this load"),
    "run_tree": ("SUCCESS  pick_apple/Attempt/Lift", "success after"),
    "read_record": ("success after",),
    "show_py_trees": ("success after",),
}


def test_each_example_is_short_and_tested() -> None:
    found = {path.stem: path.read_text("utf-8").count("\n") for path in EXAMPLES.glob("*.py")}
    assert found.keys() == PRINTED.keys()
    assert max(found.values()) <= LINES


def test_each_example_names_the_distribution_that_its_imports_need() -> None:
    for path in EXAMPLES.glob("*.py"):
        text = path.read_text("utf-8")
        whole = re.search(r"pomona\.(skills|drivers)\b|pick_apple", text) is not None
        assert (
            f"Needs the distribution pomona{'' if whole else ' or pomona-executive'}.\n" in text
        ), path


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in PRINTED if name != "read_record"])
def test_an_example_runs(name: str, tmp_path: Path) -> None:
    printed = run(name, tmp_path, *(["--dry"] if name == "run_tree" else []))
    for words in PRINTED[name]:
        assert words in printed
    if name in ("run_tree", "show_py_trees"):
        assert PRINTED["read_record"][0] in run("read_record", tmp_path)


def run(name: str, folder: Path, *arguments: str) -> str:
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
