"""The record's compiled encoder writes the same as the standard one."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp

from pomona.executive.encode import encoded, plain
from pomona.executive.reasons import DEEPEST_CAUSE, MOST_CAUSES, Reason
from pomona.executive.recording.typed import reason_from


@dataclass(frozen=True)
class Sample:
    name: str
    value: object


ARRAYS = st.sampled_from(["f8", "f4", "f2", "i8", "i4", "i2", "u1", "?"]).flatmap(
    lambda kind: hnp.arrays(kind, hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
)
LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | ARRAYS
VALUES = st.recursive(
    LEAVES, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=8
)


@given(VALUES)
def test_both_encoders_write_the_same(value):
    event = Sample("s", value)
    assert json.loads(encoded(plain(event, keep=True))) == json.loads(json.dumps(plain(event)))


@pytest.mark.parametrize(
    "array", [np.arange(6.0).reshape(2, 3).T, np.arange(10)[::2], np.zeros((2, 0)), np.array(2.5)]
)
def test_any_layout_of_an_array_is_written(array):
    assert json.loads(encoded(plain({"a": array}, keep=True))) == {"a": array.tolist()}
    assert json.loads(encoded({"a": array})) == {"a": array.tolist()}


def chain(depth: int) -> Reason:
    """A leaf's reason as it comes up through so many nodes."""
    reason = Reason("leaf", "GONE", "it is gone", {"at": [1.0, {"x": 2.0}]})
    for number in range(depth):
        reason = Reason(
            f"n{number}", "GONE", "it is gone", {"attempts": 1}, (Reason("a", "NO", "no"), reason)
        )
    return reason


@pytest.mark.parametrize("depth", [0, 1, 7, 40, DEEPEST_CAUSE - 1])
def test_a_reason_keeps_its_causes_however_deep_the_tree_is(depth):
    written = json.loads(encoded({"reason": plain(chain(depth), keep=True)}))["reason"]
    assert reason_from(written) == chain(depth)
    assert json.loads(encoded(plain(Sample("s", [chain(depth)]))))["value"] == [written]


@pytest.mark.parametrize("reason", [
    chain(400),
    Reason("many", "GONE", "it is gone", causes=(*[Reason("a", "NO", "no")] * (3 * MOST_CAUSES), chain(3))),
    Reason("wide", "GONE", "it is gone", causes=(chain(60),) * 1000),
])  # fmt: skip
def test_unread_text_is_left_out_of_a_reason_but_never_its_cause(reason):
    found = reason_from(json.loads(encoded(plain(reason))))
    assert found.code == reason.code
    assert list(found.leaves())[-1] == Reason(
        "leaf", "GONE", "it is gone", {"at": [1.0, {"x": 2.0}]}
    )
