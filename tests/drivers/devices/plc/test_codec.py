"""Modbus frames and the places of signals: what is written is read, and any other bytes are refused."""

from __future__ import annotations

import contextlib
import math

import pytest
from hypothesis import given, strategies as st

from pomona.devices.plc.codec import (
    MemorySpan,
    frame,
    packed_bits,
    read_answer,
    read_request,
    take_frame,
    unpacked_bits,
    write_request,
    written,
)
from pomona.devices.plc.places import NUMBERS, SignalPlace, image, spans_of
from pomona.drivers import Malformed


def test_the_frames_are_those_of_the_specification() -> None:
    # Modbus application protocol 1.1b3, 6.1, 6.3, 6.11 and 6.12: the examples of the functions 1, 3, 15 and 16
    assert read_request(MemorySpan("coil", 0x13, 0x13)) == bytes.fromhex("01 00 13 00 13")
    assert read_answer(MemorySpan("coil", 0x13, 0x13), bytes.fromhex("01 03 CD 6B 05"))[:8] == (
        1,
        0,
        1,
        1,
        0,
        0,
        1,
        1,
    )
    assert read_answer(
        MemorySpan("holding", 0x6B, 3), bytes.fromhex("03 06 02 2B 00 00 00 64")
    ) == (555, 0, 100)
    bits = (1, 0, 1, 1, 0, 0, 1, 1, 1, 0)
    assert write_request("coil", 0x13, bits) == bytes.fromhex("0F 00 13 00 0A 02 CD 01")
    assert write_request("holding", 1, (0x0A, 0x0102)) == bytes.fromhex(
        "10 00 01 00 02 04 00 0A 01 02"
    )
    written(write_request("holding", 1, (0x0A, 0x0102)), bytes.fromhex("10 00 01 00 02"))
    assert frame(0x1501, 0xFF, b"\x01\x00\x04\x00\x01") == bytes.fromhex(
        "15 01 00 00 00 06 FF 01 00 04 00 01"
    )


@given(st.lists(st.integers(0, 1), min_size=1, max_size=2000))
def test_bits_come_back(bits: list[int]) -> None:
    assert list(unpacked_bits(packed_bits(bits), len(bits))) == bits


@given(st.integers(0, 65535), st.integers(0, 255), st.binary(min_size=1, max_size=253), st.data())
def test_a_frame_is_taken_only_when_it_is_whole(
    transaction: int, unit: int, message: bytes, data: st.DataObject
) -> None:
    whole = frame(transaction, unit, message)
    cut = data.draw(st.integers(0, len(whole) - 1))
    buffer = bytearray(whole[:cut])
    assert take_frame(buffer) is None
    buffer += whole[cut:] + b"rest"
    assert take_frame(buffer) == (transaction, unit, message)
    assert buffer == b"rest"


@given(st.binary(max_size=300))
def test_any_bytes_are_a_frame_or_refused(chunk: bytes) -> None:
    buffer = bytearray(chunk)
    with contextlib.suppress(Malformed):
        while (taken := take_frame(buffer)) is not None:
            assert chunk.startswith(frame(*taken)) or chunk.endswith(frame(*taken) + buffer)


@given(st.binary(max_size=20), st.integers(1, 9))
def test_an_answer_of_another_size_is_refused(answer: bytes, count: int) -> None:
    if answer[:2] != bytes([3, 2 * count]) or len(answer) != 2 + 2 * count:
        with pytest.raises(Malformed):
            read_answer(MemorySpan("holding", 0, count), answer)


@given(
    st.sampled_from(sorted(NUMBERS)),
    st.booleans(),
    st.sampled_from([1.0, 0.1, 0.001]),
    st.floats(-1e9, 1e9),
)
def test_a_number_comes_back_or_does_not_fit(
    kind: str, low_first: bool, scale: float, number: float
) -> None:
    place = SignalPlace("holding 3", kind, scale, low_first)
    try:
        words = place.encode(number)
    except ValueError:
        assert not -32768 <= number / scale <= 32767 or (kind.startswith("u") and number < 0)
        return
    assert len(words) == place.span.count
    error = abs(number) * 1e-6 if kind == "float32" else 0.5 * scale
    assert math.isclose(place.decode(words), number, abs_tol=error + 1e-9, rel_tol=1e-6)


def test_a_number_of_two_registers_has_its_high_word_first_unless_the_cell_file_has_it_otherwise() -> (
    None
):
    assert SignalPlace("holding 0", "uint32").encode(0x00010002) == (1, 2)
    assert SignalPlace("holding 0", "uint32", low_word_first=True).encode(0x00010002) == (2, 1)


@given(
    st.sets(
        st.tuples(st.sampled_from(["coil", "discrete", "holding", "input"]), st.integers(0, 40)),
        min_size=1,
    )
)
def test_spans_cover_the_signals_and_nothing_else(places: set[tuple[str, int]]) -> None:
    spans = spans_of(SignalPlace(f"{area} {first}") for area, first in places)
    covered = [(span.area, span.first + i) for span in spans for i in range(span.count)]
    assert sorted(covered) == sorted(places)


def test_long_spans_are_cut_to_the_length_of_a_request() -> None:
    spans = spans_of(SignalPlace(f"input {i}") for i in range(300))
    assert sum(span.count for span in spans) == 300
    assert max(span.count for span in spans) <= 125


def test_a_switch_takes_no_number() -> None:
    with pytest.raises(ValueError, match="no value of a switch"):
        SignalPlace("coil 0").encode(2.0)
    assert image({"a": SignalPlace("coil 3")}, {"a": True}) == {("coil", 3): 1}
