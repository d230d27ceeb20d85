"""Ways to find fruit: the compact detector's options, a DOPE user's own files, or a detector of boxes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

WORKING_WIDTH = 320
"""Width to which pictures are shrunk for the finder [px]."""


@dataclass(frozen=True, slots=True)
class DetectorOptions:
    """Options of the compact detector.

    Attributes:
        finder_threshold: least score of the finder for a place that gets a close look.
        looks: close looks at each fruit; every further look is centred by the one before.
        mirrored: the last look is taken in a mirror too, and the mean of both answers is used.
        most_fruit: places that get a second look, strongest first.
        apart: two fruit are at least this part of the larger one's keypoint size apart.
        working_width: width to which pictures are shrunk for the finder [px].
    """

    finder_threshold: float = 0.25
    looks: int = 2
    mirrored: bool = True
    most_fruit: int = 16
    apart: float = 0.35
    working_width: int = WORKING_WIDTH


@dataclass(frozen=True, slots=True)
class DopeFiles:
    """A published network and its configuration.

    Attributes:
        weights: checkpoint of the full network.
        config: config_pose.yaml.
    """

    weights: Path
    config: Path


PoseSource = Literal["close_look", "depth"]
"""Where the pose in a box comes from: the close look of the fruit's weights, or the depth in the box."""


@dataclass(frozen=True, slots=True)
class BoxModelFile:
    """A detector of boxes (`box_model`), and where poses come from.

    Attributes:
        model: ONNX file.
        pose: see `PoseSource`.
        working_width: width of the picture in a model without a fixed input size [px].
    """

    model: Path
    pose: PoseSource = "close_look"
    working_width: int = WORKING_WIDTH


Search = DetectorOptions | DopeFiles | BoxModelFile
"""Any of the ways to find fruit in a frame."""
