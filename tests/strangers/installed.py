"""Packages of strangers, installed beside pomona without pip and its network, and used in processes of their own."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent


def install(package: Path, site: Path) -> None:
    """Write the metadata of a package with a pyproject.toml into a folder for modules, as pip does."""
    project = tomllib.loads((package / "pyproject.toml").read_text("utf-8"))["project"]
    metadata = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    metadata.mkdir(parents=True)
    head = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (metadata / "METADATA").write_text(head, encoding="utf-8")
    lines: list[str] = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in points.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")


def pomona(*words: str, package: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command of pomona in `folder`, where the package is installed in `folder/site`."""
    if not (folder / "site").is_dir():
        install(package, folder / "site")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join((str(folder / "site"), str(package))),
    }
    command = [sys.executable, "-m", "pomona.executive.cli", *words]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
