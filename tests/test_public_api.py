"""The public API: names and signatures that change only as semantic versioning allows (docs/stability.md).

A change here needs a line in CHANGELOG.md. `python tests/test_public_api.py` writes tests/public_api.txt anew.
"""

from __future__ import annotations

import enum
import inspect
import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
LISTED = Path(__file__).with_name("public_api.txt")
PACKAGES = ("pomona.executive", "pomona.drivers")
GROUPS = ("pomona.skills", "pomona.drivers", "pomona.nodes", "pomona.commands")


def test_public_names_and_signatures_are_those_that_were_announced() -> None:
    assert list(api()) == LISTED.read_text("utf-8").splitlines()


def test_no_public_name_is_hidden_by_a_module_of_the_same_name() -> None:
    script = "import sys, pomona.drivers.cell, pomona.executive.execute, pomona.executive.skill_testing as _\n"
    script += "import pomona.drivers as d, pomona.executive as e, types\n"
    script += "print([n for m in (d, e) for n in m._HOMES if isinstance(getattr(m, n), types.ModuleType)])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_importing_a_package_loads_no_module_of_its_api() -> None:
    script = "import json, sys, pomona.executive, pomona.drivers; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = {name for name in json.loads(done.stdout) if name.startswith("pomona.")}
    assert loaded == {"pomona.executive", "pomona.drivers"}


def api() -> Iterator[str]:
    """Yield a line for each public name: constants with their type, functions and classes with their signatures."""
    for package in PACKAGES:
        module = import_module(package)
        for name in sorted(name for names in module.PUBLIC.values() for name in names):
            yield from described(f"{package}.{name}", getattr(module, name))
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]
    for group in GROUPS:
        yield f"entry point group {group}: {', '.join(sorted(scripts.get(group, ())))}"


def described(name: str, value: Any) -> Iterator[str]:
    if inspect.isfunction(value):
        yield f"{name}{inspect.signature(value)}"
    elif inspect.isclass(value):
        bases = ", ".join(base.__name__ for base in value.__bases__ if base is not object)
        yield f"{name}({bases})"
        if issubclass(value, enum.Enum):
            yield from (f"{name}.{member.name}" for member in value)
            return
        for member, inner in sorted(vars(value).items()):
            if member.startswith("_") and member != "__init__":
                continue
            if isinstance(inner, property):
                yield f"{name}.{member}: property"
            elif inspect.isfunction(inner):
                yield f"{name}.{member}{inspect.signature(inner)}"
            elif isinstance(inner, (classmethod, staticmethod)):
                yield f"{name}.{member}{inspect.signature(inner.__func__)}"
    else:
        yield f"{name}: {type(value).__name__}"


if __name__ == "__main__":
    LISTED.write_text("\n".join(api()) + "\n", encoding="utf-8")
