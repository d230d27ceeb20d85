"""Ways to find fruit: the compact detector's options, a DOPE user's own files, or a detector of boxes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

WORKING_WIDTH = 320  # width to which pictures are shrunk for the finder [px]


@dataclass(frozen=True, slots=True)
class DetectorOptions:
    """Options of the compact detector."""

    finder_threshold: float = 0.25  # least score of the finder for a place that gets a close look
    looks: int = 2  # close looks at each fruit; every further look is centred by the one before
    mirrored: bool = True  # the last look is taken in a mirror too, and the mean of both answers is used
    most_fruit: int = 16  # places that get a second look, strongest first
    apart: float = 0.35  # two fruit are at least this part of the larger one's keypoint size apart
    # width to which pictures are shrunk for the finder [px]; None for several, up to the picture's own (`pyramid`)
    working_width: int | None = WORKING_WIDTH


@dataclass(frozen=True, slots=True)
class DopeFiles:
    """A published network and its configuration."""

    weights: Path  # checkpoint of the full network
    config: Path  # config_pose.yaml


PoseSource = Literal["close_look", "depth"]  # where the pose in a box comes from: the close look, or the depth


@dataclass(frozen=True, slots=True)
class BoxModelFile:
    """A detector of boxes (`box_model`), and where poses come from."""

    model: Path  # ONNX file
    pose: PoseSource = "close_look"  # see `PoseSource`
    working_width: int = WORKING_WIDTH  # width of the picture in a model without a fixed input size [px]


Search = DetectorOptions | DopeFiles | BoxModelFile  # any of the ways to find fruit in a frame
