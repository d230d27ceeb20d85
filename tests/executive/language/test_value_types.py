"""Types of ports and fields: what flows where, what can be compared, and what a class has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pomona.executive.language.value_types import (
    ANY,
    NONE,
    SI_NUMBER,
    ListType,
    can_flow,
    comparable,
    describe,
    element_type,
    fields_of,
    from_annotation,
    is_numeric,
)
from pomona.executive.ports import LENGTH, RATIO, TIME
from pomona.executive.values.units import PIXELS, Array


class Side(Enum):
    """Two sides."""

    LEFT = 1


class Fruit:
    """A fruit."""


class Apple(Fruit):
    """An apple."""


ARRAY = ListType(LENGTH, 3, array=True)
KINDS: dict[str, Any] = {
    "int": int, "float": float, "bool": bool, "str": str, "length": LENGTH, "time": TIME, "ratio": RATIO,
    "si": SI_NUMBER, "none": NONE, "fruit": Fruit, "apple": Apple, "side": Side, "list": list, "tuple": tuple,
    "lengths": ListType(LENGTH), "ints": ListType(int), "array": ARRAY, "numpy": np.ndarray,
    "sequence": Sequence,
}  # fmt: skip
FLOWS = {
    "float": "ratio", "str": "sequence", "int": "float ratio", "si": "float length time ratio",
        "ratio": "float", "apple": "fruit",
    "lengths": "list tuple sequence array", "ints": "list tuple sequence", "array": "lengths numpy",
    "list": "ints lengths sequence",
    "tuple": "ints lengths sequence", "numpy": "array",
}  # fmt: skip


@pytest.mark.parametrize("source", KINDS)
def test_a_value_flows_into_its_own_type_and_a_wider_one(source: str) -> None:
    flows = {target for target in KINDS if can_flow(KINDS[source], KINDS[target])}
    assert flows == {source, *FLOWS.get(source, "").split()}
    assert can_flow(KINDS[source], ANY)
    assert can_flow(ANY, KINDS[source])
    assert can_flow(KINDS[source], object)


@pytest.mark.parametrize(
    ("left", "right", "can"),
    [
        ("int", "float", True), ("length", "time", False), ("length", "si", True), ("si", "int", True),
        ("si", "str", False),
        ("side", "str", True), ("side", "int", False), ("none", "length", True), ("fruit", "apple", True),
        ("str", "int", False),
        ("bool", "int", False), ("si", "side", False), ("si", "ratio", True),
    ],
)  # fmt: skip
def test_values_are_compared_with_their_like(left: str, right: str, can: bool) -> None:
    assert comparable(KINDS[left], KINDS[right]) is can
    assert comparable(KINDS[right], KINDS[left]) is can


def test_numbers_are_calculated_with_and_containers_have_elements() -> None:
    assert {name for name, kind in KINDS.items() if is_numeric(kind)} == {
        "int", "float", "length", "time", "ratio", "si",
    }  # fmt: skip
    assert is_numeric(ANY)
    elements = {name: element_type(kind) for name, kind in KINDS.items()}
    assert {name: found for name, found in elements.items() if found is not None} == {
        "list": ANY, "tuple": ANY, "numpy": ANY, "lengths": LENGTH, "ints": int, "array": LENGTH,
    }  # fmt: skip
    assert element_type(dict) is ANY
    assert element_type(ANY) is ANY


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (int, "an int"), (LENGTH, "a length"), (NONE, "nothing"), (ANY, "anything"), (ListType(ANY), "a list"),
        (ListType(LENGTH), "a list of length"), (ListType(int), "a list of int"), (ARRAY, "an array of 3 lengths"),
        (ListType(ListType(SI_NUMBER, 4, True), 3, True), "an array of 3 × 4 numbers"),
        (ListType(LENGTH, None, True), "an array of … lengths"),
        (ListType(ListType(PIXELS, 2, True), 9, True), "an array of 9 × 2 number of pixels"),
        (ListType(ListType(int)), "a list of list of int"), (Fruit, "a fruit"),
    ],
)  # fmt: skip
def test_a_type_has_words(kind: Any, words: str) -> None:
    assert describe(kind) == words


@pytest.mark.parametrize(
    ("annotation", "kind"),
    [
        (float, SI_NUMBER), (int, int), (None, NONE), (type(None), NONE), (Any, ANY), (int | None, int),
        (int | str, ANY), (list[int], ListType(int)), (tuple[int, ...], ListType(int)),
        (tuple[int, int], ListType(int, 2)),
        (tuple[int, str], ListType(ANY, 2)), (Sequence[float], ListType(SI_NUMBER)),
        (Annotated[float, LENGTH], LENGTH),
        (Annotated[NDArray[np.float64], Array(3, of=LENGTH)], ListType(LENGTH, 3, True)),
        (Annotated[NDArray[np.float64], Array(2, 4)], ListType(ListType(SI_NUMBER, 4, True), 2, True)),
        (Mapping[str, int], Mapping), (Annotated[float | None, LENGTH], SI_NUMBER), (list, list), (Side, Side),
    ],
)  # fmt: skip
def test_an_annotation_has_a_type(annotation: Any, kind: Any) -> None:
    assert from_annotation(annotation) == kind


@dataclass
class Measured:
    """Has fields and properties, some of its own."""

    width: Annotated[float, LENGTH]
    mass: float
    _hidden: int = 0
    words: list[str] = field(default_factory=list)

    @property
    def half(self) -> Annotated[float, LENGTH]:
        return self.width / 2.0

    @property
    def _own(self) -> int:
        return 1

    @property
    def unknown(self) -> NoSuchType:  # type: ignore[name-defined]  # noqa: F821
        return 1


class Loose:
    """Has an annotation that means nothing here."""

    size: NoSuchType  # type: ignore[name-defined]  # noqa: F821
    mass: float


def test_a_class_has_its_public_fields_and_properties() -> None:
    assert fields_of(Measured) == {
        "width": LENGTH, "mass": SI_NUMBER, "words": ListType(str), "half": LENGTH, "unknown": ANY,
    }  # fmt: skip
    assert fields_of(Loose) == {"size": ANY, "mass": ANY}
    for kind in (int, LENGTH, ListType(int), str, NONE):
        assert fields_of(kind) == {}
    assert fields_of(ANY) is None
    assert fields_of(object) is None
