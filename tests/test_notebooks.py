"""The notebooks beside the tutorials have their text and their commands, and were carried out."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))


@pytest.fixture(scope="module")
def notebooks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("notebooks", ROOT / "scripts" / "notebooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_is_its_tutorial_carried_out(file: Path, notebooks: ModuleType) -> None:
    text = file.with_suffix(".md").read_text("utf-8")
    assert f"([as a notebook]({file.stem}.ipynb))" in text
    made = json.loads(file.read_text("utf-8"))
    wanted = notebooks.notebook(text, file.stem)
    shown = [
        [(cell["cell_type"], cell["source"]) for cell in one["cells"]] for one in (made, wanted)
    ]
    assert shown[0] == shown[1], "make notebooks"
    assert re.fullmatch(r"[0-9a-f]{7,}\+?", made["metadata"]["pomona"]["commit"])
    for cell in made["cells"]:
        if cell["cell_type"] == "code" and notebooks.LONG not in cell["source"]:
            assert cell["execution_count"], cell["source"]
            assert not any(output["output_type"] == "error" for output in cell["outputs"]), cell[
                "source"
            ]
    assert not re.search(r"/[\w.-]+(?:/[\w.-]+)*/trees/", json.dumps(made)), (
        "a path of the machine that made it"
    )


def test_a_tutorial_becomes_cells(notebooks: ModuleType) -> None:
    text = (
        '# Look\n\nSay ([as a notebook](look.ipynb)).\n\n```yaml title="look.yaml"\ntree: look\n```\n\n```bash\n'
        "pomona check look.yaml\n```\n\n```text\nnothing\n```\n\n```bash exit=2\n"
        "pomona check loo.yaml\n```\n\nThat is it.\n\n```yaml\na: 1\n```\n"
    )
    assert list(notebooks.cells(text, "look")) == [
        ("markdown", "# Look\n\nSay."),
        ("code", "%%writefile look.yaml\ntree: look"),
        ("code", "%%bash\npomona check look.yaml"),
        ("code", "%%bash --no-raise-error\npomona check loo.yaml"),
        ("markdown", "That is it.\n\n```yaml\na: 1\n```"),
    ]
