"""docs/tutorials and pages of docs with commands: each runs as it is written, in an empty folder.

A fence with a `title="file"` writes a file, the lines of `bash` are typed (`exit=2`: they end so, `exit=any`: anyhow),
and those of `text` are, in this order, within the output of the commands before them. Fences marked `long=yes` are
typed by `make test-long`, as are the pages of docs and the tutorials named below.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
TUTORIALS = sorted((DOCS / "tutorials").glob("*.md"))
PAGES = [page for page in sorted(DOCS.glob("*.md")) if "\n```bash" in page.read_text("utf-8")]
LONGER = {"campaign", "own_gripper", "read_a_record"}
"""Tutorials of whole campaigns, of drivers and of exports, each of which has tests of its own."""
QUICK = [page for page in TUTORIALS if page.stem not in LONGER]
LONG = [page for page in TUTORIALS if page not in QUICK or "long=yes" in page.read_text("utf-8")]
FENCE = re.compile(r"^```(\w+)(?: ([^\n]*))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize(
    "tutorial",
    [pytest.param(page, id=page.stem) for page in QUICK],
)
def test_a_tutorial_runs_as_it_is_written(tutorial: Path, tmp_path: Path) -> None:
    assert follow(tutorial, tmp_path, long=False) >= 3


@pytest.mark.long
@pytest.mark.parametrize("page", [*PAGES, *LONG], ids=lambda page: page.stem)
def test_a_page_runs_as_it_is_written_with_all_that_takes_long(page: Path, tmp_path: Path) -> None:
    follow(page, tmp_path, long=True)


def follow(page: Path, folder: Path, long: bool) -> int:
    """Type the commands of a page; return their number."""
    text, printed, typed = page.read_text("utf-8"), "", 0
    here = str(folder / "site-packages")  # what a page installs stays in its folder
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "COLUMNS": "200", "PYTHONPATH": here,
        "PIP_TARGET": here, "PIP_NO_DEPS": "1", "PIP_NO_BUILD_ISOLATION": "0", "PIP_DISABLE_PIP_VERSION_CHECK": "1",
    }  # fmt: skip
    skipped = False
    for fence in FENCE.finditer(text):
        language, options, body = (
            fence[1],
            dict(re.findall(r'(\w+)="?([^" ]+)"?', fence[2] or "")),
            fence[3],
        )
        line = f"{page.name}:{text.count(chr(10), 0, fence.start()) + 1}"
        if "title" in options:
            (folder / options["title"]).write_text(body, encoding="utf-8")
        elif language == "bash":
            printed, skipped = "", options.get("long") == "yes" and not long
            for command in () if skipped else body.splitlines():
                done = subprocess.run(
                    shlex.split(command),
                    cwd=folder,
                    env=environment,
                    capture_output=True,
                    text=True,
                    timeout=3600,
                )
                printed, typed = printed + done.stdout + done.stderr, typed + 1
                wanted = options.get("exit", "0")
                assert wanted == "any" or done.returncode == int(wanted), (
                    f"{line}: {command}\n{printed}"
                )
        elif language == "text" and not skipped:
            rest = printed
            for wanted in body.splitlines():
                _, found, rest = rest.partition(wanted)
                assert found, f"{line}: '{wanted}' does not come where it should:\n{printed}"
    return typed
