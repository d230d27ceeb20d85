"""The tutorials as notebooks, made from their Markdown and executed: `make notebooks`.

    python scripts/notebooks.py [NAME …]     # docs/tutorials/NAME.ipynb beside NAME.md; without names those that are there

The Markdown is the source. A fence with a title becomes a cell that writes the file, lines of `bash` become a cell that
bash carries out (`!` would give them a terminal, and the run's moving picture would be kept line by line), a `text`
fence is replaced by the cell's own output. A fence marked `long=yes` is not executed; only one marked `exit=…` may
fail. A test holds the cells against the Markdown.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pomona.executive.values.installation import commit_here

ROOT = Path(__file__).resolve().parents[1]
TUTORIALS = ROOT / "docs" / "tutorials"
FENCE = re.compile(r"^```(\w+)(?: ([^\n]*))?\n(.*?)^```\n?", re.MULTILINE | re.DOTALL)
TITLE = re.compile(r'title="([^"]+)"')
LONG = "# takes minutes: not carried out here\n"
LIMIT = 900
"""A cell may take so long [s]."""


def cells(text: str, name: str) -> Iterator[tuple[str, str]]:
    """(kind, source) of every cell of a tutorial; the link to the notebook is left out."""
    text = text.replace(f" ([as a notebook]({name}.ipynb))", "")
    said = ""
    for fence in FENCE.finditer(text):
        language, title, body = fence[1], TITLE.search(fence[2] or ""), fence[3]
        said += text[_end(text, fence) : fence.start()]
        if title is not None:
            code = f"%%writefile {title[1]}\n{body}"
        elif language == "bash":
            said_of_it = fence[2] or ""
            code = f"%%bash{' --no-raise-error' if 'exit=' in said_of_it else ''}\n"
            code += (LONG if "long=yes" in said_of_it else "") + body
        elif language == "text":
            continue
        else:
            said += fence[0]
            continue
        if said.strip():
            yield "markdown", said.strip()
        said = ""
        yield "code", code.rstrip("\n")
    last = [*FENCE.finditer(text)][-1].end()
    if (said + text[last:]).strip():
        yield "markdown", (said + text[last:]).strip()


def _end(text: str, fence: re.Match[str]) -> int:
    """Where the fence before this one ends."""
    before = [*FENCE.finditer(text, 0, fence.start())]
    return before[-1].end() if before else 0


def notebook(text: str, name: str) -> dict[str, Any]:
    """Return a notebook that has not been executed."""
    made: list[dict[str, Any]] = []
    for number, (kind, source) in enumerate(cells(text, name)):
        cell: dict[str, Any] = {
            "cell_type": kind,
            "id": f"cell-{number}",
            "metadata": {},
            "source": source,
        }
        if LONG in source:
            cell["metadata"] = {"tags": ["skip-execution"]}
        made.append(cell | ({"execution_count": None, "outputs": []} if kind == "code" else {}))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": made, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def _installed(folder: str) -> str:
    """Where the commands that are typed in a folder come from."""
    where = "from pomona.executive.values.installation import installed_trees; print(installed_trees().parent)"
    done = subprocess.run(
        [sys.executable, "-c", where], cwd=folder, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def execute(made: dict[str, Any]) -> dict[str, Any]:
    """Return the notebook with the output of its cells, executed in an empty folder; installed packages stay there."""
    import nbformat
    from nbclient import NotebookClient

    with tempfile.TemporaryDirectory() as folder:
        here = f"{folder}/site-packages"
        os.environ |= {
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "COLUMNS": "120", "PYTHONPATH": here,
            "PIP_TARGET": here, "PIP_NO_DEPS": "1", "PIP_NO_BUILD_ISOLATION": "0", "NO_COLOR": "1",
            "PIP_DISABLE_PIP_VERSION_CHECK": "1", "PIP_ROOT_USER_ACTION": "ignore",
        }  # fmt: skip
        read = nbformat.from_dict(made)
        NotebookClient(
            read, timeout=LIMIT, coalesce_streams=True, resources={"metadata": {"path": folder}}
        ).execute()
        text = (
            nbformat.writes(read)
            .replace(f"{folder}/", "")
            .replace(folder, ".")
            .replace(f"{_installed(folder)}/", "")
        )
        done = json.loads(text)
    for cell in done["cells"]:
        cell["metadata"].pop("execution", None)
        cell["source"] = "".join(cell["source"])
    done["metadata"] |= {"pomona": {"command": "make notebooks", "commit": commit_here()}}
    return dict(done)


def main() -> None:
    """Make and execute them."""
    for name in sys.argv[1:] or sorted(page.stem for page in TUTORIALS.glob("*.ipynb")):
        done = execute(notebook((TUTORIALS / f"{name}.md").read_text("utf-8"), name))
        out = TUTORIALS / f"{name}.ipynb"
        out.write_text(json.dumps(done, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        sys.stdout.write(f"{out.name}: {len(done['cells'])} cells\n")


if __name__ == "__main__":
    main()
