import itertools

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.devices.emulators.suntouch import encode
from pomona.devices.suntouch.codec import REQUEST, SIZE, Assembler, decode
from pomona.executive.cell.owner import Malformed

volts = st.lists(st.floats(0.01, 3.29), min_size=25, max_size=25).map(np.array)


def test_a_voltage_is_twelve_bits_of_3_3_volts_and_the_upper_bits_mean_nothing() -> None:
    answer = bytes([0x34, 0xF2] * 25)
    assert decode(answer).volts == pytest.approx(np.full(25, (0x34 + 2 * 256) * 3.3 / 4096))
    assert REQUEST == b"\x61"


@given(volts)
def test_voltages_survive_the_wire_to_half_a_count(sent: np.ndarray) -> None:
    assert np.abs(decode(encode(sent)).volts - sent).max() <= 0.5 * 3.3 / 4096 + 1e-12


def test_a_taxel_at_the_end_of_its_range_is_saturated() -> None:
    middle = np.full(25, 1.5)
    assert not decode(encode(middle)).saturated
    for end in (0.0, 3.3):
        middle[7] = end
        assert decode(encode(middle)).saturated


@given(volts, st.lists(st.integers(1, 49), max_size=6))
def test_an_answer_is_put_together_however_it_is_cut(sent: np.ndarray, cuts: list[int]) -> None:
    answer, assembler = encode(sent), Assembler()
    assembler.expect()
    edges = [0, *sorted(set(cuts)), SIZE]
    readings = [assembler.decode(answer[a:b]) for a, b in itertools.pairwise(edges)]
    assert all(reading is None for reading in readings[:-1])
    assert readings[-1] is not None
    assert np.array_equal(readings[-1].volts, decode(answer).volts)
    assert assembler.damaged == 0


@given(volts, st.integers(1, 49))
def test_a_short_answer_does_not_shift_the_next(sent: np.ndarray, kept: int) -> None:
    assembler = Assembler()
    assembler.expect()
    assert assembler.decode(encode(sent)[:kept]) is None
    assembler.expect()
    reading = assembler.decode(encode(sent))
    assert reading is not None
    assert np.array_equal(reading.volts, decode(encode(sent)).volts)
    assert assembler.damaged == 1


def test_more_bytes_than_asked_for_are_malformed_and_shown() -> None:
    assembler = Assembler()
    assembler.expect()
    with pytest.raises(Malformed, match="more bytes") as caught:
        assembler.decode(bytes(51))
    assert len(caught.value.received) == 51
    with pytest.raises(Malformed):
        assembler.decode(b"unasked")
    with pytest.raises(Malformed, match="50 bytes, not 3"):
        decode(b"abc")
