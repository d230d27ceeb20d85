"""Import of modules that read the environment."""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any


def import_under(module: str, **environment: str) -> Any:
    """Import a module while these variables are set; the environment is then as before."""
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    try:
        return import_module(module)
    finally:
        for name, text in before.items():
            if text is None:
                del os.environ[name]
            else:
                os.environ[name] = text
