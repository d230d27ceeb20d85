"""Type check of third-party code: the files of `pomona new`, the README's skill and the packages of tests/strangers.

    python scripts/check_kit.py

mypy judges it with this repository's strict settings, behind its own run in `make check`, whose cache it shares;
pyright (basedpyright, which brings its own node) in its strict mode, against a wheel that is built for it.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

from pomona.executive.cli import main

ROOT = Path(__file__).resolve().parents[1]
IMPORTS = """from typing import Annotated

import numpy as np
from pomona.drivers import ForceSensor
from pomona.executive import TIME, Mass, Outputs, Port, Skill, Time, Work
from numpy.typing import NDArray


def mass_of(wrenches: NDArray[np.float64]) -> float:
    return float(wrenches[:, 0].sum()) / 9.81


"""
"""Imports that the README's skill leaves out."""


def check() -> int:
    """Write a package with one of everything, and let both judge it; 0 when both are content."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / "my_fruit_kit"
        main(["new", "package", "my_fruit_kit", "--into", folder])
        pieces = (
            "node forgive",
            "driver wall_camera",
            "gripper clamp",
            "arm reacher",
            "skill weigh_fruit",
        )
        for kind, name in map(str.split, pieces):
            main(["new", kind, name, "--into", str(package)])
        (package / "my_fruit_kit" / "weigh.py").write_text(IMPORTS + readme_skill())
        for module in sorted((ROOT / "tests" / "strangers").glob("*/*.py")):
            (package / "my_fruit_kit" / module.name).write_text(module.read_text())
        return mypy(package) | pyright(package, Path(folder))


def readme_skill() -> str:
    """The skill that the README shows."""
    found = re.search(
        r"```python\n(class Weighed.*?)```", (ROOT / "README.md").read_text(), re.DOTALL
    )
    if found is None:
        raise SystemExit("README.md shows no skill")
    return found[1]


def mypy(package: Path) -> int:
    """mypy's exit status, with this repository's settings."""
    paths = [str(package / "my_fruit_kit"), *map(str, sorted((package / "tests").glob("*.py")))]
    words = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), *paths]
    return subprocess.run(
        words, cwd=ROOT, check=False, env={"MYPYPATH": str(package), "PATH": ""}
    ).returncode


def pyright(package: Path, folder: Path) -> int:
    """pyright's exit status in its strict mode, in an environment in which the wheel is installed."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder / "wheel")]
    subprocess.run(
        build, cwd=ROOT, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    venv.create(folder / "venv", symlinks=True)
    (site,) = (folder / "venv").glob("lib/*/site-packages")
    with zipfile.ZipFile(next((folder / "wheel").glob("*.whl"))) as wheel:
        wheel.extractall(site)
    (site / "others.pth").write_text(
        "\n".join(place for place in sys.path if place.endswith("site-packages"))
    )
    settings = {
        "include": ["."],
        "typeCheckingMode": "strict",
        "venvPath": str(folder),
        "venv": "venv",
    }
    (package / "pyrightconfig.json").write_text(json.dumps(settings))
    words = [sys.executable, "-m", "basedpyright", "--project", str(package)]
    return subprocess.run(words, cwd=package, check=False).returncode


if __name__ == "__main__":
    sys.exit(check())
