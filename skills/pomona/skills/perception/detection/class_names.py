"""The class of a fruit among the named classes of a data set or a model."""

from __future__ import annotations

from collections.abc import Mapping


class ClassUnknown(ValueError):
    """No class, or several, could be the fruit; the text lists the classes."""


def class_of(names: Mapping[int, str], fruit: str) -> int:
    """Return the number of the only class whose name contains the fruit's. Raises ClassUnknown: none or several."""
    right = [number for number, name in names.items() if fruit.lower() in name.lower()]
    if len(right) != 1:
        none = "none of them is" if not right else f"{len(right)} of them could be"
        listed = ", ".join(list(names.values())[:8]) + (", …" if len(names) > 8 else "")
        raise ClassUnknown(f"has the classes {listed}: {none} {fruit}")
    return right[0]
