"""Failure codes of the language and of the installed skills: meaning and remedy of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import yaml

from pomona.executive.values.plain_text import read_plain_text
from pomona.executive.values.shipped import installed_trees


@dataclass(frozen=True, slots=True)
class FailureCode:
    """One code; meaning and remedy are sentences without a capital and a full stop."""

    code: str
    meaning: str
    remedy: str


@cache
def failure_codes() -> Mapping[str, FailureCode]:
    """Return the codes that are described, by name, in the order of the file (trees/failures)."""
    found = yaml.safe_load(read_plain_text(installed_trees() / "failures" / "codes.yaml"))["failures"]
    return {code: FailureCode(code, about["meaning"], about["remedy"]) for code, about in found.items()}
