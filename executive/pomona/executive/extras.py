"""Packages that are installed only for who asks for them: `pip install 'pomona[NAME]'`."""

from __future__ import annotations

import importlib
from typing import Any

from pomona.executive.errors import UsageError


def need(module: str, extra: str, what: str) -> Any:
    """Import what an extra brings.

    Args:
        module: to import.
        extra: that installs it.
        what: needs it, for people.

    Raises:
        UsageError: it is not installed; says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        said = f"{what} needs the extra '{extra}': pip install 'pomona[{extra}]'"
        raise UsageError(f"{said} ({error})") from error
