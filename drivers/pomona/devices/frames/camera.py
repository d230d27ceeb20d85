"""Recorded frames as a camera: the perception half of a tree runs on real images without a camera."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from pomona.devices.frames.folder import (
    DEPTH_MODEL_FILE,
    INTRINSICS_FILE,
    Images,
    UnusableFrames,
    folder_depth_model,
    folder_intrinsics,
    folder_poses,
    list_frames,
)
from pomona.devices.frames.video import list_video
from pomona.drivers import (
    D4XX,
    Camera,
    ConnectContext,
    DepthModel,
    DepthModelSection,
    Device,
    Frame,
    FrameSequence,
    FrameUnreadable,
    Intrinsics,
    IntrinsicsSection,
    Settings,
    depth_model_of,
    driver,
)
from pomona.executive import Clock, Float64, Problem, Section, Text, Whole, value

logger = logging.getLogger(__name__)

LEVEL = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""T_base_camera of a camera that looks level along the base's y: image x is base x, image down is base down."""


class Recorded(Protocol):
    """A recorded frame."""

    @property
    def label(self) -> str:
        """Its origin, for the operator."""

    def read(self, intrinsics: Intrinsics) -> Images:
        """Return its images. Raises UnusableFrames: they cannot be read, or do not fit the intrinsics."""


class FramesCamera(Device):
    """Shows one recorded frame until `advance` turns to the next."""

    interfaces = (Camera, FrameSequence)

    def __init__(
        self,
        frames: Sequence[Recorded],
        intrinsics: Intrinsics,
        clock: Clock,
        T_base_camera: Float64 = LEVEL,
        name: str = "camera",
        depth_model: DepthModel = D4XX,
        poses: Mapping[str, Float64] | None = None,
    ) -> None:
        """
        Args:
            T_base_camera: of frames without a recorded camera pose.
            poses: T_base_camera of the others, by their labels.
        """
        super().__init__(name)
        self.intrinsics = intrinsics
        self._depth_model = depth_model
        self._frames = frames
        self._clock = clock
        self._T_base_camera = T_base_camera
        self._poses = poses or {}
        self._position = 0
        self._read: tuple[int, Frame] | None = None

    @property
    def count(self) -> int:
        """How many frames there are."""
        return len(self._frames)

    def advance(self) -> bool:
        """Turn to the next frame; False at the last one, which stays."""
        if self._position + 1 >= len(self._frames):
            return False
        self._position += 1
        return True

    def latest(self) -> Frame:
        """Return the frame that is shown, stamped with the present time: a recording is as new as the look at it.

        Raises FrameUnreadable: one of its images cannot be used.
        """
        position = self._position
        if self._read is None or self._read[0] != position:
            self._read = position, self._load(position)
        frame = self._read[1]
        return Frame(
            stamp=self._clock.now(),
            sequence=position,
            colour=frame.colour,
            depth=frame.depth,
            intrinsics=frame.intrinsics,
            q=None,
            T_mount_camera=self._poses.get(frame.label, self._T_base_camera),
            label=frame.label,
            depth_model=self._depth_model,
            placed=frame.label in self._poses,
        )

    def _load(self, position: int) -> Frame:
        recorded = self._frames[position]
        try:
            colour, depth = recorded.read(self.intrinsics)
        except UnusableFrames as error:
            raise FrameUnreadable(self.name, str(error)) from error
        depth = self._depth_model.corrected(depth)
        colour.setflags(write=False)
        depth.setflags(write=False)
        return Frame(
            0.0, position, colour, depth, self.intrinsics, None, self._T_base_camera, recorded.label
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class FramesFile:
    """A folder of recorded colour and depth images; intrinsics that lie in it come before those of the cell file."""

    folder: str = value(
        Text(), help="the folder with the recorded frames, or a video: --set folder=PATH"
    )
    every: int = value(Whole(1, 1_000_000), 1, "number of frames of which one is shown")
    intrinsics: IntrinsicsSection | None = value(
        Section(IntrinsicsSection),
        None,
        f"of the camera, unless {INTRINSICS_FILE} lies in the folder",
    )
    depth_model: DepthModelSection | None = value(
        Section(DepthModelSection),
        None,
        f"how the depth errs, unless {DEPTH_MODEL_FILE} lies in the folder; without it as a D4xx",
    )

    def problems(self) -> Iterator[Problem]:
        if "://" in self.folder:
            yield Problem(
                "folder",
                f"'{self.folder}' is an address: recorded frames lie on this machine",
                "save them first",
            )


@driver(FramesCamera, FramesFile)
def connect(settings: Settings[FramesFile], context: ConnectContext) -> FramesCamera:
    """Open the folder or the video: from the working folder, else from the cell file's."""
    said = settings.values
    path = _resolve(Path(said.folder).expanduser(), context.cell.parent)
    folder = path if path.is_dir() else path.parent
    try:
        listed: Sequence[Recorded] = list_video(path) if path.is_file() else list_frames(path)
        frames = listed[:: said.every]
        intrinsics = folder_intrinsics(folder)
        if intrinsics is None:
            if said.intrinsics is None:
                hint = f"write 'intrinsics:' here, or put {INTRINSICS_FILE} into {folder}"
                raise settings.error("the camera's intrinsics are missing", "", hint)
            intrinsics = said.intrinsics.intrinsics()
            words = "%s: no %s there, using the cell file's intrinsics (fx %g px at %d x %d), which scale all sizes"
            logger.warning(
                words, folder, INTRINSICS_FILE, intrinsics.fx, intrinsics.width, intrinsics.height
            )
        frames[0].read(intrinsics)
        poses = folder_poses(folder, [frame.label for frame in listed])
    except UnusableFrames as error:
        hint = (
            f"put the right {INTRINSICS_FILE} into the folder" if "intrinsics" in str(error) else ""
        )
        raise settings.error(str(error), "folder", hint) from error
    depth_model = folder_depth_model(folder) or depth_model_of(said.depth_model)
    return FramesCamera(frames, intrinsics, context.clock, depth_model=depth_model, poses=poses)


def _resolve(folder: Path, cell_folder: Path) -> Path:
    return folder if folder.is_absolute() or folder.exists() else cell_folder / folder
