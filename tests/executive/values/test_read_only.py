import pickle
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from pomona.drivers.interfaces import ArmLimits
from pomona.executive.values.arrays import Float64
from pomona.executive.values.read_only import LARGE, ReadOnly, read_only


@dataclass(frozen=True, slots=True, eq=False)
class Shelf(ReadOnly):
    heights: Float64
    poses: Mapping[str, Float64] = field(default_factory=dict)
    names: tuple[str, ...] = ()


def shelf() -> Shelf:
    return Shelf(np.arange(3.0), {"home": np.zeros(2)}, ["a"])  # type: ignore[arg-type]


@given(arrays(np.float64, array_shapes(min_dims=0, min_side=0)), st.booleans())
def test_an_array_keeps_its_content_and_refuses_writes_also_through_views_and_flags(
    array: Float64, fold: bool
) -> None:
    kept = read_only(array.T if fold else array)
    np.testing.assert_array_equal(kept, array.T if fold else array)
    assert kept.dtype == array.dtype
    assert kept.flags.c_contiguous
    assert kept.flags.aligned
    for view in (kept, kept[...], kept.view(), kept.reshape(-1), np.asarray(kept)):
        assert not view.flags.writeable
        with pytest.raises(ValueError, match="WRITEABLE"):
            view.setflags(write=True)
    assert read_only(kept) is kept


def test_a_change_of_the_array_that_was_given_does_not_show() -> None:
    given_array = np.zeros(3)
    facts = Shelf(given_array)
    given_array[0] = 7.0
    assert facts.heights[0] == 0.0


def test_a_large_array_is_marked_without_a_copy() -> None:
    image = np.zeros(LARGE // 8 + 1)
    assert read_only(image) is image
    with pytest.raises(ValueError, match="read-only"):
        image[0] = 1.0


def test_containers_within_each_other_cannot_be_changed() -> None:
    kept = read_only({"a": [np.zeros(2), {1}], "b": ({"c": [3]},)})
    assert kept["a"][1] == frozenset({1})
    assert kept["b"][0]["c"] == (3,)
    with pytest.raises(TypeError):
        kept["a"] = ()
    with pytest.raises(TypeError):
        kept["b"][0]["c"] = ()
    with pytest.raises(ValueError, match="read-only"):
        kept["a"][0][0] = 1.0


def test_a_large_array_is_read_only_in_another_process() -> None:
    """Above 1 000 bytes, pickle gives arrays that are writable views of a text of bytes."""
    there = pickle.loads(pickle.dumps(Shelf(np.zeros(500))))
    with pytest.raises(ValueError, match="read-only"):
        there.heights[0] = 1.0


@pytest.mark.parametrize(
    "copied",
    [lambda facts: pickle.loads(pickle.dumps(facts)), deepcopy, replace],
    ids=["pickle", "deepcopy", "replace"],
)
def test_every_copy_of_facts_is_read_only_and_equal(copied) -> None:  # type: ignore[no-untyped-def]
    facts = copied(shelf())
    assert facts.names == ("a",)
    assert facts.poses.keys() == {"home"}
    np.testing.assert_array_equal(facts.heights, [0.0, 1.0, 2.0])
    for array in (facts.heights, facts.poses["home"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(TypeError):
        facts.poses["home"] = np.ones(2)


def test_facts_of_an_arm_arrive_in_another_process() -> None:
    """They are made anew there, keyword-only fields, too."""
    here = replace(ArmLimits(*np.ones((5, 7))), reaction=0.07)
    there = pickle.loads(pickle.dumps(here))
    assert there.reaction == 0.07
    np.testing.assert_array_equal(there.jerk, here.jerk)
