"""The bill of materials and the lock file list the installed packages."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        name, Path(__file__).parents[1] / "scripts" / f"{name}.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_bill_of_materials_names_every_package_that_pomona_needs_with_its_version() -> None:
    bill = script("sbom").bill("pomona")
    listed = {component["name"].lower(): component["version"] for component in bill["components"]}
    for needed in ("numpy", "numba", "mcap", "orjson", "starlette", "zstandard", "pyyaml"):
        assert listed[needed] == version(needed)
    assert "pytest" not in listed  # needed for tests only
    assert "pytest" in {
        component["name"] for component in script("sbom").bill("pomona", ["dev"])["components"]
    }
    references = {component["bom-ref"] for component in bill["components"]} | {
        bill["metadata"]["component"]["bom-ref"]
    }
    assert {entry["ref"] for entry in bill["dependencies"]} == references
    assert all(set(entry["dependsOn"]) <= references for entry in bill["dependencies"])
    assert bill == script("sbom").bill("pomona")


def test_a_lock_file_holds_each_package_with_its_hash_and_refuses_one_without() -> None:
    hashed = {"archive_info": {"hashes": {"sha256": "ab" * 32}}}
    report = {"install": [
        {"metadata": {"name": "NumPy", "version": "2.0"}, "download_info": hashed},
        {"metadata": {"name": "pomona", "version": "0.1"}, "download_info": {}},
    ]}  # fmt: skip
    assert script("lock").locked(report).endswith(f"numpy==2.0 \\\n    --hash=sha256:{'ab' * 32}\n")
    report["install"][0]["download_info"] = {"url": "file:///somewhere"}
    with pytest.raises(ValueError, match="without a SHA-256"):
        script("lock").locked(report)


def test_constraints_name_each_package_once_without_local_labels() -> None:
    report = {"install": [
        {"metadata": {"name": "torch", "version": "2.13.0+cpu"}},
        {"metadata": {"name": "NumPy", "version": "2.4.6"}},
        {"metadata": {"name": "pomona", "version": "0.1"}},
    ]}  # fmt: skip
    assert script("lock").constraints(report).splitlines()[1:] == ["numpy==2.4.6", "torch==2.13.0"]


def pinned(path: Path) -> dict[str, str]:
    found = re.findall(r"^([\w.-]+)==([^\s+]+)", path.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[-_.]+", "-", name.lower()): number for name, number in found}


def test_the_lock_file_and_the_constraints_name_the_same_versions_within_the_bounds_of_pyproject() -> (
    None
):
    root = Path(__file__).parents[1]
    constraints, lock = pinned(root / "constraints.txt"), pinned(root / "requirements.lock")
    assert lock.items() <= constraints.items()
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    assert "pomona[torch]" in extras["dev"]
    for line in [*project["dependencies"], *extras["dev"], *extras["torch"]]:
        wanted = Requirement(line)
        if wanted.name == project["name"]:
            continue
        name = re.sub(r"[-_.]+", "-", wanted.name.lower())
        if wanted.marker is None or wanted.marker.evaluate():
            assert wanted.specifier.contains(constraints[name]), line
            assert any(part.operator in ("<", "==") for part in wanted.specifier), (
                f"{line} has no upper bound"
            )
