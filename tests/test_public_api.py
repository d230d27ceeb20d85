"""The public API: names and signatures that change only as semantic versioning allows (docs/stability.md).

A change here needs a line in CHANGELOG.md. `python -m tests.test_public_api` writes tests/public_api.txt anew.
"""

from __future__ import annotations

import ast
import enum
import inspect
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from pomona.executive.values.public_names import full_name
from tests.taken_out import is_here

ROOT = Path(__file__).resolve().parents[1]
PUBLIC_NAMES = "pomona.executive.values.public_names"
COMPILING = {
    "pomona.skills.compiled_code",
    "pomona.executive.values.sentences",
}  # set up by `pomona.skills` itself
LISTED = Path(__file__).with_name("public_api.txt")
STABLE = ("pomona.executive", "pomona.drivers")  # listed with their signatures
PROVISIONAL = (
    *filter(is_here, ["pomona.tools.simulation"]),
    "pomona.skills",
    "pomona.skills.grip",
    "pomona.skills.motion",
    "pomona.skills.perception",
)
PACKAGES = (*STABLE, *PROVISIONAL)
GROUPS = ("pomona.skills", "pomona.drivers", "pomona.nodes", "pomona.commands", "pomona.run_views")


def test_public_names_and_signatures_are_those_that_were_announced() -> None:
    listed = LISTED.read_text("utf-8").splitlines()
    assert list(api()) == [line for line in listed if is_here(line)]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_public_name_is_hidden_by_a_module_of_the_same_name(package: str) -> None:
    module = import_module(package)
    (folder,) = module.__path__
    modules = {path.stem for path in Path(folder).iterdir()}
    assert not modules & set(public(module))


@pytest.mark.parametrize("package", PACKAGES)
def test_type_checkers_see_the_names_that_are_loaded_from_where_they_are_loaded(
    package: str,
) -> None:
    module = import_module(package)
    tree = ast.parse(Path(module.__file__ or "").read_text("utf-8"))
    (block,) = (
        node
        for node in tree.body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    seen = {
        node.module: {each.asname for each in node.names}
        for node in block.body
        if isinstance(node, ast.ImportFrom)
    }
    assert seen == {
        full_name(package, home): set(names.split()) for home, names in module.PUBLIC.items()
    }


def test_importing_the_packages_loads_no_module_of_their_api() -> None:
    loaded = loaded_by("import " + ", ".join(PACKAGES))
    assert loaded == {
        *PACKAGES,
        "pomona.executive.values",
        *(["pomona.tools"] if is_here("pomona.tools.simulation") else []),
        PUBLIC_NAMES,
        *COMPILING,
    }


def test_a_name_loads_its_own_module_and_no_other() -> None:
    loaded = loaded_by("from pomona.executive import ReadOnly, LENGTH")
    assert loaded == {"pomona.executive", "pomona.executive.values", PUBLIC_NAMES} | {
        f"pomona.executive.values.{each}" for each in ("read_only", "units")
    }


def test_a_name_that_is_not_public_is_refused_with_the_package() -> None:
    with pytest.raises(ImportError, match="cannot import name 'Wristwatch'"):
        from pomona.drivers import Wristwatch  # noqa: F401


def loaded_by(statement: str) -> set[str]:
    """Modules of Pomona that a process has after one statement."""
    script = f"import json, sys; {statement}; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    return {name for name in json.loads(done.stdout) if name.startswith("pomona.")}


def public(module: ModuleType) -> list[str]:
    return sorted(name for names in module.PUBLIC.values() for name in names.split())


def api() -> Iterator[str]:
    """Yield a line for each public name: constants with their type, functions and classes with their signatures."""
    for package in STABLE:
        module = import_module(package)
        for name in public(module):
            for line in described(f"{package}.{name}", getattr(module, name)):
                yield re.sub(r" at 0x[0-9a-f]+>", ">", line)  # of functions and objects as defaults
    for package in PROVISIONAL:
        yield f"{package}, provisional: {', '.join(public(import_module(package)))}"
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]
    for group in GROUPS:
        for name, place in sorted(scripts.get(group, {}).items()):
            room = ".".join(place.partition(":")[0].split(".")[:3])
            yield f"entry point {group} {name} of {room}"


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
