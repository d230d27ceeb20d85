"""Public names of a package, loaded on first use: importing the package costs nothing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module


def on_first_use(
    package: str, public: Mapping[str, str]
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return a package's `__getattr__` and `__dir__`; `public` has the names of each module, separated by blanks.

    A module of the package is given without the package's name, a module of another package with its full name.

    Assign them where type checkers do not look: these see the package's imports under TYPE_CHECKING, and so refuse a
    name that is not public.
    """
    homes = {name: module for module, names in public.items() for name in names.split()}
    own = vars(sys.modules[package])

    def load(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        own[name] = found = getattr(import_module(full_name(package, homes[name])), name)
        return found

    return load, lambda: sorted({*own, *homes})


def full_name(package: str, home: str) -> str:
    """Return the full name of a module that `public` gives."""
    return home if home.startswith("pomona.") else f"{package}.{home}"
