"""RTDE's bytes: whole messages from any pieces, and a typed error for everything else."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, strategies as st

from pomona.devices.universal_robots.rtde import RtdeKind, RtdeRecipe, decode, encode
from pomona.drivers import Malformed

MESSAGES = st.lists(st.tuples(st.sampled_from(list(RtdeKind)), st.binary(max_size=300)), max_size=6)


@given(MESSAGES, st.lists(st.integers(1, 50), min_size=1, max_size=20))
def test_messages_come_whole_however_the_wire_cuts_them(
    messages: list[tuple[RtdeKind, bytes]], cuts: list[int]
) -> None:
    stream = b"".join(encode(kind, body) for kind, body in messages)
    buffer, found, at, turn = bytearray(), [], 0, 0
    while at < len(stream):
        size = cuts[turn % len(cuts)]
        buffer += stream[at : at + size]
        at, turn = at + size, turn + 1
        found += decode(buffer)
    assert found == messages
    assert not buffer


@given(st.binary(max_size=400))
def test_any_bytes_are_messages_or_malformed(chunk: bytes) -> None:
    buffer = bytearray(chunk)
    with contextlib.suppress(Malformed):
        found = decode(buffer)
        assert b"".join(encode(kind, body) for kind, body in found) + bytes(buffer) == chunk


@given(
    st.floats(allow_nan=False),
    st.integers(-(2**31), 2**31 - 1),
    st.lists(st.floats(allow_nan=False), min_size=6, max_size=6),
)
def test_a_package_has_its_fields_again(number: float, whole: int, six: list[float]) -> None:
    recipe = RtdeRecipe(
        ("speed_scaling", "robot_mode", "actual_q"), ("DOUBLE", "INT32", "VECTOR6D")
    )
    body = recipe.pack(1, [number, whole, *six])
    assert recipe.unpack(body) == {
        "speed_scaling": (number,),
        "robot_mode": (whole,),
        "actual_q": tuple(six),
    }


def test_a_package_of_another_length_is_malformed() -> None:
    recipe = RtdeRecipe(("robot_mode",), ("INT32",))
    with pytest.raises(Malformed, match="no package of 5 bytes"):
        recipe.unpack(b"\x01\x00")
