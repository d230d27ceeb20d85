import contextlib
import math
import struct

import pytest
from hypothesis import given, strategies as st

from pomona.devices.wsg.codec import (
    Command,
    Homing,
    Move,
    Observe,
    Plain,
    Reply,
    Request,
    Script,
    SetSoftLimits,
    SetValue,
    Status,
    decode_reply,
    decode_request,
    encode,
    encode_reply,
)
from pomona.devices.wsg.frame import FrameDecoder, WireFrame, checksum, encode_frame
from pomona.executive.cell.owner import Malformed


@pytest.mark.parametrize(
    ("request_", "wire"),
    [
        (Homing(0), "aa aa aa 20 01 00 00 8f 83"),
        (Plain(Command.STOP), "aa aa aa 22 00 00 0e 76"),
        (Plain(Command.ACKNOWLEDGE), "aa aa aa 24 03 00 61 63 6b dc b9"),
        (Move(0.030, 0.050), "aa aa aa 21 09 00 02 00 00 f0 41 00 00 48 42 5b 99"),
        (
            Script(Command.SCRIPT_SPEED, 0.0, -0.005),
            "aa aa aa b2 09 00 00 00 00 00 00 00 00 a0 c0 78 d7",
        ),
    ],
)
def test_requests_are_the_bytes_of_the_public_check_frames(request_: Request, wire: str) -> None:
    assert encode(request_) == bytes.fromhex(wire)
    [frame] = FrameDecoder().decode(bytes.fromhex(wire))
    assert encode(decode_request(frame)) == bytes.fromhex(wire)


def test_the_checksum_has_the_public_value_after_the_preamble() -> None:
    assert checksum(b"\xaa\xaa\xaa") == 0x50F5


numbers = st.floats(-10.0, 10.0, width=32)
requests = st.one_of(
    st.builds(
        Plain,
        st.sampled_from(
            [
                Command.STOP,
                Command.FAST_STOP,
                Command.ACKNOWLEDGE,
                Command.INFO,
                Command.LIMITS,
            ]
        ),
    ),
    st.builds(Homing, st.integers(0, 2)),
    st.builds(Move, numbers, numbers),
    st.builds(
        SetValue, st.sampled_from([Command.SET_ACCELERATION, Command.SET_FORCE_LIMIT]), numbers
    ),
    st.builds(SetSoftLimits, numbers, numbers),
    st.builds(
        Observe,
        st.sampled_from([Command.SYSTEM_STATE, Command.WIDTH]),
        st.booleans(),
        st.just(0.02),
    ),
    st.builds(
        Script, st.sampled_from([Command.SCRIPT_READ, Command.SCRIPT_SPEED]), numbers, numbers
    ),
)


def close(a: object, b: object) -> bool:
    return a == b or (
        isinstance(a, float)
        and isinstance(b, float)
        and math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-9)
    )


@given(requests)
def test_a_request_survives_the_wire(request_: Request) -> None:
    [frame] = FrameDecoder().decode(encode(request_))
    back = decode_request(frame)
    assert type(back) is type(request_)
    for name in type(request_).__dataclass_fields__:
        assert close(getattr(back, name), getattr(request_, name))


@pytest.mark.parametrize(
    "reply",
    [
        Reply(Command.MOVE, Status.CMD_PENDING),
        Reply(Command.MOVE, Status.AXIS_BLOCKED),
        Reply(Command.SYSTEM_STATE, Status.SUCCESS, (0x1003,)),
        Reply(Command.WIDTH, Status.SUCCESS, (0.0625,)),
        Reply(Command.SCRIPT_SPEED, Status.SUCCESS, (0.03125, -0.0078125)),
        Reply(Command.INFO, Status.SUCCESS, (2, 1, 0x4001, 123456)),
    ],
)
def test_a_reply_survives_the_wire(reply: Reply) -> None:
    [frame] = FrameDecoder().decode(encode_reply(reply))
    back = decode_reply(frame)
    assert (back.command, back.status) == (reply.command, reply.status)
    assert back.values == pytest.approx(reply.values)


@given(
    st.lists(requests, min_size=1, max_size=5),
    st.lists(st.integers(1, 20), min_size=1, max_size=20),
)
def test_frames_are_found_however_the_stream_is_cut(sent: list[Request], cuts: list[int]) -> None:
    stream, decoder, frames, at = b"".join(map(encode, sent)), FrameDecoder(), [], 0
    for size in (*cuts, len(stream)):
        frames += decoder.decode(stream[at : at + size])
        at += size
    assert b"".join(map(encode_frame, frames)) == stream
    assert decoder.discarded == 0


@given(st.binary(max_size=60), requests, requests)
def test_intact_frames_behind_garbage_are_found(
    garbage: bytes, first: Request, second: Request
) -> None:
    decoder = FrameDecoder()
    frames = decoder.decode(garbage + encode(first) + encode(second)) + decoder.flush()
    assert [encode_frame(frame) for frame in frames[-2:]] == [encode(first), encode(second)]


def test_a_damaged_length_does_not_swallow_the_frames_behind_it() -> None:
    damaged = bytearray(encode(Plain(Command.STOP)))
    damaged[4] = 60
    decoder = FrameDecoder()
    frames = decoder.decode(bytes(damaged) + encode(Homing(1)))
    assert frames == []  # it may still be a long frame …
    assert [frame.command for frame in decoder.flush()] == [
        Command.HOMING
    ]  # … but the line fell silent
    assert decoder.discarded == len(damaged)


@given(st.integers(0, 255), st.binary(max_size=40))
def test_any_frame_decodes_or_is_malformed(command: int, payload: bytes) -> None:
    for decode in (decode_request, decode_reply):
        with contextlib.suppress(Malformed):
            decode(WireFrame(command, payload))


def test_an_unknown_status_is_malformed_in_words() -> None:
    with pytest.raises(Malformed, match="unknown status 99: aa aa aa 21 02 00 63 00"):
        decode_reply(WireFrame(Command.MOVE, struct.pack("<H", 99)))


def test_a_value_that_is_no_number_is_malformed() -> None:
    with pytest.raises(Malformed, match="not a number"):
        decode_reply(WireFrame(Command.WIDTH, struct.pack("<Hf", 0, math.nan)))
