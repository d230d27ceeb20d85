"""Packages that an extra brings, and the distribution to which the executive belongs.

`pomona` holds executive, skills and drivers; `pomona-executive` holds the executive alone.
"""

from __future__ import annotations

import importlib
from functools import cache
from importlib.metadata import PackageNotFoundError, metadata, version
from typing import Any

from pomona.executive.errors import UsageError

WHOLE, ALONE = "pomona", "pomona-executive"

_EXTRA_OF = {
    "PIL": "pictures",
    "matplotlib": "pictures",
    "scipy": "pictures",
    "torch": "torch",
    "onnx": "torch",
    "pygls": "lsp",
    "lsprotocol": "lsp",
    "ray": "ray",
}
"""Packages that are imported without `need`."""


@cache
def distribution() -> str:
    """Name of the installed distribution: `pomona`, or `pomona-executive` without it."""
    try:
        version(WHOLE)
    except PackageNotFoundError:
        return ALONE
    return WHOLE


def installed_version() -> str:
    """Version of the installed distribution."""
    return version(distribution())


def need(module: str, extra: str, what: str) -> Any:
    """Import a module that an extra brings.

    Args:
        module: to import.
        extra: that installs it.
        what: needs it, for the message.

    Raises:
        UsageError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise UsageError(f"{what} needs the extra '{extra}': {_install(extra)} ({error})") from error


def remedy(module: str) -> str:
    """Return the command that helps when a module is not found."""
    extra = _EXTRA_OF.get(module.partition(".")[0], "")
    if extra in (metadata(distribution()).get_all("Provides-Extra") or ()):
        return _install(extra)
    return "pomona doctor" if distribution() == WHOLE else f"pip install --force-reinstall {ALONE}"


def _install(extra: str) -> str:
    return f"pip install '{distribution()}[{extra}]'"
