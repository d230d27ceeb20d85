"""Robotiq's frames are those of the instruction manual; anything else is a typed error."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from pomona.devices.robotiq.codec import RobotiqCommand, RobotiqStatus, answer, crc, request
from pomona.drivers import Malformed

BYTE = st.integers(0, 255)


def test_the_check_sum_is_modbus_own() -> None:
    assert crc(bytes.fromhex("09 03 07 D0 00 01")) == bytes.fromhex(
        "85 CF"
    )  # instruction manual, read of one register


def test_a_command_is_written_and_the_status_read_in_one_frame() -> None:
    frame = request(RobotiqCommand(True, True, 255, 128, 10))
    assert frame[:-2] == bytes.fromhex("09 17 07D0 0003 03E8 0003 06 09 00 00 FF 80 0A")
    assert request(None)[:-2] == bytes.fromhex("09 04 07D0 0003")


@given(
    st.integers(0, 3),
    st.integers(0, 3),
    st.integers(0, 15),
    BYTE,
    BYTE,
    st.integers(0, 1),
    st.binary(max_size=20),
)
def test_a_status_has_its_fields_again(
    activation: int, met: int, fault: int, requested: int, position: int, go: int, rest: bytes
) -> None:
    body = bytes(
        [9, 23, 6, activation << 4 | met << 6 | go << 3, 0, fault, requested, position, 255]
    )
    buffer = bytearray(body + crc(body))
    assert answer(bytearray(buffer[:-1])) is None
    assert answer(buffer + rest) == RobotiqStatus(activation, met, fault, requested, position, go)


@given(st.binary(max_size=60))
def test_any_bytes_are_an_answer_nothing_yet_or_malformed(chunk: bytes) -> None:
    try:
        found = answer(bytearray(chunk))
    except Malformed:
        return
    assert found is None or isinstance(found, RobotiqStatus)


def test_a_wrong_check_sum_and_a_refusal_are_malformed() -> None:
    body = bytes([9, 23, 6, 0, 0, 0, 0, 0, 0])
    with pytest.raises(Malformed, match="check sum"):
        answer(bytearray(body + b"\0\0"))
    refused = bytes([9, 0x97, 2])
    with pytest.raises(Malformed, match="exception 2"):
        answer(bytearray(refused + crc(refused)))
    with pytest.raises(Malformed, match="Modbus address 9"):
        answer(bytearray(b"HTTP/1.1"))
