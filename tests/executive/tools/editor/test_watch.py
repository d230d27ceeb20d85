"""A saved tree is checked, its changes are reported, and it runs again only when it can."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from pomona.tools.editor.command_watch import run_on_save

TREE = "pomona: 1\ntree: t\nroot:\n  sequence:\n    - wait: 1 s\n"


def watched(path: Path, saves: list[Callable[[], object]]) -> tuple[int, str]:
    """Return the runs and reports while the file is saved as in `saves`, one between two checks."""
    runs: list[int] = []
    told = io.StringIO()
    script = iter(saves)

    def wait(_seconds: float) -> None:
        try:
            next(script)()
        except StopIteration:
            raise KeyboardInterrupt from None

    def run() -> int:
        runs.append(1)
        return 0

    assert run_on_save(path, {}, run, Console(file=told, width=200, markup=False), wait) == 0
    return len(runs), told.getvalue()


def test_a_changed_tree_runs_again_and_lists_the_changes(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(TREE)
    runs, told = watched(path, [lambda: path.write_text(TREE.replace("1 s", "25 s"))])
    assert runs == 2
    assert "25 s" in told


def test_a_broken_tree_is_explained_and_not_run(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(TREE)
    runs, told = watched(path, [lambda: path.write_text(TREE + "    - Nothing: {}\n"), lambda: None])
    assert runs == 1
    assert "error[unknown-skill]" in told


def test_a_new_comment_is_no_reason_to_run(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(TREE)
    runs, told = watched(path, [lambda: path.write_text("# why\n" + TREE)])
    assert runs == 1
    assert "nothing that runs has changed" in told


def test_a_file_that_is_away_for_a_moment_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(TREE)
    runs, told = watched(path, [path.unlink, lambda: path.write_text(TREE.replace("1 s", "3 s"))])
    assert runs == 2
    assert "No such file" in told


def test_a_file_that_is_broken_at_first_runs_as_soon_as_it_can(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(TREE + "    - Nothing: {}\n")
    runs, told = watched(path, [lambda: path.write_text(TREE + "    - Nobody: {}\n"), lambda: path.write_text(TREE)])
    assert runs == 1
    assert told.count("error[unknown-skill]") == 2
