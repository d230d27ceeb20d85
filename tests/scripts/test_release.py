"""scripts/release.py: obstacles to a release are reported before anything is built."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def release() -> ModuleType:
    spec = importlib.util.spec_from_file_location("release", ROOT / "scripts" / "release.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    (tmp_path / "CHANGELOG.md").write_text(
        "# Changelog\n\n## [1.2.0] - 2026-01-31\n\n- All of it.\n"
    )
    (tmp_path / "CITATION.cff").write_text("version: 1.2.0\n")
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "All of it"]):
        author = ["-c", "user.name=t", "-c", "user.email=t@example.org"]
        subprocess.run(["git", *author, *words], cwd=tmp_path, check=True)
    return tmp_path


def test_a_version_that_is_dated_cited_and_committed_can_be_released(
    release: ModuleType, repository: Path
) -> None:
    assert list(release.problems(repository, "1.2.0")) == []


@pytest.mark.parametrize(
    ("file", "text", "says"),
    [
        ("CHANGELOG.md", "## [1.2.0] - unreleased\n", "has no heading '## [1.2.0]"),
        ("CHANGELOG.md", "## [1.1.0] - 2026-01-31\n", "has no heading '## [1.2.0]"),
        ("CITATION.cff", "version: 1.1.0\n", "is not about version 1.2.0"),
    ],
)
def test_a_mismatch_is_reported(
    release: ModuleType, repository: Path, file: str, text: str, says: str
) -> None:
    (repository / file).write_text(text)
    found = list(release.problems(repository, "1.2.0"))
    assert any(says in problem for problem in found)
    assert "there are changes that are not committed" in found


def test_a_long_target_that_is_stale_keeps_from_a_release(
    release: ModuleType, repository: Path
) -> None:
    folder = repository / "scripts"
    folder.mkdir()
    shutil.copy(ROOT / "scripts" / "evidence.py", folder)
    rows = "good: {run: 'true', judges: [code]}\nold: {run: 'true', judges: [CITATION.cff]}\n"
    (folder / "evidence.yaml").write_text(rows)
    head = release.git(repository, "rev-parse", "HEAD")
    passed = {"commit": head, "date": "2026-01-31", "seconds": 1}
    (folder / "evidence.json").write_text(json.dumps({"good": passed}))
    (problem,) = release.stale(repository)
    assert " old; " in problem
    assert "good" not in problem
    (folder / "evidence.json").write_text(json.dumps({"good": passed, "old": passed}))
    assert list(release.stale(repository)) == []


def test_a_version_is_released_once(release: ModuleType, repository: Path) -> None:
    subprocess.run(["git", "tag", "v1.2.0"], cwd=repository, check=True)
    assert list(release.problems(repository, "1.2.0")) == ["v1.2.0 is a tag already"]


def test_a_version_is_not_tagged_with_a_placeholder_for_the_public_address(
    release: ModuleType, tmp_path: Path
) -> None:
    for name in release.ADDRESSED:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("url: https://x.net/pomona\n")
    (tmp_path / "SECURITY.md").write_text("write to security@example.org\n")
    (problem,) = release.placeholders(tmp_path)
    assert problem.startswith("SECURITY.md holds the placeholder example.org")


def test_each_file_with_a_placeholder_is_looked_at(release: ModuleType) -> None:
    names = ("git", "ls-files", "*.md", "*.toml", "*.yml", "*.cff", ".github")
    listed = subprocess.run(
        names, cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split()
    found = {
        name
        for name in listed
        if "docs/" not in name and release.PLACEHOLDER in (ROOT / name).read_text("utf-8")
    }
    assert found == set(release.ADDRESSED)


def test_the_container_holds_the_needs_of_the_package() -> None:
    told = (ROOT / "Containerfile").read_text()
    needed = {"libegl1", "libegl-mesa0", "libopengl0", "libgl1-mesa-dri"}
    libraries = (ROOT / "scripts" / "system_libraries.sh").read_text()
    assert all(library in told and library in libraries for library in needed)
    assert "USER pomona" in told
    assert "HEALTHCHECK" in told
