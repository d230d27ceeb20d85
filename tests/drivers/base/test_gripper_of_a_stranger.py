"""A gripper in a package of its own, as `pomona new gripper` writes it, closes on an object in a tree."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from pomona.executive.cli import main

MOST = 190  # lines of a gripper's driver, with the emulated gripper at the other end of its wire


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new package, outside the repository."""
    folder = tmp_path_factory.mktemp("stranger")
    assert main(["new", "gripper", "Clamp", "--into", str(folder)]) == 0
    return folder / "clamp"


def test_a_new_gripper_has_few_lines(package: Path) -> None:
    text = (package / "pomona_clamp" / "clamp.py").read_text("utf-8")
    assert text.count("\n") <= MOST


@pytest.mark.slow
def test_a_cell_file_connects_it_and_a_tree_grips_with_it(package: Path) -> None:
    site = package.parent / "site"
    words = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(site)]
    subprocess.run(words, cwd=package, check=True, capture_output=True)
    with zipfile.ZipFile(next(site.glob("*.whl"))) as wheel:
        wheel.extractall(site)  # as pip installs it, with its entry point
    script = "import sys; from pomona.executive.cli import main; sys.exit(main(sys.argv[1:]))"
    run = [
        "run",
        "cells/clamp_tree.yaml",
        "--cell",
        "cells/clamp.yaml",
        "--cleared",
        "--record",
        "records",
    ]
    done = subprocess.run(
        [sys.executable, "-c", script, *run],
        cwd=package,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "the fingers stopped at 50.0 mm on their way to 20.0 mm" in done.stdout
    assert list((package / "records").iterdir())
