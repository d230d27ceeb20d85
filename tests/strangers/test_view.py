"""A view of a run in a stranger's package: found beside pomona, opened by its option, refused as every option is."""

from __future__ import annotations

from pathlib import Path

from tests.strangers.installed import HERE, pomona

TREE = "pomona: 1\ntree: rest\nroot:\n  wait: 10 ms\n"
VIEW = HERE / "status_file"


def test_its_option_belongs_to_run_and_it_follows_the_run_to_its_end(tmp_path: Path) -> None:
    (tmp_path / "rest.yaml").write_text(TREE)
    done = pomona(
        "run", "rest.yaml", "--dry", "--status-file", "state.txt", package=VIEW, folder=tmp_path
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "state.txt").read_text() == "rest success\n"


def test_without_its_option_it_does_nothing_and_a_bad_path_begins_no_run(tmp_path: Path) -> None:
    (tmp_path / "rest.yaml").write_text(TREE)
    assert pomona("run", "rest.yaml", "--dry", package=VIEW, folder=tmp_path).returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rest.yaml", "runs", "site"]
    done = pomona(
        "run", "rest.yaml", "--dry", "--status-file", "no/state", package=VIEW, folder=tmp_path
    )
    assert done.returncode == 2
    assert "--status-file no/state: No such file or directory" in done.stderr
    assert len(list((tmp_path / "runs").iterdir())) == 1
