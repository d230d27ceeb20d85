"""A name that stands for a type is replaced by the type."""

from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from pomona.executive.language.value_types import from_annotation, is_array
from pomona.executive.ports import without_alias

T = TypeVar("T", bound=np.generic)
Heights = TypeAliasType("Heights", np.ndarray[Any, np.dtype[np.float64]])
Named = TypeAliasType(
    "Named", np.ndarray[Any, np.dtype[T]], type_params=(T,)
)  # NDArray of numpy 2.5
Twice = TypeAliasType("Twice", Heights)


@pytest.mark.parametrize("annotation", [Heights, Named[np.float64], Twice])
def test_a_name_of_a_type_is_the_type(annotation: Any) -> None:
    assert without_alias(annotation) == np.ndarray[Any, np.dtype[np.float64]]
    assert is_array(from_annotation(annotation))


@pytest.mark.parametrize("annotation", [NDArray[np.float64], Named[np.float64] | None])
def test_an_array_is_one_by_each_of_its_names(annotation: Any) -> None:
    assert is_array(from_annotation(annotation))


@pytest.mark.parametrize(
    "annotation", [int, list[int], int | None, Any, None, "Heights", tuple[int, ...]]
)
def test_other_annotations_stay(annotation: Any) -> None:
    assert without_alias(annotation) is annotation
