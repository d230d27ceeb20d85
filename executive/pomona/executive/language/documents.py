"""A tree file from the disk and the skills that it may use: the start of every command."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from pomona.executive.errors import UsageError
from pomona.executive.files import read_text
from pomona.executive.language.check import check
from pomona.executive.language.declared_skills import declared_skills
from pomona.executive.language.model import Document
from pomona.executive.language.read import read
from pomona.executive.language.value_types import NotLoadedError
from pomona.executive.registry import Registry
from pomona.executive.values.findings import format_findings
from pomona.executive.values.installation import installed_trees

T = TypeVar("T")


def read_document(path: Path, texts: Mapping[str, str] | None = None) -> Document:
    """Read a tree file, and the files that it calls; those in `texts` are not read from the disk.

    Raises UsageError: it cannot be read at all.
    """
    known = texts or {}
    text = known[str(path)] if str(path) in known else read_text(path)
    return read(text, path, tree_folders=[installed_trees()], texts=known)


def refuse_errors(
    document: Document, registry: Registry, settings: Mapping[str, str], interfaces: tuple[type, ...] | None
) -> None:
    """Check a document. Raises UsageError: with every finding, when one of them is an error."""
    findings = check(document, registry, overrides=settings, interfaces=interfaces)
    if any(finding.severity == "error" for finding in findings):
        raise UsageError(f"{format_findings(findings)} Nothing was run.")


def with_declarations(action: Callable[[Registry], T]) -> T:
    """Do something that needs skills' declarations only, without importing the skills if that can be avoided."""
    try:
        return action(declared_skills())
    except NotLoadedError:
        return action(Registry.installed())
