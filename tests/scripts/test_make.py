"""The Makefile asks the network for nothing once its environment is there."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """The files that decide on installing, with the marks of an installation that is newer than they are."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt", "scripts/system_libraries.sh"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
        os.utime(tmp_path / name, (1, 1))
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    for name in ("bin/python", ".runs", ".installed"):
        (tmp_path / ".venv" / name).touch()
    return tmp_path


def planned(clone: Path, target: str) -> str:
    """The commands that `make TARGET` would carry out."""
    words = ["make", "--no-print-directory", "-n", target]
    return subprocess.run(words, cwd=clone, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("target", ["run", "test"])
def test_a_second_time_nothing_is_installed(clone: Path, target: str) -> None:
    assert "pip install" not in planned(clone, target)


def test_changed_requirements_are_installed(clone: Path) -> None:
    os.utime(clone / "pyproject.toml")
    os.utime(clone / ".venv" / ".runs", (2, 2))
    assert "pip install" in planned(clone, "run")
