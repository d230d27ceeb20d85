import dataclasses
import math
import struct
import typing

import pytest
from hypothesis import given, strategies as st

from pomona.devices.motoman import codec
from pomona.devices.motoman.codec import (
    Communication,
    Control,
    JointFeedback,
    Message,
    MessageDecoder,
    MotionControl,
    MotionReply,
    Order,
    Ping,
    RobotStatus,
    TrajectoryPoint,
    Valid,
    encode,
)
from pomona.devices.motoman.words import fault, refusal
from pomona.executive.cell.owner import Malformed

numbers = st.floats(-10.0, 10.0, width=32)
ten = st.lists(numbers, min_size=10, max_size=10).map(tuple)
integers = st.integers(-(2**31), 2**31 - 1)


def bodies() -> st.SearchStrategy[codec.Body]:
    def build(body: type[codec.Body]) -> st.SearchStrategy[codec.Body]:
        kinds = {"int": integers, "float": numbers, "Ten": ten}
        return st.builds(body, **{f.name: kinds[str(f.type)] for f in dataclasses.fields(body)})

    return st.one_of([build(body) for body in typing.get_args(codec.Body)])


messages = st.builds(Message, bodies(), st.sampled_from(Communication), st.integers(0, 2))
orders: st.SearchStrategy[Order] = st.sampled_from(["<", ">"])


@pytest.mark.parametrize(
    ("body", "size"),
    [
        (Ping(), 16),
        (RobotStatus(1, 0, 0, 0, 0, 2, 1), 44),
        (TrajectoryPoint(0, 0, 7, 0.0, codec.ZEROS, codec.ZEROS), 152),
        (JointFeedback(0, 3, 0.0, codec.ZEROS), 148),
        (MotionControl(0, -1, Control.STOP), 68),
        (MotionReply(0, -1, Control.STOP, 0, 0), 76),
    ],
)
def test_every_message_has_the_public_size_and_its_length_excludes_itself(
    body: codec.Body, size: int
) -> None:
    wire = encode(Message(body, Communication.REQUEST), "<")
    assert len(wire) == size
    assert struct.unpack("<iii", wire[:12]) == (size - 4, body.TYPE, 2)


def test_a_point_is_laid_out_as_group_sequence_valid_time_and_three_times_ten_joints() -> None:
    valid = Valid.TIME | Valid.POSITION | Valid.VELOCITY
    wire = encode(
        Message(TrajectoryPoint(0, 3, valid, 0.5, (1.0, 2.0), (0.25,)), Communication.REQUEST), ">"
    )
    assert struct.unpack(">7i", wire[:28]) == (148, 14, 2, 0, 0, 3, 7)
    values = struct.unpack(">31f", wire[28:])
    assert values == (0.5, 1.0, 2.0, *[0.0] * 8, 0.25, *[0.0] * 19)


@given(
    st.lists(messages, min_size=1, max_size=4), orders, st.lists(st.integers(1, 100), max_size=10)
)
def test_messages_are_found_however_the_stream_is_cut(
    sent: list[Message], order: Order, cuts: list[int]
) -> None:
    stream, decoder, found, at = (
        b"".join(encode(message, order) for message in sent),
        MessageDecoder(order),
        [],
        0,
    )
    for size in (*cuts, len(stream)):
        found += decoder.decode(stream[at : at + size])
        at += size
    assert found == sent
    assert decoder.discarded == 0


@given(st.binary(max_size=40), messages, orders)
def test_an_intact_message_behind_garbage_is_found(
    garbage: bytes, sent: Message, order: Order
) -> None:
    decoder = MessageDecoder(order)
    found = decoder.decode(garbage + encode(sent, order)) + decoder.flush()
    assert found[-1] == sent


def test_the_wrong_byte_order_is_nonsense_with_its_bytes() -> None:
    wire = encode(Message(RobotStatus(1, 0, 0, 0, 0, 2, 1), Communication.TOPIC), ">")
    decoder = MessageDecoder("<")
    assert decoder.decode(wire) + decoder.flush() == []
    with pytest.raises(Malformed, match="byte order: 00 00 00 28 00 00 00 0d") as caught:
        decoder.complain()
    assert caught.value.received == wire
    decoder.complain()  # said once


def test_a_value_that_is_no_number_is_nonsense() -> None:
    wire = encode(Message(JointFeedback(0, 3, 0.0, (math.nan,)), Communication.TOPIC), "<")
    decoder = MessageDecoder("<")
    assert decoder.decode(wire) == []
    assert decoder.discarded > 0


def test_every_known_subcode_has_words_and_an_unknown_one_its_numbers() -> None:
    for subcode in (*range(3000, 3007), *range(3010, 3018), *range(5000, 5013)):
        assert f"({subcode})" in refusal(MotionReply(0, 0, 0, 3, subcode))
    assert refusal(MotionReply(0, 0, 0, 99, 7)) == "refused (result 99, subcode 7)"
    assert "alarm 4321" in refusal(MotionReply(0, 0, 0, 4, 4321))


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (RobotStatus(1, 1, 0, 0, 0, 2, 0), "emergency stop"),
        (RobotStatus(1, 0, 4107, 1, 0, 2, 0), "alarm 4107"),
        (RobotStatus(1, 0, 0, 0, 0, 1, 0), "teach mode"),
        (RobotStatus(0, 0, 0, 0, 0, 2, 0), "servos are off"),
        (RobotStatus(1, 0, 0, 0, 1, 2, 1), ""),
    ],
)
def test_a_status_names_the_reason_that_keeps_the_arm_from_moving(
    status: RobotStatus, words: str
) -> None:
    assert (words in fault(status)) if words else fault(status) == ""
