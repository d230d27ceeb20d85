"""Input and output of Detect and DetectAll: the ways to search a frame, and detections."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pomona.drivers.interfaces import Frame
from pomona.executive.values.arrays import Float64
from pomona.executive.values.units import PIXELS, RATIO, Array
from pomona.skills.perception.fruit import FruitModel

WORKING_WIDTH = 320  # width to which pictures are shrunk for the finder [px]


@dataclass(frozen=True, slots=True)
class DetectorOptions:
    """Options of the compact detector."""

    finder_threshold: float = 0.25  # least score of the finder for a place that gets a close look
    looks: int = 2  # close looks at each fruit; every further look is centred by the one before
    # the last look is taken in a mirror too, and the mean of both answers is used
    mirrored: bool = True
    most_fruit: int = 16  # places that get a second look, strongest first
    apart: float = 0.35  # two fruit are at least this part of the larger one's keypoint size apart
    # width to which pictures are shrunk for the finder [px]; None for several, up to the picture's own (`pyramid`)
    working_width: int | None = WORKING_WIDTH
    # of fruit, where the weights know several; another word: all that the finder finds
    kind: str = ""


@dataclass(frozen=True, slots=True)
class DopeFiles:
    """A published network and its configuration."""

    weights: Path  # checkpoint of the full network
    config: Path  # config_pose.yaml


PoseSource = Literal[
    "close_look", "depth"
]  # where the pose in a box comes from: the close look, or the depth


@dataclass(frozen=True, slots=True)
class BoxModelFile:
    """A detector of boxes (`box_model`), and where poses come from."""

    model: Path  # ONNX file
    pose: PoseSource = "close_look"  # see `PoseSource`
    # width of the picture in a model without a fixed input size [px]
    working_width: int = WORKING_WIDTH


# entry points: `boxes` and `dope` load a detector, `kinds` a judge of kinds
DETECTORS = "pomona.detectors"

Search = DetectorOptions | DopeFiles | BoxModelFile  # any of the ways to find fruit in a frame


Pose = Annotated[Float64, Array(4, 4)]


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """One fruit found in a frame, posed as if it had the CAD model's size."""

    # the model that the detector was trained on; the object frame is its cuboid's: x right, y down, z forward
    fruit: FruitModel
    frame: Frame  # the look in which it was found
    T_base_camera: Pose  # pose of the camera at the look
    T_camera_object: Pose  # pose of the CAD-sized model (the paper's p̂ and Q̂)
    # the cuboid's 8 vertices and its centroid, shape (9, 2) [px]; NaN where not found
    keypoints: Annotated[Float64, Array(9, 2, of=PIXELS)]
    score: Annotated[float, RATIO]  # belief of the centroid, 0 to 1
    # of (rotation vector, translation) in the camera frame, (6, 6), from the errors that the network expects
    # (`rigid_pose`), or of the reprojection with DOPE's full network
    covariance: Annotated[Float64, Array(6, 6)]
    index: int  # place among the instances of the frame, by decreasing score
    found: int  # number of instances in the frame
    # share of its silhouette that is seen, 0 to 1, as the detector estimates it; NaN where it does not
    visibility: float = float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class AllDetections:
    """Every fruit that was found in one frame, by falling score; the frame, and where its camera stood."""

    detections: tuple[Detection, ...]
    frame: Frame
    T_base_camera: Pose

    @property
    def sentence(self) -> str:
        """Text for the operator."""
        return f"{len(self.detections)} fruit found" + (
            f" in {self.frame.label}" if self.frame.label else ""
        )
