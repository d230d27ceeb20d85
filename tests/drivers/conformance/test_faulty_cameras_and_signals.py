"""Mistakes that a driver of a camera or of signals may hold: the claims find each, and say which they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pomona.drivers import Frame, Intrinsics
from pomona.drivers.conformance import (
    CAMERA,
    SIGNALS,
    CameraBench,
    Claims,
    Finding,
    SignalsBench,
    judged,
)
from tests.drivers.conformance.cameras import realsense
from tests.drivers.conformance.signals import mock, modbus


def showing(change: Callable[[Frame], Frame]) -> Callable[[], CameraBench]:
    """A camera whose driver hands on other frames than it should."""

    def bench() -> CameraBench:
        opened = realsense()
        latest = opened.device.latest
        opened.device.latest = lambda: change(latest())
        opened.got.clear()
        opened.serve(0.2)
        return opened

    return bench


def believing() -> CameraBench:
    """A camera whose frames are not judged."""
    opened = realsense()
    opened.device._guard.judge = lambda *_: True
    return opened


def holding() -> CameraBench:
    """A camera that is not let go."""
    opened = realsense()
    opened.device._close_source = lambda: None
    return opened


BUFFER = np.zeros((24, 32), np.float32)


def reused(frame: Frame) -> Frame:
    """A frame whose depth lies in the driver's buffer."""
    assert frame.depth is not None
    BUFFER[:] = frame.depth
    changed = replace(frame)
    object.__setattr__(changed, "depth", BUFFER)
    return changed


@pytest.mark.parametrize(
    ("opened", "claim", "words"),
    [
        (believing, "a_harm_is_noticed", "'frozen' for 1 s: it says ''"),
        (believing, "no_look_shows_the_past", "'frozen': a frame is"),
        (
            showing(lambda frame: replace(frame, stamp=frame.stamp - 0.3)),
            "no_look_shows_the_past",
            "a frame is .* mm off what was there",
        ),
        (
            showing(lambda frame: replace(frame, stamp=frame.stamp + 1e9)),
            "no_look_shows_the_past",
            "a look shows a frame -1e.09 s old",
        ),
        (
            showing(lambda frame: replace(frame, depth=1e3 * frame.depth)),
            "depth_is_in_metres",
            "it tells depths from",
        ),
        (
            showing(
                lambda frame: replace(frame, intrinsics=Intrinsics(600.0, 61.0, 16.0, 12.0, 32, 24))
            ),
            "intrinsics_fit_the_picture",
            "fx is told as 600 px, and is 60 px",
        ),
        (showing(reused), "a_frame_stays_as_it_is", "are others later"),
        (
            showing(lambda frame: replace(frame, sequence=-frame.sequence)),
            "stamps_increase",
            "not after the last one",
        ),
        (holding, "an_end_releases_the_camera", "it still holds the device"),
    ],
)
def test_a_camera_s_mistake_is_found(
    opened: Callable[[], CameraBench], claim: str, words: str
) -> None:
    find(CAMERA, opened, claim, words)


def find(claims: Claims[Any], opened: Callable[[], Any], claim: str, words: str) -> None:
    """The claim is not kept, and its sentence comes first."""
    (judge,) = (one for one in claims.all if one.name == claim)
    with pytest.raises(Finding, match=f"^{judge.words}: .*{words}"):
        judged(opened, judge)


def off_at_first() -> SignalsBench:
    """Signals that are told as off while they are unknown."""
    opened = modbus()
    read = opened.device.read
    opened.device.read = lambda name: replace(read(name), value=bool(read(name).value))
    return opened


def kept() -> SignalsBench:
    """Outputs that a stop leaves as they are."""
    opened = modbus()
    opened.device._rest = lambda: None
    return opened


def never_read_back() -> SignalsBench:
    """Outputs that are told as they were written."""
    opened = mock()
    opened.overwrite = lambda: None
    return opened


def slow() -> SignalsBench:
    """Inputs that are asked for five times a second."""
    opened = modbus()
    opened.device._period = 0.2
    return opened


def forgetful() -> SignalsBench:
    """Signals whose problem goes by itself."""
    opened = mock()
    check = opened.device.check

    def checked() -> None:
        opened.device._problem = None
        check()

    opened.device.check = checked
    return opened


@pytest.mark.parametrize(
    ("opened", "claim", "words"),
    [
        (off_at_first, "only_an_edge_is_one", "on all the time is told as off"),
        (kept, "outputs_end_safe", "after a stop the output is on"),
        (never_read_back, "an_overwritten_output_is_noticed", "nothing is reported"),
        (slow, "a_short_change_is_told", "of two pulses it told"),
        (forgetful, "a_harm_is_noticed", "'stopped' for 1 s: it says .*, then ''"),
    ],
)
def test_a_mistake_with_signals_is_found(
    opened: Callable[[], SignalsBench], claim: str, words: str
) -> None:
    find(SIGNALS, opened, claim, words)
