"""The conversion of framesets, through the library's own software device; skipped where it is not installed."""

from __future__ import annotations

import re
import sys
from typing import Any

import numpy as np
import pytest

from pomona.devices.realsense.source import Aligner, load_library
from pomona.drivers.errors import DeviceFault
from pomona.executive.values.installation import install_extra

WIDTH, HEIGHT, UNIT = 64, 48, 0.001


class SoftwareCamera:
    """Two software sensors whose frames a syncer pairs, as a camera's would be."""

    def __init__(self, rs: Any, offset: float = 0.0) -> None:
        self.rs = rs
        self.device = rs.software_device()
        inner = rs.intrinsics()
        inner.width, inner.height, inner.fx, inner.fy, inner.ppx, inner.ppy = (
            WIDTH,
            HEIGHT,
            60.0,
            61.0,
            31.5,
            23.5,
        )
        inner.model, inner.coeffs = rs.distortion.none, [0.0] * 5
        self.sensors, self.profiles = [], []
        for uid, (stream, form, bytes_) in enumerate(
            ((rs.stream.depth, rs.format.z16, 2), (rs.stream.color, rs.format.rgb8, 3))
        ):
            sensor = self.device.add_sensor(str(stream))
            video = rs.video_stream()
            video.type, video.index, video.uid, video.fmt, video.bpp = stream, 0, uid, form, bytes_
            video.width, video.height, video.fps, video.intrinsics = WIDTH, HEIGHT, 30, inner
            profile = rs.video_stream_profile(sensor.add_video_stream(video))
            self.sensors.append(sensor)
            self.profiles.append(profile)
        self.sensors[0].add_read_only_option(rs.option.depth_units, UNIT)
        shift = rs.extrinsics()
        shift.rotation, shift.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [offset, 0.0, 0.0]
        self.profiles[0].register_extrinsics_to(self.profiles[1], shift)
        self.device.create_matcher(rs.matchers.dlr_c)
        self.syncer = rs.syncer()
        for sensor, profile in zip(self.sensors, self.profiles, strict=True):
            sensor.open(profile)
            sensor.start(self.syncer)
        self.number = 0

    def shoot(self, depth: np.ndarray, colour: np.ndarray) -> Any:
        rs = self.rs
        self.number += 1
        for sensor, profile, image, bytes_ in (
            (self.sensors[0], self.profiles[0], depth, 2),
            (self.sensors[1], self.profiles[1], colour, 3),
        ):
            frame = rs.software_video_frame()
            frame.pixels, frame.stride, frame.bpp = (
                np.ascontiguousarray(image),
                WIDTH * bytes_,
                bytes_,
            )
            frame.timestamp, frame.frame_number = 1000.0 * self.number / 30.0, self.number
            frame.domain, frame.profile = (
                rs.timestamp_domain.hardware_clock,
                profile.as_video_stream_profile(),
            )
            if bytes_ == 2:
                frame.depth_units = UNIT
            sensor.on_video_frame(frame)
        return self.syncer.wait_for_frames(1000)


@pytest.fixture(scope="module")
def rs() -> Any:
    return pytest.importorskip("pyrealsense2", exc_type=ImportError)


def frames_of(camera: SoftwareCamera) -> Any:
    depth = np.full((HEIGHT, WIDTH), 500, np.uint16)
    depth[10:20, 10:20] = 0
    colour = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    colour[...] = (200, 100, 50)
    frames = camera.shoot(depth, colour)
    while frames.size() < 2:
        frames = camera.shoot(depth, colour)
    return frames


def test_a_frameset_becomes_rgb_and_metres_with_the_colours_intrinsics(rs: Any) -> None:
    pair = Aligner(rs, UNIT).pair(frames_of(SoftwareCamera(rs)))
    assert pair is not None
    assert pair.colour[5, 5].tolist() == [200, 100, 50]
    assert pair.depth.dtype == np.float32
    assert pair.depth[40, 40] == pytest.approx(0.5)
    assert pair.depth[15, 15] == 0.0
    assert (pair.intrinsics.fx, pair.intrinsics.cy, pair.intrinsics.width) == (60.0, 23.5, WIDTH)
    assert not pair.on_host_clock


def test_depth_is_moved_into_the_colour_cameras_view(rs: Any) -> None:
    # The colour camera stands so that points move right by 60 px · 0.05 m / 0.5 m = 6 px.
    pair = Aligner(rs, UNIT).pair(frames_of(SoftwareCamera(rs, offset=0.05)))
    assert pair is not None
    hole = np.argwhere(pair.depth[25] == 0.0)[:, 0]
    assert hole.max() <= 7  # nothing is seen at the left edge
    assert pair.depth[15, 21] == 0.0  # the hole of columns 10 … 19 is at 16 … 25
    assert pair.depth[15, 12] == pytest.approx(0.5)


def test_filters_of_the_library_are_applied(rs: Any) -> None:
    pair = Aligner(rs, UNIT, ("hole_filling",)).pair(frames_of(SoftwareCamera(rs)))
    assert pair is not None
    assert pair.depth[15, 15] == pytest.approx(0.5)


def test_without_the_library_the_error_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(DeviceFault, match=re.escape(install_extra("realsense"))):
        load_library()
