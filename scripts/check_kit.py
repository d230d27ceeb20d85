"""What `pomona new` writes is typed: one of everything, judged by mypy with this repository's strict settings.

    python scripts/check_kit.py

It stands behind mypy's own run in `make check`, whose cache it shares.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from executive.cli import main

ROOT = Path(__file__).resolve().parents[1]


def check() -> int:
    """Write a package with one of everything, and let mypy judge it; mypy's exit status."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / "my_fruit_kit"
        main(["new", "package", "my_fruit_kit", "--into", folder])
        for kind, name in (("node", "forgive"), ("driver", "wall_camera"), ("skill", "weigh_fruit")):
            main(["new", kind, name, "--into", str(package)])
        paths = [str(package / "my_fruit_kit"), *map(str, sorted((package / "tests").glob("*.py")))]
        words = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), *paths]
        return subprocess.run(words, cwd=ROOT, check=False, env={"MYPYPATH": str(package), "PATH": ""}).returncode


if __name__ == "__main__":
    sys.exit(check())
