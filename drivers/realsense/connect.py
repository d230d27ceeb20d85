"""The driver `realsense` of a cell file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from drivers.cell_file import Settings
from drivers.device import Bench
from drivers.errors import DeviceError, DeviceLost
from drivers.interfaces import Arm, Float64
from drivers.realsense.driver import StreamingCamera
from drivers.realsense.ride import Ride
from drivers.realsense.source import FILTERS, CameraSettings, PipelineSource, cameras_found


def connect(settings: Settings, bench: Bench) -> StreamingCamera:
    """Open the camera that a cell file describes.

    camera:
      driver: realsense
      serial: "0123"                    # any camera without it; or bag: FILE, a recording
      size: [640, 480]
      rate: 30 Hz
      preset: High Accuracy
      filters: spatial temporal
      options: {laser_power: 150}
      hand_eye: hand_eye.json           # from `pomona calibrate hand-eye`: pose of the camera in tool0
      silence: 500 ms                   # no image for so long: the camera is lost
    """
    width, height = settings.vector("size", 2) if settings.has("size") else (640, 480)
    filters = tuple(settings.text("filters", " ").split())
    unknown = [name for name in filters if name not in FILTERS]
    if unknown:
        raise settings.error(f"there is no filter '{unknown[0]}'", "filters", f"known: {', '.join(FILTERS)}")
    options = settings.section("options") if settings.has("options") else None
    wanted = CameraSettings(
        serial=settings.text("serial") if settings.has("serial") else "",
        bag=settings.file("bag") if settings.has("bag") else None,
        size=(int(width), int(height)),
        rate=round(settings.number("rate", "rate", 30.0, 1.0, 300.0)),
        preset=settings.text("preset") if settings.has("preset") else "",
        filters=filters,
        options={name: options.number(name) for name in options.names()} if options else {},
    )
    arm = bench.find(Arm)
    ride = Ride(arm, read_hand_eye(settings))
    silence = settings.number("silence", "time", 0.5, 0.05, 10.0)
    camera = StreamingCamera(lambda: PipelineSource(wanted), ride, bench.clock, silence=silence)
    try:
        camera.connect()
    except DeviceLost as error:
        raise settings.error(error.message, "serial", f"cameras here: {', '.join(_found()) or 'none'}") from error
    camera.start()
    return camera


def read_hand_eye(settings: Settings) -> Float64:
    """Pose of the camera in its mount, from the file that `pomona calibrate hand-eye` writes.

    Raises:
        CellFileError: there is none, or it holds no pose.
    """
    if not settings.has("hand_eye"):
        raise settings.error("the camera needs 'hand_eye'", "hand_eye", "pomona calibrate hand-eye makes the file")
    path: Path = settings.file("hand_eye", "make it with `pomona calibrate hand-eye`")
    try:
        T = np.array(json.loads(path.read_text(encoding="utf-8"))["T_mount_camera"], dtype=np.float64)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise settings.error(f"{path} holds no 'T_mount_camera': {error}", "hand_eye") from error
    if T.shape != (4, 4) or np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > 1e-4:
        raise settings.error(f"'T_mount_camera' in {path} is no rigid 4 x 4 transform", "hand_eye")
    return T


def _found() -> list[str]:
    try:
        return cameras_found()
    except DeviceError:
        return []
