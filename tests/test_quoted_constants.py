"""Constants that the documentation quotes are the code's: the number before `<!-- module.NAME -->` is its value."""

from __future__ import annotations

import dataclasses
import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
QUOTED = re.compile(r"(\d+(?:\.\d+)?) ?([A-Za-z]*)`?<!-- (pomona\.[\w.]*)\.(\w+) -->")
UNITS = {
    "": 1.0,
    "s": 1.0,
    "ms": 1e-3,
    "mm": 1e-3,
    "kB": 1024.0,
    "MB": 1e6,
    "bytes": 1.0,
    "viewers": 1.0,
}
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "executive" / "pomona" / "tools").rglob("*.md")),
]


def value_of(place: str, name: str) -> float:
    """A module's constant, or the default of a field of a class in it."""
    try:
        where = import_module(place)
    except ModuleNotFoundError:
        module, _, owner = place.rpartition(".")
        defaults = {
            each.name: each.default
            for each in dataclasses.fields(getattr(import_module(module), owner))
        }
        return float(defaults[name])  # type: ignore[arg-type]
    return float(getattr(where, name))


QUOTES = [
    pytest.param(found, id=f"{page.stem}-{found[4]}")
    for page in PAGES
    for found in QUOTED.finditer(page.read_text("utf-8"))
]


@pytest.mark.parametrize("found", QUOTES)
def test_a_quoted_constant_is_the_codes(found: re.Match[str]) -> None:
    assert float(found[1]) * UNITS[found[2]] == pytest.approx(value_of(found[3], found[4]))


def test_every_mark_is_understood() -> None:
    assert len(QUOTES) == sum(page.read_text("utf-8").count("<!-- ") for page in PAGES) > 15
