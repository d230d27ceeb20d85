"""Which leaves scripts/without_leaves.py took out of this checkout, and the words that went with them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

LEAF = r"pomona\.(tools|devices|applications)(?:\.| import )(\w+)"
LEAF_IMPORT = re.compile(rf"^\s*(?:from|import) {LEAF}", re.MULTILINE)


@cache
def leaves() -> frozenset[tuple[str, str]]:
    """Return kind and name of each leaf of this checkout."""
    return frozenset(
        page.parts[-3:-1]  # type: ignore[misc]
        for kind in ("tools", "devices", "applications")
        for page in ROOT.glob(f"*/pomona/{kind}/*/__init__.py")
    )


@cache
def taken_words() -> re.Pattern[str] | None:
    """Return what matches the words of leaves that were taken out; None where all are here.

    Words are the names of their entry points, which scripts/without_leaves.py keeps as comments, and of shipped cells
    and trees that name one of these, or another such file.
    """
    project = (ROOT / "pyproject.toml").read_text("utf-8")
    taken = re.findall(r"^# taken out: ([\w.-]+) =", project, re.MULTILINE)
    if not taken:
        return None
    shipped = {page: page.read_text("utf-8") for page in (ROOT / "trees").rglob("*.yaml")}
    files: set[str] = set()
    while True:
        words = _matcher(taken, files)
        found = {page.stem for page, text in shipped.items() if words.search(text)}
        if found <= files:
            return words
        files |= found


def _matcher(words: Iterable[str], files: Iterable[str]) -> re.Pattern[str]:
    """Return what matches words as they stand in code, commands and files, skills anywhere, and names of files."""
    skills = [name for name in words if name[0].isupper()]
    word, file, skill = (
        "|".join(map(re.escape, sorted(names))) or r"\0" for names in (words, files, skills)
    )
    return re.compile(
        rf"""["'](?:{word}|{file})["']|\bpomona (?:{word})\b|\b(?:{word}): |driver: (?:{word})\b"""
        rf"""|--\w+ (?:{word}|{file})\b|\b(?:{file})\.yaml\b|(?:cell|tree|include|subtree):? (?:{file})\b|\b(?:{skill})\b"""
    )


def is_here(text: str) -> bool:
    """Return False if a text names a module or a file of a leaf that is not in this checkout."""
    named = re.findall(rf"{LEAF}|(tools|devices|applications)/(\w+)/", text)
    return all((kind or folder, leaf or name) in leaves() for kind, leaf, folder, name in named)
