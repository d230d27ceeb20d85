"""Frames of a Robotiq FT 300."""

from __future__ import annotations

import numpy as np
from hypothesis import given, strategies as st

from pomona.devices.laboratory_emulators.ft300 import Ft300Emulator
from pomona.devices.laboratory_emulators.ports import crc
from pomona.devices.wrist_sensors.codec import START_STREAM, take_frames

WRENCHES = st.lists(st.integers(-32768, 32767), min_size=6, max_size=6).map(
    lambda counts: np.array(counts) / np.array([100.0] * 3 + [1000.0] * 3)
)


def frame(wrench: np.ndarray) -> bytes:
    """Return the frame of a wrench as the emulated sensor sends it, without noise."""
    sensor = Ft300Emulator(lambda: wrench)
    sensor._rng = NoNoise()  # type: ignore[assignment]
    return sensor.measured()


class NoNoise:
    def normal(self, mean: float, sigma: float, size: int) -> np.ndarray:
        return np.zeros(size)


def test_driver_and_emulator_have_the_request_and_the_check_sum_of_the_manual() -> None:
    assert START_STREAM.hex(" ") == "09 10 01 9a 00 01 02 02 00 cd ca"
    assert crc(START_STREAM[:-2]) == START_STREAM[-2:]


@given(st.lists(WRENCHES, max_size=5), st.binary(max_size=40), st.integers(1, 20))
def test_frames_are_found_again_whatever_the_pieces_of_the_stream(
    wrenches: list[np.ndarray], before: bytes, size: int
) -> None:
    before = before.replace(b"\x20", b"\x21")  # the head of a frame would hide one
    stream = before + b"".join(map(frame, wrenches))
    buffer, found = bytearray(), []
    for start in range(0, len(stream), size):
        buffer += stream[start : start + size]
        found += take_frames(buffer)[0]
    np.testing.assert_allclose(found, wrenches, atol=1e-9) if wrenches else None
    assert len(found) == len(wrenches)


@given(WRENCHES, st.integers(0, 15), st.integers(1, 255))
def test_a_frame_with_a_changed_byte_is_none(wrench: np.ndarray, at: int, change: int) -> None:
    damaged = bytearray(frame(wrench))
    damaged[at] ^= change
    assert take_frames(damaged)[0] == []


@given(st.binary(max_size=300))
def test_no_bytes_raise_or_stay_for_ever(garbage: bytes) -> None:
    buffer = bytearray(garbage)
    take_frames(buffer)
    assert len(buffer) < 16
