"""The record's compiled encoder writes what the standard one writes."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from executive.encode import encoded, plain


@dataclass(frozen=True)
class Sample:
    name: str
    value: object


ARRAYS = st.sampled_from(["f8", "f4", "f2", "i8", "i4", "i2", "u1", "?"]).flatmap(
    lambda kind: hnp.arrays(kind, hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
)
LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | ARRAYS
VALUES = st.recursive(LEAVES, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=8)


@given(VALUES)
def test_both_encoders_write_the_same(value):
    event = Sample("s", value)
    assert json.loads(encoded(plain(event, keep=True))) == json.loads(json.dumps(plain(event)))


@pytest.mark.parametrize("array", [np.arange(6.0).reshape(2, 3).T, np.arange(10)[::2], np.zeros((2, 0)), np.array(2.5)])
def test_any_layout_of_an_array_is_written(array):
    assert json.loads(encoded(plain({"a": array}, keep=True))) == {"a": array.tolist()}
    assert json.loads(encoded({"a": array})) == {"a": array.tolist()}
