"""scripts/system_libraries.sh: an unsupported Python is refused in one line, before anything is installed."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "system_libraries.sh"

FAKE = """#!/bin/sh
# A Python of version 3.{minor}: it evaluates comparisons with sys.version_info, and knows venv.
case "$2" in
*"version_info <"*) exit $([ {minor} -lt 11 ] && echo 1 || echo 0) ;;
*"version_info >="*) exit $([ {minor} -ge 14 ] && echo 1 || echo 0) ;;
esac
[ "$1" = --version ] && echo "Python 3.{minor}.0"
exit 0
"""


@pytest.mark.parametrize(
    ("minor", "says"),
    [
        (10, "Pomona needs Python 3.11 or newer"),
        (11, ""),
        (13, ""),
        (
            14,
            "OMPL has no wheel for Python 3.14.0. Choose one: make PYTHON=python3.13",
        ),
    ],
)
def test_an_unsupported_python_is_refused_with_the_reason(
    tmp_path: Path, minor: int, says: str
) -> None:
    python = tmp_path / "python"
    python.write_text(FAKE.replace("{minor}", str(minor)))
    python.chmod(0o755)
    done = subprocess.run(
        ["sh", str(SCRIPT), "venv", str(python)], capture_output=True, text=True, check=False
    )
    assert done.returncode == (1 if says else 0)
    assert says in done.stderr
    assert done.stderr.count("\n") == (1 if says else 0)
