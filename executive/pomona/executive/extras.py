"""Packages that an extra brings."""

from __future__ import annotations

import importlib
from importlib.metadata import metadata
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.values.installation import WHOLE, distribution, install_extra, reinstall

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


def need(module: str, extra: str, what: str) -> Any:
    """Import a module that an extra brings.

    Args:
        extra: that installs it.
        what: the feature that needs it, for the message.

    Raises UsageError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise UsageError(f"{what} needs the extra '{extra}': {install_extra(extra)} ({error})") from error


def remedy(module: str) -> str:
    """Return the command that helps when a module is not found."""
    extra = _EXTRA_OF.get(module.partition(".")[0], "")
    if extra in (metadata(distribution()).get_all("Provides-Extra") or ()):
        return install_extra(extra)
    return "pomona doctor" if distribution() == WHOLE else reinstall(distribution(), requirements=True)
