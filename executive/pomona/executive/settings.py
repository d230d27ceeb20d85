"""`--set key=value` texts."""

from __future__ import annotations

from collections.abc import Sequence

from pomona.executive.errors import UsageError


def parse_settings(given: Sequence[str]) -> dict[str, str]:
    """`["attempts=20"]` -> `{"attempts": "20"}`; the last one wins. Raises UsageError: a text without '='."""
    settings = {}
    for text in given:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise UsageError(f"--set {text}: write key=value")
        settings[key.strip()] = value.strip()
    return settings
