"""Wheels for other systems, as docs/hardware.md#computers states them: resolved by pip, not run. Needs an index."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]

SYSTEMS = {
    "linux aarch64": [f"manylinux{tag}_aarch64" for tag in ("2014", "_2_17", "_2_27", "_2_28")],
    "macos arm64": [f"macosx_{version}_0_arm64" for version in (11, 12, 13, 14, 15)],
    "windows amd64": ["win_amd64"],
}
WITHOUT_OMPL = ("windows amd64",)


def resolve(system: str, requirements: list[str], target: Path) -> str:
    """Return pip's complaints; empty when each requirement has a wheel."""
    platforms = [word for name in SYSTEMS[system] for word in ("--platform", name)]
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--dry-run",
        "--no-deps",
        "--only-binary",
        ":all:",
    ]
    done = subprocess.run(
        [*command, "--python-version", "3.11", "--target", str(target), *platforms, *requirements],
        capture_output=True,
        text=True,
        check=False,
    )
    if "No matching distribution" not in done.stderr and "ERROR" in done.stderr:
        pytest.skip(f"the index does not answer: {done.stderr[-200:]}")
    return done.stderr if done.returncode else ""


@pytest.mark.long
@pytest.mark.parametrize("system", SYSTEMS)
def test_requirements_have_wheels_for(system: str, tmp_path: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    lines = [line for line in project["dependencies"] if Requirement(line).name != "ompl"]
    assert resolve(system, lines, tmp_path) == ""
    (planner,) = (line for line in project["dependencies"] if Requirement(line).name == "ompl")
    assert bool(resolve(system, [planner], tmp_path)) == (system in WITHOUT_OMPL)
