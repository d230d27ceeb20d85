"""docs/tutorials: every tutorial runs as it is written, in an empty folder.

A fence with a `title="file"` writes a file, the lines of `bash` are typed (`exit=2`: they end so), and those of `text`
are, in this order, within what the commands before them printed.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

TUTORIALS = sorted((Path(__file__).resolve().parents[1] / "docs" / "tutorials").glob("*.md"))
FENCE = re.compile(r"^```(\w+)(?: ([^\n]*))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize("tutorial", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_runs_as_it_is_written(tutorial: Path, tmp_path: Path) -> None:
    text, printed, typed = tutorial.read_text("utf-8"), "", 0
    here = str(tmp_path / "site-packages")  # what a tutorial installs stays in its folder
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "COLUMNS": "200", "PYTHONPATH": here,
        "PIP_TARGET": here, "PIP_NO_DEPS": "1", "PIP_NO_BUILD_ISOLATION": "0", "PIP_DISABLE_PIP_VERSION_CHECK": "1",
    }  # fmt: skip
    for fence in FENCE.finditer(text):
        language, options, body = fence[1], dict(re.findall(r'(\w+)="?([^" ]+)"?', fence[2] or "")), fence[3]
        line = f"{tutorial.name}:{text.count(chr(10), 0, fence.start()) + 1}"
        if "title" in options:
            (tmp_path / options["title"]).write_text(body, encoding="utf-8")
        elif language == "bash":
            printed = ""
            for command in body.splitlines():
                done = subprocess.run(
                    shlex.split(command), cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300
                )
                printed, typed = printed + done.stdout + done.stderr, typed + 1
                assert done.returncode == int(options.get("exit", "0")), f"{line}: {command}\n{printed}"
        elif language == "text":
            rest = printed
            for wanted in body.splitlines():
                _, found, rest = rest.partition(wanted)
                assert found, f"{line}: '{wanted}' does not come where it should:\n{printed}"
    assert typed >= 3
