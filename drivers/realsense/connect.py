"""The driver `realsense` of a cell file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.camera_options import DepthNoiseSection
from drivers.device import ConnectContext
from drivers.driver import Settings, driver
from drivers.errors import DeviceError, DeviceLost
from drivers.interfaces import NOMINAL_DEPTH_NOISE, Arm
from drivers.realsense.camera_mount import CameraMount
from drivers.realsense.driver import StreamingCamera
from drivers.realsense.source import FILTERS, CameraSettings, PipelineSource, cameras_found
from executive.values.arrays import Float64
from executive.values.kinds import Counts, MappingOf, Measure, Number, PathTo, Text, Words
from executive.values.plain_text import read_plain_text
from executive.values.rotations import is_rigid
from executive.values.sections import Problem, Section, value
from executive.values.units import RATE, TIME


class UnusableHandEye(ValueError):
    """A file that holds no pose of a camera."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RealSenseFile:
    """An Intel RealSense depth camera, on the arm or in the cell."""

    serial: str = value(Text(), "", "of the camera; any camera without it")
    bag: Path | None = value(PathTo("file"), None, "a recording instead of a camera")
    size: tuple[int, ...] = value(Counts(2, 1, 10_000), (640, 480), "width and height of both images")
    rate: float = value(Measure(RATE, "1 Hz", "300 Hz"), "30 Hz", "frames per second")
    preset: str = value(Text(), "", "of depth: High Accuracy, High Density …")
    filters: tuple[str, ...] = value(Words(*FILTERS), (), "of depth, in their order: " + ", ".join(FILTERS))
    options: Mapping[str, float] = value(MappingOf(Number()), {}, "of the depth sensor, by their names in the library")
    hand_eye: Path = value(
        PathTo("file", "make it with `pomona calibrate hand-eye`"),
        help="pose of the camera in its mount; `pomona calibrate hand-eye` makes the file",
    )
    depth_noise: DepthNoiseSection | None = value(
        Section(DepthNoiseSection), None, "how much depth errs; without it a D435's nominal noise"
    )
    silence: float = value(Measure(TIME, "50 ms", "10 s"), "500 ms", "no image for so long: the camera is lost")

    def problems(self) -> Iterator[Problem]:
        try:
            read_hand_eye(self.hand_eye)
        except UnusableHandEye as error:
            yield Problem("hand_eye", str(error), "make it with `pomona calibrate hand-eye`")


@driver(StreamingCamera, RealSenseFile)
def connect(settings: Settings[RealSenseFile], context: ConnectContext) -> StreamingCamera:
    """Open the camera that a cell file describes."""
    said = settings.values
    width, height = said.size
    wanted = CameraSettings(
        serial=said.serial,
        bag=said.bag,
        size=(width, height),
        rate=round(said.rate),
        preset=said.preset,
        filters=said.filters,
        options=said.options,
    )
    mount = CameraMount(context.find(Arm), read_hand_eye(said.hand_eye))
    noise = said.depth_noise.noise() if said.depth_noise else NOMINAL_DEPTH_NOISE
    camera = StreamingCamera(
        lambda: PipelineSource(wanted), mount, context.clock, silence=said.silence, depth_noise=noise
    )
    try:
        camera.connect()
    except DeviceLost as error:
        raise settings.error(error.message, "serial", f"cameras here: {', '.join(_found()) or 'none'}") from error
    camera.start()
    return camera


FARTHEST = 5.0
"""A camera is within this distance of the flange or base that carries it [m]; in millimetres it would be far beyond."""


def read_hand_eye(path: Path) -> Float64:
    """T_mount_camera (4, 4) [m], from the file that `pomona calibrate hand-eye` writes.

    Raises:
        UnusableHandEye: it holds no pose.
    """
    try:
        T = np.array(json.loads(read_plain_text(path))["T_mount_camera"], dtype=np.float64)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise UnusableHandEye(f"{path} holds no 'T_mount_camera': {error}") from error
    if T.shape != (4, 4) or not is_rigid(T):
        raise UnusableHandEye(f"'T_mount_camera' in {path} is no rigid 4 x 4 transform")
    if np.linalg.norm(T[:3, 3]) > FARTHEST:
        raise UnusableHandEye(f"'T_mount_camera' in {path} is {np.linalg.norm(T[:3, 3]):.3g} m long: it is in metres")
    return T


def _found() -> list[str]:
    try:
        return cameras_found()
    except DeviceError:
        return []
