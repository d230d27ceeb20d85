"""A public class's name means one thing in the whole repository; the exceptions are listed with their reason."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

SEEN_FROM_BOTH_SIDES = {"ConnectContext"}
"""The executive's class, and the drivers' with the memory of a hand: one object on both sides of a wall."""

WITH_THEIR_MODULE = {"Condition", "Ports", "Words"}
"""Values of words of the tree language: always written with their module, `takes.Condition`."""

SKILL_AND_VALUE = {"Grasp"}
"""A skill that no module but the registry imports, and the value of the ports of that name."""

ALONE = {"emulators", "laboratory_emulators", "conformance"}
"""They import nothing of what they judge, so their words are their own."""


def test_a_public_class_has_a_name_of_its_own() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for package in ("executive", "skills", "drivers", "benchmarks"):
        for path in sorted((ROOT / package).rglob("*.py")):
            if ALONE & set(path.parts):
                continue
            text = path.read_text("utf-8")
            for node in ast.parse(text).body if "class " in text else ():
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    places[node.name].append(str(path.relative_to(ROOT)))
    assert len(places) > 600, "the packages were not found"
    shared = {name: where for name, where in places.items() if len(where) > 1}
    assert shared.keys() == SEEN_FROM_BOTH_SIDES | WITH_THEIR_MODULE | SKILL_AND_VALUE, shared
    for name in SEEN_FROM_BOTH_SIDES:
        assert [where.split("/")[0] for where in shared[name]] == ["executive", "drivers"], shared[
            name
        ]
    for name in WITH_THEIR_MODULE:
        assert "executive/pomona/executive/nodes/takes.py" in shared[name]


def test_kinds_of_values_in_a_tree_file_are_named_with_their_module() -> None:
    for package in ("executive", "skills", "drivers", "benchmarks", "tests"):
        for path in sorted((ROOT / package).rglob("*.py")):
            text = path.read_text("utf-8")
            for node in (
                ast.walk(ast.parse(text)) if "pomona.executive.nodes.takes import" in text else ()
            ):
                if (
                    isinstance(node, ast.ImportFrom)
                    and node.module == "pomona.executive.nodes.takes"
                ):
                    assert not WITH_THEIR_MODULE & {name.name for name in node.names}, path
