"""`--set key=value`: parameters of the tree first, options of the cell for what the tree does not declare."""

from __future__ import annotations

from collections.abc import Sequence

from executive.errors import UsageError
from executive.tree_file import Document


def split_settings(given: Sequence[str], document: Document) -> tuple[dict[str, str], dict[str, str]]:
    """Sort `key=value` texts into the tree's parameters and the cell's options.

    Raises:
        UsageError: a text without '='.
    """
    tree: dict[str, str] = {}
    cell: dict[str, str] = {}
    declared = set(document.parameter_names)
    for text in given:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise UsageError(f"--set {text}: write key=value")
        (tree if key.strip() in declared else cell)[key.strip()] = value.strip()
    return tree, cell
