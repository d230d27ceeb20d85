"""Public objects document their purpose, their arrays' shapes and their errors; overrides may inherit this."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("executive", "skills", "drivers")
SAID_BY_PY_TREES = {"tick", "update", "initialise", "terminate", "setup"}


@dataclass
class Class:
    """A class from its text: place, bases by name, and its documented methods."""

    place: str
    package: str
    bases: tuple[str, ...]
    documented: bool
    methods: dict[str, tuple[bool, str]] = field(default_factory=dict)


def read_all() -> tuple[dict[str, list[Class]], list[str]]:
    """All top-level classes by name, and the public functions without a docstring."""
    classes: dict[str, list[Class]] = defaultdict(list)
    silent = []
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            where = path.relative_to(ROOT)
            if "templates" in where.parts:
                continue  # a package that users make their own
            for node in ast.parse(path.read_text("utf-8")).body:
                if isinstance(node, ast.ClassDef):
                    classes[node.name].append(read_class(node, str(where), package))
                elif (
                    isinstance(node, ast.FunctionDef)
                    and is_public(node.name)
                    and not ast.get_docstring(node)
                ):
                    silent.append(f"{where}:{node.lineno} {node.name}")
    return classes, silent


def read_class(node: ast.ClassDef, where: str, package: str) -> Class:
    bases = tuple(ast.unparse(base).split("[")[0].split(".")[-1] for base in node.bases)
    found = Class(f"{where}:{node.lineno}", package, bases, ast.get_docstring(node) is not None)
    for member in node.body:
        if isinstance(member, ast.FunctionDef):
            said = (
                ast.get_docstring(member) is not None
                or found.methods.get(member.name, (False, ""))[0]
            )
            found.methods[member.name] = said, f"{where}:{member.lineno}"
    return found


def is_public(name: str) -> bool:
    return not name.startswith("_")


def inherited(classes: dict[str, list[Class]], found: Class, method: str) -> bool:
    """Return True if a base class documents the method."""
    for base in found.bases:
        for above in classes.get(base, ()):
            if above.methods.get(method, (False, ""))[0] or inherited(classes, above, method):
                return True
    return False


def silent_members(classes: dict[str, list[Class]]) -> Iterator[str]:
    protocols = {
        method
        for found in (each for same in classes.values() for each in same)
        if "Protocol" in found.bases
        for method, (said, _) in found.methods.items()
        if said
    }
    for name, same in classes.items():
        for found in same:
            if not is_public(name):
                continue
            if not found.documented:
                yield f"{found.place} {name}"
            for method, (said, place) in found.methods.items():
                is_skill = method == "run" and (
                    found.package == "skills" or any("Skill" in base for base in found.bases)
                )
                elsewhere = (
                    method in protocols or method in SAID_BY_PY_TREES or is_skill
                )  # a skill's class says it
                if (
                    is_public(method)
                    and not said
                    and not elsewhere
                    and not inherited(classes, found, method)
                ):
                    yield f"{place} {name}.{method}"


def test_everything_public_is_documented() -> None:
    classes, silent = read_all()
    assert len(classes) > 300, "the packages were not found"
    assert [*silent, *silent_members(classes)] == []


ARRAYS = re.compile(r"\b(Float64|Float32|Int64|Int32|UInt8|NDArray|DepthImage)\b")
SHAPE = re.compile(r"\((\d+|[a-z.]+\w*( \w+)?),|\bshape|\d x \d")
"""`(3,)`, `(n, 4)`, `(h, w, 3)`, or in words."""


def test_docstrings_state_the_shape_of_returned_arrays() -> None:
    said, unsaid = 0, []
    for path in (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))):
        body = ast.parse(path.read_text("utf-8")).body
        classes = [node for node in body if isinstance(node, ast.ClassDef) and is_public(node.name)]
        for node in (*body, *(member for found in classes for member in found.body)):
            if (
                isinstance(node, ast.FunctionDef)
                and is_public(node.name)
                and node.returns is not None
            ):
                text = ast.get_docstring(node)
                if text is not None and ARRAYS.search(
                    ast.unparse(node.returns)
                ):  # else what it overrides says it
                    said += 1
                    if not SHAPE.search(text):
                        unsaid.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}")
    assert said > 150, "the functions were not found"
    assert unsaid == []


def raised(function: ast.FunctionDef) -> set[str]:
    """Classes of the errors that a function's own lines raise."""

    def below(node: ast.AST) -> Iterator[ast.AST]:
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, (ast.FunctionDef, ast.Lambda, ast.ClassDef)):
                yield child
                yield from below(child)

    calls = [
        node.exc
        for node in below(function)
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
    ]
    names = {ast.unparse(call.func).split(".")[-1] for call in calls}
    # A method that makes an error says which; a claim raises `Finding`, as its module says.
    return {name for name in names if name[:1].isupper() and name != "Finding"}


def test_docstrings_name_raised_errors() -> None:
    said, unsaid = 0, []
    for path in (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))):
        if path.parent.name == "commands" or path.name.startswith(
            "command_"
        ):  # all of them end with a sentence and 2: `pomona.executive.cli`
            continue
        body = ast.parse(path.read_text("utf-8")).body
        classes = [node for node in body if isinstance(node, ast.ClassDef) and is_public(node.name)]
        for node in (*body, *(member for found in classes for member in found.body)):
            if isinstance(node, ast.FunctionDef) and is_public(node.name):
                text = ast.get_docstring(node)
                if text is not None and (
                    errors := raised(node)
                ):  # without one, what it overrides says it
                    said += 1
                    if "Raises:" not in text and not all(error in text for error in errors):
                        unsaid.append(
                            f"{path.relative_to(ROOT)}:{node.lineno} {node.name}: {', '.join(errors)}"
                        )
    assert said > 150, "the functions were not found"
    assert unsaid == []


def test_each_model_card_states_the_licence_of_its_weights() -> None:
    weights = {path.name for path in (ROOT / "skills").rglob("weights/*.weights")}
    cards = {path: path.read_text("utf-8") for path in (ROOT / "docs" / "model_cards").glob("*.md")}
    stated = [text.partition("\n## Licence\n")[2] for text in cards.values()]
    assert all("MIT" in text for text in stated), [path.name for path in cards]
    assert {name for name in weights if not any(name in text for text in cards.values())} == set()
