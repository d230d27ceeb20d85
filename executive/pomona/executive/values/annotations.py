"""Annotations of types, read at run time."""

from __future__ import annotations

from typing import Any, get_args, get_origin


def without_alias(annotation: Any) -> Any:
    """Return the type behind a name that a `type` statement made, such as numpy's NDArray from 2.5 on.

    `NDArray[np.float64]` becomes `np.ndarray[…, np.dtype[np.float64]]`; every other annotation is returned as it is.
    """
    value = getattr(get_origin(annotation) or annotation, "__value__", None)
    if value is None:
        return annotation
    arguments = get_args(annotation)
    return without_alias(value[arguments] if arguments else value)
