"""The RealSense library behind a small interface: pairs of aligned images from a camera, a bag or a software device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.drivers import DeviceFault, DeviceLost, Intrinsics
from pomona.executive import install_extra

FILTERS = ("decimation", "spatial", "temporal", "hole_filling")


def load_library() -> ModuleType:
    """Import pyrealsense2 lazily.

    Raises DeviceFault: it is not installed, or a system library is missing; the text has the remedy.
    """
    try:
        import pyrealsense2
    except ImportError as error:
        raise DeviceFault(
            "camera",
            f"the RealSense library cannot be imported ({error}); "
            f"{install_extra('realsense')}, and apt install libusb-1.0-0",
        ) from error
    module: ModuleType = pyrealsense2
    return module


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """Options of the camera in the cell file."""

    serial: str = ""  # of the camera, or "" for any
    bag: Path | None = None  # a recording to play instead of a camera
    size: tuple[int, int] = (640, 480)  # width and height of both images [px]
    rate: int = 30  # frames per second
    preset: str = ""  # name of a depth preset ("High Accuracy", "High Density", …), or ""
    filters: tuple[str, ...] = ()  # names from `FILTERS`, applied in the order there
    # further options of the depth sensor by their names in the library, for instance laser_power
    options: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Aligned images: colour (h, w, 3) uint8 RGB, depth (h, w) float32 [m], and when the camera took them."""

    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]
    intrinsics: Intrinsics
    taken: (
        float | None
    )  # the camera's own time [s], in the clock domain given by `on_host_clock`; None for a recording
    on_host_clock: (
        bool  # whether `taken` is the host's wall clock; else the camera's hardware counter
    )
    number: int  # the camera's frame number


class Aligner:
    """Turns framesets of the library into `Pair`s: filters, alignment to colour, metres."""

    def __init__(self, rs: ModuleType, depth_unit: float, filters: tuple[str, ...] = ()) -> None:
        self._rs = rs
        self._unit = depth_unit
        self._align = rs.align(rs.stream.color)
        known = {
            "decimation": rs.decimation_filter,
            "spatial": rs.spatial_filter,
            "temporal": rs.temporal_filter,
            "hole_filling": rs.hole_filling_filter,
        }
        self._filters = [known[name]() for name in FILTERS if name in filters]

    def pair(self, frames: Any) -> Pair | None:
        """Return the images of a frameset, or None when it lacks one of them."""
        for step in self._filters:
            frames = step.process(frames).as_frameset()
        frames = self._align.process(frames)
        colour = frames.get_color_frame()
        depth = frames.get_depth_frame()
        if not colour or not depth:
            return None
        image = np.asanyarray(colour.get_data())
        if colour.get_profile().format() == self._rs.format.bgr8:
            image = image[..., ::-1]
        inner = colour.get_profile().as_video_stream_profile().get_intrinsics()
        intrinsics = Intrinsics(inner.fx, inner.fy, inner.ppx, inner.ppy, inner.width, inner.height)
        metres = np.asanyarray(depth.get_data()).astype(np.float32) * np.float32(self._unit)
        hardware = colour.get_frame_timestamp_domain() == self._rs.timestamp_domain.hardware_clock
        return Pair(
            np.array(image, dtype=np.uint8),
            metres,
            intrinsics,
            colour.get_timestamp() * 1e-3,
            not hardware,
            colour.get_frame_number(),
        )


class PipelineSource:
    """A camera or a bag, opened by the library's pipeline."""

    def __init__(self, settings: CameraSettings) -> None:
        """Open it.

        Raises:
            DeviceFault: no library, or an option that the camera does not have.
            DeviceLost: no such camera, or it does not offer these images.
        """
        rs = load_library()
        self._recorded = settings.bag is not None
        config = rs.config()
        width, height = settings.size
        if settings.bag is not None:
            config.enable_device_from_file(str(settings.bag), repeat_playback=False)
        else:
            if settings.serial:
                config.enable_device(settings.serial)
            config.enable_stream(rs.stream.color, width, height, rs.format.rgb8, settings.rate)
            config.enable_stream(rs.stream.depth, width, height, rs.format.z16, settings.rate)
        self._pipeline = rs.pipeline()
        try:
            profile = self._pipeline.start(config)
        except RuntimeError as error:
            raise DeviceLost("camera", f"cannot be opened: {error}") from error
        device = profile.get_device()
        self.name = device.get_info(rs.camera_info.name)
        self.firmware = _info(rs, device, "firmware_version")
        sensor = device.first_depth_sensor()
        try:
            if settings.bag is not None:
                device.as_playback().set_real_time(False)
            else:
                _configure(rs, sensor, settings)
            self._aligner = Aligner(rs, sensor.get_depth_scale(), settings.filters)
        except Exception:
            self._pipeline.stop()
            raise

    def wait(self, timeout: float) -> Pair | None:
        """Return the next images, or None when none arrived in time.

        Raises DeviceLost: the camera is gone, or the bag is at its end.
        """
        try:
            came, frames = self._pipeline.try_wait_for_frames(int(timeout * 1000.0))
        except RuntimeError as error:
            raise DeviceLost("camera", str(error)) from error
        pair = self._aligner.pair(frames) if came else None
        return replace(pair, taken=None) if pair is not None and self._recorded else pair

    def close(self) -> None:
        self._pipeline.stop()


def _configure(rs: ModuleType, sensor: Any, settings: CameraSettings) -> None:
    if settings.preset:
        span = sensor.get_option_range(rs.option.visual_preset)
        names = {
            sensor.get_option_value_description(rs.option.visual_preset, i): i
            for i in range(int(span.min), int(span.max) + 1)
        }
        if settings.preset not in names:
            raise DeviceFault(
                "camera", f"has no preset '{settings.preset}', it has {', '.join(names)}"
            )
        sensor.set_option(rs.option.visual_preset, names[settings.preset])
    for name, value in settings.options.items():
        option = getattr(rs.option, name, None)
        if option is None or not sensor.supports(option):
            raise DeviceFault("camera", f"has no option '{name}'")
        try:
            sensor.set_option(option, value)
        except RuntimeError as error:
            raise DeviceFault("camera", f"rejects {value:g} for '{name}': {error}") from error


def _info(rs: ModuleType, device: Any, name: str) -> str:
    field_ = getattr(rs.camera_info, name)
    return str(device.get_info(field_)) if device.supports(field_) else ""


def cameras_found() -> list[str]:
    """Return names and serial numbers of the RealSense cameras connected to this machine."""
    rs = load_library()
    return [
        f"{_info(rs, device, 'name')} {_info(rs, device, 'serial_number')}".strip()
        for device in rs.context().query_devices()
    ]
