"""UFACTORY's bytes: whole messages from any pieces, and a typed error for everything else."""

from __future__ import annotations

import contextlib
import struct

import pytest
from hypothesis import given, strategies as st

from pomona.devices.xarm.codec import (
    HEADER,
    Register,
    XArmAnswer,
    decode_answers,
    decode_reports,
    encode,
    identity,
    joints,
    servo_point,
)
from pomona.drivers import Malformed

ANSWERS = st.lists(
    st.builds(
        XArmAnswer,
        st.integers(0, 0xFFFF),
        st.integers(0, 255),
        st.integers(0, 255),
        st.binary(max_size=300),
    ),
    max_size=6,
)


def written(answer: XArmAnswer) -> bytes:
    head = bytes([answer.register, answer.flags])
    return HEADER.pack(answer.transaction, 2, 2 + len(answer.body)) + head + answer.body


@given(ANSWERS, st.lists(st.integers(1, 50), min_size=1, max_size=20))
def test_answers_come_whole_however_the_wire_cuts_them(
    answers: list[XArmAnswer], cuts: list[int]
) -> None:
    stream = b"".join(map(written, answers))
    buffer, found, at, turn = bytearray(), [], 0, 0
    while at < len(stream):
        size = cuts[turn % len(cuts)]
        buffer += stream[at : at + size]
        at, turn = at + size, turn + 1
        found += decode_answers(buffer)
    assert found == answers
    assert not buffer


@given(st.binary(max_size=400))
def test_any_bytes_are_messages_or_malformed(chunk: bytes) -> None:
    for decode in (decode_answers, decode_reports):
        buffer = bytearray(chunk)
        with contextlib.suppress(Malformed):
            decode(buffer)
            assert chunk.endswith(bytes(buffer))
    for read in (identity, joints):
        with contextlib.suppress(Malformed):
            read(chunk)


def test_a_request_has_the_bytes_of_the_vendor_s_client() -> None:
    assert encode(7, Register.SET_STATE, b"\x04") == bytes.fromhex("0007 0002 0002 0c 04")
    point = encode(1, Register.SERVO_JOINTS, servo_point([0.5] * 6))
    assert point[:7] == bytes.fromhex("0001 0002 0029 1d")
    assert struct.unpack("<10f", point[7:]) == (*[0.5] * 6, 0.0, 0.0, 0.0, 0.0)


def test_a_report_of_87_bytes_gives_state_and_mode() -> None:
    body = bytes([0x12]) + struct.pack(">H", 3) + struct.pack("<7f", *range(7)) + bytes(52)
    buffer = bytearray(struct.pack(">I", 87) + body + b"\x00")
    (report,) = decode_reports(buffer)
    assert (report.state, report.mode) == (2, 1)
    assert buffer == b"\x00"


@pytest.mark.parametrize(
    ("text", "model", "version"),
    [
        ("6,6,XI1304,AC1304,v2.5.0", "xarm6", (2, 5, 0)),
        ("7,7,XS1304,AC1304,v1.12.10", "xarm7", (1, 12, 10)),
        ("7,13,CS1304,AC1304,v2.7.101", "xarm7", (2, 7, 101)),
        ("6,9,LI1006,DC1006,v2.1.0", "lite6", (2, 1, 0)),
        ("6,12,FX8500,AC8500,v2.3.0", "850", (2, 3, 0)),
        ("5,5,,,1.9.110", "xarm5", (1, 9, 110)),
    ],
)
def test_the_version_names_the_model(text: str, model: str, version: tuple[int, int, int]) -> None:
    assert identity(text.encode().ljust(40, b"\0")) == (model, version)


@pytest.mark.parametrize("body", [b"", b"v2.5.0", b"\xff" * 40])
def test_another_version_is_malformed(body: bytes) -> None:
    with pytest.raises(Malformed, match="no version"):
        identity(body)
