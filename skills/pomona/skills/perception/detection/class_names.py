"""The class of a fruit among the named classes of a data set or a model."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping


class ClassUnknown(ValueError):
    """No class, or several, could be the fruit; the text lists the classes."""


def class_of(names: Mapping[int, str], fruit: str) -> int:
    """Return the number of the fruit's class: the one of its name, else the only one whose name has it as a word.

    "red_apples" has the word apple; "pineapple" has not. Raises ClassUnknown: there is none, or several.
    """
    wanted = _words(fruit)
    by_falling_likeness: tuple[Callable[[str], bool], ...] = (
        lambda name: name.strip() == fruit,
        lambda name: name.strip().casefold() == fruit.casefold(),
        lambda name: _words(name) == wanted,
        lambda name: _has(_words(name), wanted),
    )
    right: list[int] = []
    for like in by_falling_likeness:
        right = right or [number for number, name in names.items() if like(name)]
    if len(right) != 1:
        none = "none of them is" if not right else f"{len(right)} of them could be"
        listed = ", ".join(list(names.values())[:8]) + (", …" if len(names) > 8 else "")
        raise ClassUnknown(f"has the classes {listed}: {none} {fruit}")
    return right[0]


def _words(name: str) -> list[str]:
    """Return the words of a name in small letters and in the singular: "RedApples_2" is red, apple, 2."""
    parts = re.findall(r"[^\W\d_]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name))
    return [_singular(part.casefold()) for part in parts]


def _singular(word: str) -> str:
    for plural, singular in (("ies", "y"), ("oes", "o"), ("ches", "ch"), ("s", "")):
        if word.endswith(plural) and len(word) > len(plural) + 2 and not word.endswith("ss"):
            return word.removesuffix(plural) + singular
    return word


def _has(words: list[str], wanted: list[str]) -> bool:
    """Return True if the wanted words stand in a name one after the other."""
    return any(words[at : at + len(wanted)] == wanted for at in range(len(words) - len(wanted) + 1)) and bool(wanted)
