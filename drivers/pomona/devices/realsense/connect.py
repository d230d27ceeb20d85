"""The driver `realsense` of a cell file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pomona.devices.realsense.camera_mount import CameraMount
from pomona.devices.realsense.driver import StreamingCamera
from pomona.devices.realsense.mounted_camera import MountedCameraFile, read_hand_eye
from pomona.devices.realsense.source import FILTERS, CameraSettings, PipelineSource, cameras_found
from pomona.drivers import Arm, ConnectContext, DeviceError, DeviceLost, Settings, driver
from pomona.executive import RATE, Counts, MappingOf, Measure, Number, PathTo, Text, Words, value


@dataclass(frozen=True, slots=True, kw_only=True)
class RealSenseFile(MountedCameraFile):
    """An Intel RealSense depth camera, on the arm or in the cell."""

    serial: str = value(Text(), "", "of the camera; any camera without it")
    bag: Path | None = value(PathTo("file"), None, "a recording instead of a camera")
    size: tuple[int, ...] = value(
        Counts(2, 1, 10_000), (640, 480), "width and height of both images"
    )
    rate: float = value(Measure(RATE, "1 Hz", "300 Hz"), "30 Hz", "frames per second")
    preset: str = value(Text(), "", "of depth: High Accuracy, High Density …")
    filters: tuple[str, ...] = value(
        Words(*FILTERS), (), "of depth, in their order: " + ", ".join(FILTERS)
    )
    options: Mapping[str, float] = value(
        MappingOf(Number()), {}, "of the depth sensor, by their names in the library"
    )


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
    camera = StreamingCamera(
        lambda: PipelineSource(wanted),
        mount,
        context.clock,
        silence=said.silence,
        depth_model=said.depth_errs,
    )
    try:
        camera.connect()
    except DeviceLost as error:
        raise settings.error(
            error.message, "serial", f"cameras here: {', '.join(_found()) or 'none'}"
        ) from error
    camera.start()
    return camera


def _found() -> list[str]:
    try:
        return cameras_found()
    except DeviceError:
        return []
