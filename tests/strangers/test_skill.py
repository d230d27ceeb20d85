"""A skill begun with `pomona new skill`: in its package beside pomona, it is listed and runs in a tree on a cell."""

from __future__ import annotations

from pathlib import Path

from pomona.executive.cli import main
from tests.strangers.installed import pomona

TREE = """pomona: 1
tree: reach
root:
  sequence:
    - ReachUp: {above: 5 cm, height: "{height}"}
    - check: "{height} > 10 cm"
"""


def test_its_skill_runs_in_a_tree(tmp_path: Path) -> None:
    assert main(["new", "package", "my_kit", "--into", str(tmp_path)]) == 0
    package = tmp_path / "my_kit"
    assert main(["new", "skill", "ReachUp", "--into", str(package)]) == 0
    assert main(["new", "cell", "bench", "--into", str(tmp_path)]) == 0
    (tmp_path / "reach.yaml").write_text(TREE)
    done = pomona("run", "reach.yaml", "--cell", "bench.yaml", package=package, folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "✓ reach  succeeded" in done.stdout
    (tmp_path / "reach.yaml").write_text(TREE.replace("5 cm", "2 m"))
    done = pomona("run", "reach.yaml", "--cell", "bench.yaml", package=package, folder=tmp_path)
    assert done.returncode == 1
    assert "TOO_HIGH" in done.stdout
