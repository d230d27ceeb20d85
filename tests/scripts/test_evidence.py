"""scripts/evidence.py keeps at which commit a long target passed, and finds it stale after a change."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def evidence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script in a repository of its own, with a target that judges `code` and one that fails."""
    spec = importlib.util.spec_from_file_location("evidence", ROOT / "scripts" / "evidence.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "evidence", module)
    spec.loader.exec_module(module)
    (tmp_path / "code").mkdir()
    (tmp_path / "targets.yaml").write_text(
        "good: {run: 'true', judges: [code], safety: true}\nbad: {run: 'false', judges: [code]}\n"
    )
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "TARGETS", tmp_path / "targets.yaml")
    monkeypatch.setattr(module, "KEPT", tmp_path / "kept.json")
    git(tmp_path, "init", "--quiet")
    commit(tmp_path, "code/a.py")
    return module


def git(root: Path, *words: str) -> None:
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run(["git", *who, *words], cwd=root, check=True, capture_output=True)


def commit(root: Path, name: str) -> None:
    with (root / name).open("a") as file:
        file.write("1\n")
    git(root, "add", name)
    git(root, "commit", "--quiet", "-m", name)


def test_a_target_is_fresh_until_what_it_judges_changes(
    evidence: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert evidence.main(["status", "--check", "safety"]) == 1
    assert "never" in capsys.readouterr().out
    assert evidence.main(["run", "good"]) == 0
    assert evidence.main(["status", "--check", "safety"]) == 0
    assert evidence.main(["status", "--check"]) == 1, "the other target never passed"
    commit(tmp_path, "other.py")
    assert evidence.main(["status", "--check", "safety"]) == 0
    commit(tmp_path, "code/a.py")
    capsys.readouterr()
    assert evidence.main(["status", "--check", "safety"]) == 1
    assert "stale" in capsys.readouterr().out


def test_a_target_that_fails_is_not_kept(evidence: ModuleType, tmp_path: Path) -> None:
    assert evidence.main(["run", "good", "bad"]) == 1
    assert list(json.loads((tmp_path / "kept.json").read_text())) == ["good"]


def test_what_is_not_committed_is_not_judged(
    evidence: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "code" / "b.py").write_text("")
    assert evidence.main(["run", "good"]) == 1
    assert "commit" in capsys.readouterr().err
    assert not (tmp_path / "kept.json").exists()


def test_an_unknown_target_is_named(
    evidence: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert evidence.main(["run", "god"]) == 2
    assert "good, bad" in capsys.readouterr().err


def test_the_targets_name_what_is_there() -> None:
    import yaml

    makefile = (ROOT / "Makefile").read_text("utf-8")
    targets = yaml.safe_load((ROOT / "scripts" / "evidence.yaml").read_text("utf-8"))
    for name, target in targets.items():
        words = target["run"].split()
        assert f"\n{words[1]}:" in makefile, name
        assert [path for path in target["judges"] if not (ROOT / path).exists()] == [], name
    assert sum(target.get("safety", False) for target in targets.values()) >= 5
