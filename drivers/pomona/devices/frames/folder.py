"""A folder of recorded RGB-D frames: which files belong together, and reading one of them.

121804_color.jpg        colour image, 8 bit
121804_depth_mm.png     depth registered to it, uint16 [mm], 0 = no measurement
intrinsics.yaml         fx, fy, cx, cy [px], width, height (optional: the cell file may hold them instead)
frames.json             label and T_base_camera (4 x 4) of each frame (optional), as `pomona runs export` writes it
"""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.devices.frames.foreign_calibration import foreign_calibration
from pomona.drivers import (
    DepthModel,
    DepthModelSection,
    DriverError,
    Intrinsics,
    IntrinsicsSection,
    read_section_file,
)
from pomona.executive import (
    CellFileError,
    Finding,
    Float64,
    Section,
    UnusablePicture,
    is_rigid,
    read_picture,
    read_plain_text,
    read_plane,
)

COLOUR_SUFFIXES = ("_color.jpg", "_color.jpeg", "_color.png")
DEPTH_SUFFIX = "_depth_mm.png"
INTRINSICS_FILE = "intrinsics.yaml"
DEPTH_MODEL_FILE = "depth_model.yaml"  # how the depth errs, before the cell file's model
POSES_FILE = "frames.json"
NEAREST_MM = 30


class UnusableFrames(DriverError):
    """A folder, a bag or an image that is no recorded frame, with the reason."""

    def __init__(self, path: Path, message: str) -> None:
        self.path = path
        super().__init__(f"{path}: {message}")


Images = tuple[
    NDArray[np.uint8], NDArray[np.float32]
]  # colour RGB (h, w, 3) and depth (h, w) [m], 0: no measurement


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """Two files that were taken together."""

    label: str
    colour: Path
    depth: Path

    def read(self, intrinsics: Intrinsics) -> Images:
        """Return both images; see `read_images`."""
        return read_images(self, intrinsics)


def list_frames(folder: Path) -> tuple[RecordedFrame, ...]:
    """Return the frames of a folder in the order of their names.

    Raises UnusableFrames: there is no such folder, it holds no frame, or a colour image has no depth beside it, or
    another colour image.
    """
    if not folder.is_dir():
        raise UnusableFrames(
            folder, "is not a folder" if folder.exists() else "there is no such folder"
        )
    names = sorted(
        entry.name for entry in os.scandir(folder) if not entry.name.startswith(".")
    )  # ._a: of a Mac
    there = set(names)
    frames: list[RecordedFrame] = []
    for name in names:
        suffix = next((suffix for suffix in COLOUR_SUFFIXES if name.endswith(suffix)), None)
        if suffix is None:
            continue
        label = name.removesuffix(suffix)
        depth = f"{label}{DEPTH_SUFFIX}"
        if depth not in there:
            raise UnusableFrames(
                folder / name,
                f"has no depth image beside it ({depth} is missing{_other(depth, there)})",
            )
        if frames and frames[-1].label == label:
            raise UnusableFrames(
                folder / name,
                f"is a second colour image of {depth}, beside {frames[-1].colour.name}",
            )
        frames.append(RecordedFrame(label, folder / name, folder / depth))
    if not frames:
        words = f"holds no frame: no file ends with {', '.join(COLOUR_SUFFIXES)}"
        raise UnusableFrames(
            folder, f"{words}; `pomona detect` finds fruit in photographs without depth"
        )
    return tuple(frames)


def read_images(frame: RecordedFrame, intrinsics: Intrinsics) -> Images:
    """Read both images of a frame.

    Raises UnusableFrames: a file cannot be read, or its size or type does not match the intrinsics and the format.
    """
    try:
        path = frame.colour
        colour = read_picture(path, as_taken=True)
        path = frame.depth
        depth = read_plane(path)
    except UnusablePicture as error:
        raise UnusableFrames(path, str(error)) from error
    if colour.shape[:2] != (intrinsics.height, intrinsics.width):
        expected = f"{intrinsics.width} x {intrinsics.height}"
        raise UnusableFrames(
            frame.colour, f"is {_size(colour)} pixels, the intrinsics are for {expected}"
        )
    if depth.shape[:2] != colour.shape[:2]:
        words = f"is {_size(depth)} pixels, and its colour {_size(colour)}: depth must be registered to colour"
        raise UnusableFrames(frame.depth, f"{words}, pixel by pixel")
    if depth.dtype != np.uint16 or depth.ndim != 2:
        channels = 1 if depth.ndim == 2 else depth.shape[2]
        raise UnusableFrames(
            frame.depth, f"holds {channels} x {depth.dtype}, depth in mm is one channel of uint16"
        )
    return colour, metres(depth, frame.depth)


def metres(depth: NDArray[np.uint16], path: Path) -> NDArray[np.float32]:
    """Return the depth in metres of depth in millimetres, of the same shape (height, width).

    Raises UnusableFrames: it holds no such thing: all of it is nearer than any camera measures, or it is noise.
    """
    furthest = int(depth.max(initial=0))
    if 0 < furthest < NEAREST_MM:
        raise UnusableFrames(
            path,
            f"holds depths up to {furthest} mm, nearer than any camera measures: is it in metres?",
        )
    if are_swapped(depth):
        raise UnusableFrames(
            path,
            "its depth is smooth only in the other byte order: it was written with bytes exchanged",
        )
    return depth.astype(np.float32) * np.float32(1e-3)


def are_swapped(counts: NDArray[Any]) -> bool:
    """Return True if neighbours differ by 100 on average, and by less than a quarter of that with swapped bytes."""
    steps = []
    for some in (counts[::4], counts[::4].byteswap()):
        row = np.clip(np.nan_to_num(some.astype(np.float32), posinf=0.0), 0.0, 1e5)
        both = (row[:, 1:] > 0.0) & (row[:, :-1] > 0.0)
        steps.append(float(np.abs(np.diff(row))[both].mean()) if both.any() else 0.0)
    return steps[0] > max(100.0, 4.0 * steps[1])


def _other(depth: str, there: Collection[str]) -> str:
    """Return words about a depth image that was taken alone: colour and depth of two moments are no frame."""
    alone = sorted(
        name
        for name in there
        if name.endswith(DEPTH_SUFFIX)
        and not any(
            f"{name.removesuffix(DEPTH_SUFFIX)}{suffix}" in there for suffix in COLOUR_SUFFIXES
        )
    )
    near = difflib.get_close_matches(depth, alone, 1, 0.0)
    return f"; {near[0]} has no colour and is of another moment" if near else ""


def _size(image: NDArray[Any]) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"


def read_intrinsics(path: Path) -> Intrinsics:
    """Read intrinsics from a file of their own.

    Raises CellFileError: it cannot be used; the text has the place and the reason.
    """
    try:
        foreign = foreign_calibration(read_plain_text(path))
    except (OSError, ValueError):
        foreign = None  # the reader below has its own words for a file that is no text
    if foreign is not None:
        message = f"this is {foreign[0]}, and no file of intrinsics"
        hint = foreign[1]
        raise CellFileError([Finding(str(path), 1, 1, "error", "foreign", message, hint)])
    section = Section(IntrinsicsSection)
    return read_section_file(
        path, "a file of intrinsics", lambda file: section.read(file.root, file.reader).intrinsics()
    )


def folder_intrinsics(folder: Path) -> Intrinsics | None:
    """Intrinsics that lie in the folder itself, or None. Raises CellFileError: the file is there and cannot be used."""
    path = folder / INTRINSICS_FILE
    return read_intrinsics(path) if path.is_file() else None


def read_depth_model(path: Path) -> DepthModel:
    """Read a depth model from a file of its own, as `pomona calibrate depth` writes it.

    Raises CellFileError: it cannot be used; the text has the place and the reason.
    """
    section = Section(DepthModelSection)
    return read_section_file(
        path, "a depth model", lambda file: section.read(file.root, file.reader).model()
    )


def folder_depth_model(folder: Path) -> DepthModel | None:
    """Read the depth model in a folder of frames, or return None.

    Raises CellFileError: the file is there and cannot be used.
    """
    path = folder / DEPTH_MODEL_FILE
    return read_depth_model(path) if path.is_file() else None


def folder_poses(folder: Path, labels: Collection[str]) -> dict[str, Float64]:
    """Read T_base_camera (4, 4) of the frames with these labels in a folder's file of poses.

    Raises:
        UnusableFrames: the file is there and cannot be used, or names none of the frames.
    """
    path = folder / POSES_FILE
    if not path.is_file():
        return {}
    try:
        entries = json.loads(read_plain_text(path))
        if not isinstance(entries, list):
            raise TypeError("it is no list")
        said = {str(entry["label"]): entry.get("T_base_camera") for entry in entries}
        if len(said) < len(entries):
            raise ValueError("two entries have the same label")
        poses = {label: np.array(T, np.float64) for label, T in said.items() if T is not None}
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise UnusableFrames(
            path, f"is no list of frames with label and T_base_camera: {error}"
        ) from error
    if said and not any(label in said for label in labels):
        words = f"names none of the frames of the folder. Its first label is '{next(iter(said))}'"
        raise UnusableFrames(
            path,
            f"{words}, the first frame is '{next(iter(labels), '')}': correct the labels or remove the file",
        )
    for label, T in poses.items():
        if not is_rigid(T):
            raise UnusableFrames(path, f"the pose of '{label}' is no rigid 4 x 4 transform")
    return poses
