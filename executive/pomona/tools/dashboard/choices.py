"""The trees and cells that the page may start, and their settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.executive.cell.cell_file import outline_cell
from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.files import default_name, find_cell, find_tree, read_text
from pomona.executive.language import read
from pomona.executive.language.model import Declared
from pomona.executive.values.findings import Findings, format_findings
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar, written

StartRun = Callable[
    [dict[str, Any]], str
]  # starts a run from the page's form and returns its tree's name

JudgeForm = Callable[[dict[str, Any]], dict[str, str]]
"""Returns the unusable settings of the page's form with the reasons, by their names."""


@dataclass(frozen=True, slots=True)
class Choices:
    """Files by the name under which the page offers them; nothing else can be started."""

    trees: Mapping[str, Path]
    cells: Mapping[str, Path]

    @classmethod
    def installed(cls, trees: Sequence[str] = (), cells: Sequence[str] = ()) -> Choices:
        """Everything that comes with the package, and files that are given.

        Raises UsageError: a given file is not there.
        """
        folder = installed_trees()
        return cls(
            {path.stem: path for path in [*sorted(folder.glob("*.yaml")), *map(find_tree, trees)]},
            {
                path.stem: path
                for path in [*sorted((folder / "cells").glob("*.yaml")), *map(find_cell, cells)]
            },
        )

    def tree(self, name: object) -> Path:
        """Return the file of an offered tree. Raises UsageError: it is not offered."""
        return _offered(self.trees, name, "tree")

    def cell(self, name: object) -> Path:
        """Return the file of an offered cell. Raises UsageError: it is not offered."""
        return _offered(self.cells, name, "cell")

    def describe(self) -> dict[str, Any]:
        """For the page's form: parameters of each tree, options of each cell, and what it offers first."""
        return {
            "trees": [
                {"name": name, **_describe(_tree_facts, path)} for name, path in self.trees.items()
            ],
            "cells": [
                {"name": name, **_describe(cell_facts, path)} for name, path in self.cells.items()
            ],
            "first": default_name("tree"),
        }


def _offered(files: Mapping[str, Path], name: object, kind: str) -> Path:
    if not isinstance(name, str) or name not in files:
        raise UsageError(
            f"this dashboard offers no such {kind}; it offers {', '.join(files) or 'none'}"
        )
    return files[name]


def _describe(facts: Any, path: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = facts(path)
    except PomonaError as error:
        return {"problem": str(error)}
    return found


def _tree_facts(path: Path) -> dict[str, Any]:
    main = read(read_text(path), path, tree_folders=[installed_trees()]).main
    return {
        "description": main.description,
        "cell": main.cell.text if main.cell else default_name("cell"),
        "parameters": [
            declared_facts(name, declared) for name, declared in main.parameters.items()
        ],
    }


def declared_facts(name: str, declared: Declared) -> dict[str, Any]:
    """Return a declared parameter, input or output as plain values for a page."""
    return {
        "name": name,
        "type": declared.type.text if declared.type is not None else "",
        "default": "" if declared.default is None else written(declared.default),
        "min": _text(declared.min),
        "max": _text(declared.max),
        "choices": [choice.text for choice in declared.choices],
        "help": declared.help,
    }


def _text(node: YamlNode | None) -> str:
    return node.text if isinstance(node, YamlScalar) else ""


def cell_facts(path: Path) -> dict[str, Any]:
    """Return `kind` and `options` of a cell file. Raises UsageError: it is none."""
    findings = Findings()
    outline = outline_cell(path, findings)
    if outline is None:
        raise UsageError(format_findings(findings.sorted()) or f"{path}: not a cell file")
    options = [
        {"name": option.name, "default": option.default, "help": option.help}
        for option in outline.options
    ]
    return {"kind": outline.kind, "options": options}
